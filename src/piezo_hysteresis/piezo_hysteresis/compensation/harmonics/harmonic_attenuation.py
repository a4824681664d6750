"""The link that attenuates harmonics of the tracking error, and its supervision."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.compensation.drive_selection import DriveSelector
from piezo_hysteresis.compensation.harmonics import afc, harmonic_rls
from piezo_hysteresis.compensation.harmonics.lines import (
    LIVE,
    SETTLE,
    WITH_MEAN,
    AttenuationSettings,
    Harmonic,
)
from piezo_hysteresis.compensation.linear_gain import LinearGain, ModeGain, PulseGain
from piezo_hysteresis.compensation.link import (
    ACCELERATION,
    DISPLACEMENT,
    FREQUENCY,
    OK,
    PHASE,
    POINT_SIZE,
    READ_DISPLACEMENT,
    VELOCITY,
    WATCH_SIZE,
    CompiledLaw,
    CompiledLink,
    Limits,
    Measured,
    ReferencePoint,
    Transition,
    frozen_ticks,
    partner_of,
    reset_watch,
    watch_counters,
)
from piezo_hysteresis.errors import CompensationError
from piezo_hysteresis.jit import inline_jit, jit
from piezo_hysteresis.models.modelfile import ModelFile
from piezo_hysteresis.models.schedule import OperatingPoint

__all__ = ['AttenuationSettings', 'Harmonic', 'HarmonicAttenuation']

# Shortest window, the time over which a correction fades, and by how much longer it takes to fade
# in after each failure [s].
_SPAN, _FADE, _SLOWER = 0.25, 0.2, 2.0
# Wait after the first failure, doubled by each further one up to the longest [s].
_WAIT, _LONGEST = 1.0, 60.0
# Shortest time between two experiments that found no harm, doubled by each further one [s].
_PAUSE = 2.0
# Mean square error, as a multiple of that without a correction, that is suspicious in so many
# windows in a row; that is suspicious at once; and that is so after the frequency has changed, for
# which there is no measurement without a correction yet.
_LARGER, _WINDOWS, _FAR, _STALE = 1.21, 10.0, 25.0, 4.0
# The correction is harmful if it increases the mean square error by this factor.
_HARM = 1.1
# Below this share of the error without it a correction is successful: failures are reset.
_SUCCESS = 0.25
# Relative change of the frequency after which the measurement without a correction is stale.
_CHANGE = 0.05

# The error has settled if its mean squares in two successive windows differ by less than this
# factor. These windows are shorter [s]; after so many of them the law begins regardless.
_SETTLED, _STARTING_SPAN, _MOST_STARTING = 1.25, 0.125, 16.0

RUNNING, MEASURING, WAITING, STARTING = range(4)
# Requests of `supervise` to the law.
NOTHING, RETREAT, RESUME = range(3)

# Places in the memory: state; weight of the correction; mean square error without it [m^2], the
# amplitude of the reference then [m], its frequency [Hz] and whether both still hold; the window:
# sum of squares, sum, ticks, turn it began with; suspicious windows in a row; mean square error
# before the experiment; failures and harmless experiments in a row; time that is left [s]; how
# often a correction was faded out for good, how many experiments there were, and windows since the
# start.
(
    STATE, WEIGHT, BASE, SIZE, BASE_FREQUENCY, VALID, SQUARES, SUM, TICKS, TURN, RISES, BEFORE,
    FAILURES, CHECKS, LEFT, BACKED_OFF, CHECKED, STARTED,
) = range(18)  # fmt: skip
GUARD_SIZE = 18


@jit
def reset_guard(memory: FloatArray, fading: bool) -> None:
    """Reset: the correction has its full weight, and learns at once if it may while `fading`."""
    for k in range(GUARD_SIZE):
        memory[k] = 0.0
    memory[WEIGHT] = 1.0
    memory[STATE] = RUNNING if fading else STARTING


@inline_jit
def learns(memory: FloatArray, fading: bool) -> bool:
    """Return whether the law may learn from the error: in full force, or while `fading` in too."""
    return bool(memory[STATE] == RUNNING and (fading or memory[WEIGHT] == 1.0))


@inline_jit
def fade(memory: FloatArray, fading: bool, dt: float) -> float:
    """Take one tick; return the weight of the correction, 0..1.

    A law that learns while `fading` in does so more slowly after each failure.
    """
    if memory[STATE] == STARTING:
        return 1.0
    if memory[STATE] == RUNNING:
        time = _FADE + (_SLOWER * memory[FAILURES] if fading else 0.0)
        memory[WEIGHT] = min(memory[WEIGHT] + dt / time, 1.0)
    else:
        memory[WEIGHT] = max(memory[WEIGHT] - dt / _FADE, 0.0)
    return float(memory[WEIGHT])


@inline_jit
def empty_window(memory: FloatArray) -> None:
    """Begin a window."""
    memory[SQUARES] = memory[SUM] = memory[TICKS] = 0.0


@inline_jit
def supervise(
    error: float, frequency: float, phase: float, size: float, disturbed: bool, with_mean: bool,
    settle: float, memory: FloatArray, dt: float,
) -> int:  # fmt: skip
    """Process the error of one tick."""
    # error, size [m]; frequency [Hz]; phase [rad]; settle, dt [s]; memory (GUARD_SIZE,)
    if memory[STATE] == RUNNING:
        memory[LEFT] = max(memory[LEFT] - dt, 0.0)
        if memory[WEIGHT] < 1.0:
            empty_window(memory)
            return RESUME
    elif memory[STATE] == STARTING:
        pass
    elif memory[WEIGHT] > 0.0:
        memory[LEFT] = max(memory[LEFT], settle)
        return NOTHING
    elif memory[LEFT] > 0.0:
        memory[LEFT] -= dt
        empty_window(memory)
        return NOTHING
    if frequency <= 0.0 or size <= 0.0 or disturbed:
        empty_window(memory)
        return NOTHING
    turn = math.floor(phase / (2.0 * math.pi))
    if memory[TICKS] == 0.0:
        memory[TURN] = turn
    answer = NOTHING
    span = _STARTING_SPAN if memory[STATE] == STARTING else _SPAN
    if turn != memory[TURN] and memory[TICKS] * dt >= span:
        mean = memory[SUM] / memory[TICKS]
        power = memory[SQUARES] / memory[TICKS] - (0.0 if with_mean else mean * mean)
        empty_window(memory)
        memory[TURN] = turn
        answer = judge(power, frequency, size, memory)
    memory[SQUARES] += error * error
    memory[SUM] += error
    memory[TICKS] += 1.0
    return answer


@inline_jit
def doubled(time: float, times: float) -> float:
    """Return a time [s] doubled `times` times, at most the longest."""
    for _ in range(int(times)):
        time = min(2.0 * time, _LONGEST)
    return time


@inline_jit
def judge(power: float, frequency: float, size: float, memory: FloatArray) -> int:
    """Evaluate the mean square error [m^2] of a window."""
    before = memory[BASE]
    if memory[STATE] != RUNNING or memory[BASE] == 0.0:
        memory[BASE], memory[SIZE], memory[BASE_FREQUENCY] = power, size, frequency
        memory[VALID], memory[RISES] = 1.0, 0.0
    elif is_larger(power, frequency, size, memory):
        memory[STATE], memory[BEFORE] = MEASURING, power
        memory[CHECKED] += 1.0
        return NOTHING
    if memory[STATE] == STARTING:
        memory[STARTED] += 1.0
        settled = max(power, before) <= _SETTLED * min(power, before)
        if not settled and memory[STARTED] < _MOST_STARTING:
            return NOTHING
    if memory[STATE] == MEASURING:
        if memory[BEFORE] > _HARM * power:
            memory[LEFT] = doubled(_WAIT, memory[FAILURES])
            memory[FAILURES] += 1.0
            memory[BACKED_OFF] += 1.0
            memory[STATE] = WAITING
            return RETREAT
        memory[LEFT] = doubled(_PAUSE, memory[CHECKS])
        memory[CHECKS] += 1.0
    memory[STATE] = RUNNING
    return NOTHING


@inline_jit
def is_larger(power: float, frequency: float, size: float, memory: FloatArray) -> bool:
    """Return whether the error [m^2] exceeds that without correction enough to test it."""
    if abs(frequency - memory[BASE_FREQUENCY]) > _CHANGE * memory[BASE_FREQUENCY]:
        memory[VALID] = 0.0
    larger = size / memory[SIZE]
    base = memory[BASE] * max(1.0, larger * larger)
    if power < _SUCCESS * base:
        memory[FAILURES] = memory[CHECKS] = 0.0
    bound = (_LARGER if memory[VALID] > 0.0 else _STALE) * base
    # An error larger than the reference is suspicious, regardless of the measurement without it.
    suspicious = power > min(bound, max(0.5 * size * size, base))
    memory[RISES] = memory[RISES] + 1.0 if suspicious else 0.0
    far = memory[RISES] >= _WINDOWS or power > _FAR * base
    return bool(far and memory[LEFT] == 0.0)


def guard_counters(memory: FloatArray) -> dict[str, int]:
    """Return how often the correction backed off, was put to the test, and whether it is off."""
    return {
        'backed_off': int(memory[BACKED_OFF]),
        'tested': int(memory[CHECKED]),
        'faded_out': int(memory[STATE] == WAITING),
    }


# Change of the reference's amplitude from period to period that counts as a ramp.
RAMP = 0.02

# Places in the memory, behind that of the watch: the period of the reference, its largest
# amplitude so far and that of the previous one; then the memory of the supervision.
_TURN, _LARGEST, _BEFORE = range(WATCH_SIZE, WATCH_SIZE + 3)
GUARD = WATCH_SIZE + 3
OWN = GUARD + GUARD_SIZE  # where the memory of the law begins

# Places in the numbers: where the gain of the plant begins, behind the packed settings.
DT, FROZEN, _GAIN_AT = range(3)
SETTINGS = 3
#: Parameters of the mode of the plant that may change, by place in its packed gain.
_MODE = {
    name: 1 + ModeGain._fields.index(name)
    for name in ('gain', 'natural_frequency', 'damping_ratio')
}


@inline_jit
def ramp_ended(point: FloatArray, memory: FloatArray) -> bool:
    """Process the reference of one tick; return whether a period with another amplitude ended.

    While the reference fades in, the error changes with it, and a law that learns from changes of
    the error would learn a wrong gain. The amplitude is that of velocity and acceleration, so that
    the mean of the reference has no influence; its largest value per period is compared with the
    period before, so that a reference of several tones is no ramp.
    """
    if point[FREQUENCY] <= 0.0:
        reset_ramp(memory)
        return False
    omega = 2.0 * math.pi * point[FREQUENCY]
    size = math.hypot(point[VELOCITY] / omega, point[ACCELERATION] / (omega * omega))
    turn = math.floor(point[PHASE] / (2.0 * math.pi))
    if turn == memory[_TURN]:
        memory[_LARGEST] = max(memory[_LARGEST], size)
        return False
    before, now = memory[_BEFORE], memory[_LARGEST]
    memory[_TURN], memory[_BEFORE], memory[_LARGEST] = turn, now, size
    return bool(before > 0.0 and abs(now - before) > RAMP * max(now, before))


@jit
def reset_ramp(memory: FloatArray) -> None:
    """Discard the previous periods."""
    memory[_TURN], memory[_LARGEST], memory[_BEFORE] = -1.0, 0.0, 0.0


class HarmonicLaw(NamedTuple):
    """A method of harmonic attenuation as kernels.

    All but the first two have a memory of their own, packed settings and gain, and dt [s].
    """

    step: Callable[..., float]  # ``step(given, received, memory, numbers)`` [V]
    reset: Callable[[FloatArray, FloatArray], None]  # ``reset(memory, numbers)``
    size: Callable[[FloatArray], int]  # ``size(p)``: length of its memory
    regain: Callable[[FloatArray, FloatArray, FloatArray, float], None]
    harmonics: Callable[[FloatArray, FloatArray, FloatArray, float], list[Harmonic]]
    counters: Callable[[FloatArray], dict[str, int]]


def _law(
    module: Any, size: Callable[[FloatArray], int], retreat: Any, fading: bool
) -> HarmonicLaw:
    """Return the law of a module; whether it learns while it is `fading` in.

    Its step returns `received` minus the correction [V]; see `fade` for its weight.
    """
    update, voltage, disturb, clear = module.update, module.voltage, module.disturb, module.clear

    @jit
    def step(given: FloatArray, received: float, memory: FloatArray, numbers: FloatArray) -> float:
        point, read = given[:POINT_SIZE], given[POINT_SIZE:]
        dt, own, guard = numbers[DT], memory[OWN:], memory[GUARD:OWN]
        at = int(numbers[_GAIN_AT])
        p, g = numbers[SETTINGS:at], numbers[at:]
        ramping = ramp_ended(point, memory)
        if ramping:
            disturb(own, p, g, dt)
        place = partner_of(point, read, memory, numbers[FROZEN])
        if place >= 0:
            error = read[READ_DISPLACEMENT] - memory[place + DISPLACEMENT]
            frequency, phase = memory[place + FREQUENCY], memory[place + PHASE]
            asked = supervise(
                error, frequency, phase, memory[_BEFORE], ramping, p[WITH_MEAN] > 0.0, p[SETTLE],
                guard, dt,
            )  # fmt: skip
            if asked == RETREAT:
                retreat(own, p, g, dt)
            elif asked == RESUME:
                disturb(own, p, g, dt)
            if learns(guard, fading):
                update(error, frequency, phase, own, p, g, dt)
        weight = fade(guard, fading, dt)
        if weight == 0.0:
            return received
        return float(received - weight * voltage(point[FREQUENCY], point[PHASE], own, p, g, dt))

    @jit
    def reset(memory: FloatArray, numbers: FloatArray) -> None:
        at = int(numbers[_GAIN_AT])
        reset_watch(memory)
        reset_ramp(memory)
        reset_guard(memory[GUARD:OWN], fading)
        clear(memory[OWN:], numbers[SETTINGS:at], numbers[at:], numbers[DT])

    return HarmonicLaw(step, reset, size, module.regain, module.harmonics, module.counters)


LAWS = {
    'afc': _law(afc, afc.afc_size, afc.retreat, fading=False),
    'rls': _law(harmonic_rls, harmonic_rls.rls_size, harmonic_rls.clear, fading=True),
}


class HarmonicAttenuation(CompiledLink):
    """A link that cancels selected harmonics of the error.

    The measurement is compared with the reference of its own tick, whatever the latency, and the
    phase is the accumulated one of the reference, so that it tracks changes of frequency. While
    the sensor is lost or frozen the learned correction continues without learning.

    Parameters
    ----------
    settings : AttenuationSettings
        Method, orders and their tuning.
    gain : callable
        Modelled plant gain [m/V] by frequency [Hz], see `LinearGain`.
    dt : float
        Sampling interval [s].
    limits : Limits
        Range of the voltage, which bounds the correction where the settings do not.
    decay : float
        Time constant of the mode of the plant [s], infinite where it is unknown.

    Raises
    ------
    CompensationError
        If a setting is impossible.
    """

    def __init__(
        self,
        settings: AttenuationSettings,
        gain: LinearGain,
        dt: float,
        limits: Limits = Limits(),  # noqa: B008
        decay: float = math.inf,
    ) -> None:
        self.dt = float(dt)
        self._use(settings.within(limits, decay), gain.packed)

    def _use(self, settings: AttenuationSettings, gain: FloatArray) -> None:
        """Begin with these settings, without a correction."""
        if settings.method == 'rls' and settings.automatic:
            raise CompensationError(
                'attenuation: method rls takes order -1 from a model that was identified per '
                'frequency; give the orders by number, as in [3], or take method afc'
            )
        self.settings, packed = settings, settings.packed
        self._law = LAWS[settings.method]
        head = (self.dt, frozen_ticks(self.dt), SETTINGS + packed.size)
        numbers = np.concatenate([head, packed, gain])
        super().__init__(self._law.step, numbers, OWN + self._law.size(packed))
        HarmonicAttenuation.reset(self)

    @property
    def packed(self) -> FloatArray:
        """Settings as the kernels read them."""
        return self.numbers[SETTINGS : int(self.numbers[_GAIN_AT])]

    @property
    def packed_gain(self) -> FloatArray:
        """Gain of the plant as the kernels read it."""
        return self.numbers[int(self.numbers[_GAIN_AT]) :]

    def compiled(self) -> CompiledLaw:
        """Return its kernels, with settings and the plant as a mode that change at run time."""
        at, regain = SETTINGS + self.packed.size, self._law.regain
        places = np.array([SETTINGS + k for k in LIVE.values()] + [at + k for k in _MODE.values()])

        @inline_jit
        def take(
            values: FloatArray, bounds: FloatArray, memory: FloatArray, numbers: FloatArray,
            first: bool,
        ) -> int:  # fmt: skip
            for k in range(places.size):
                numbers[places[k]] = values[k]
            if not first:
                regain(memory[OWN:], numbers[SETTINGS:at], numbers[at:], numbers[DT])
            return OK

        names = (*LIVE, *(f'plant.{name}' for name in _MODE))
        settable = tuple(zip(names, self.numbers[places].tolist(), strict=True))
        return CompiledLaw('attenuation', self.kernel, self._law.reset, take, settable)

    def harmonics(self) -> list[Harmonic]:
        """Return order, error [m, rad] and correction [V, rad] of every order."""
        return self._law.harmonics(self.memory[OWN:], self.packed, self.packed_gain, self.dt)

    def set_gain(self, gain: LinearGain) -> None:
        """Take a new model of the plant gain while running."""
        settings = self.numbers[: int(self.numbers[_GAIN_AT])]
        self.numbers = np.concatenate([settings, gain.packed])
        self._law.regain(self.memory[OWN:], self.packed, self.packed_gain, self.dt)

    def counters(self) -> dict[str, int]:
        """Return what the law, its supervision and the watch over the sensor counted."""
        own = self._law.counters(self.memory[OWN:])
        return {**own, **guard_counters(self.memory[GUARD:OWN]), **watch_counters(self.memory)}

    def reset(self) -> None:
        """Reset everything but the settings."""
        self._law.reset(self.memory, self.numbers)


class ScheduledAttenuation(HarmonicAttenuation):
    """The attenuation with the gain of the entry that is nearest to the drive.

    An entry is known at its own frequency, its harmonics are not: the gain over frequency is that
    of all drives, with the size of the entry at its frequency. Before the first frequency it is
    that of all drives. The learned correction is kept where
    the entry changes. `rls` turns its correction by the phase of the gain; the difference fades
    within the slew limit. By order -1, `rls` takes the harmonic of each entry, and begins anew
    where it changes.
    """

    def __init__(
        self,
        settings: AttenuationSettings,
        model: ModelFile,
        gain_of: Callable[[ModelFile], PulseGain],
        dt: float,  # [s]
        limits: Limits,
        decay: float,  # [s]
        transition: float,  # [s]
    ) -> None:
        assert model.schedule is not None
        self._gain_of = gain_of
        self._selector = DriveSelector(model.schedule, dt)
        self._fade = Transition(dt, transition, limits.slew)
        self._gain_of_all = gain_of(model)
        self._gains = self._gains_of(model)
        self._changes = 0
        self._by_order = settings.method == 'rls' and settings.automatic
        if self._by_order:
            settings = settings.only(0)
        super().__init__(settings, self._gain_of_all, dt, limits, decay)

    @property
    def point(self) -> OperatingPoint | None:
        """The entry in use, None before the first frequency."""
        return self._selector.point

    def step(
        self, point: ReferencePoint, received: float = 0.0, measured: Measured | None = None
    ) -> float:
        """Return `received` minus the correction [V]."""
        before = self.point
        chosen = self._selector.select(point)
        if chosen is not None and chosen is not before:
            self._changes += before is not None
            self._take(chosen)
        return received + self._fade.apply(super().step(point, received, measured) - received)

    def update(self, model: ModelFile) -> None:
        """Take changed entries, and new ones, while running."""
        assert model.schedule is not None
        self._gain_of_all = self._gain_of(model)
        self._gains = self._gains_of(model)
        self._selector.replace(model.schedule)
        if self.point is None:
            self.set_gain(self._gain_of_all)
        else:
            self._take(self.point)

    def counters(self) -> dict[str, int]:
        """Return what the law counted, and the changes of the entry."""
        return {**super().counters(), 'schedule_changes': self._changes}

    def reset(self) -> None:
        """Reset everything but settings and schedule."""
        super().reset()
        self._selector.reset()
        self._fade.reset()
        self._changes = 0

    def _gains_of(self, model: ModelFile) -> dict[str, PulseGain]:
        assert model.schedule is not None
        gains = {}
        for point in model.schedule.points:
            usual = abs(self._gain_of_all(point.frequency))
            size = abs(self._gain_of(point.model)(point.frequency))
            gains[point.name] = self._gain_of_all.scaled(size / usual if usual > 0.0 else 1.0)
        return gains

    def _take(self, chosen: OperatingPoint) -> None:
        if self._by_order and self.settings.orders != self.settings.only(chosen.order).orders:
            self._use(self.settings.only(chosen.order), self.packed_gain)
        self.set_gain(self._gains[chosen.name])
        if self.settings.method == 'rls':
            self._fade.start()
