"""What the feedback links share: settings, the error of the right tick, a bound."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.common.parameter_table import documented, judge, setting
from piezo_hysteresis.compensation.link import (
    DISPLACEMENT,
    FADE_SIZE,
    OK,
    POINT_SIZE,
    READ_DISPLACEMENT,
    READ_VOLTAGE,
    WATCH_SIZE,
    CompiledLaw,
    CompiledLink,
    Limits,
    begin_fade,
    fade,
    frozen_ticks,
    partner_of,
    reset_fade,
    reset_watch,
    watch_counters,
)
from piezo_hysteresis.errors import CompensationError
from piezo_hysteresis.jit import inline_jit, jit

# A plant with the opposite sign is distinguished from one that is driven into its limits: slow
# changes of voltage and displacement are correlated. The sign alone is no proof, because feedback
# opposes disturbances: use it only if the loop has reached a limit. The time constants [s] are
# slower than the swings of an unstable loop about a resonance, and faster than drift.
_SMOOTHING = 0.1
_DECAY = 2.0

# Places in the memory of the polarity.
_STARTED, _SLOW_V, _SLOW_Y, _FIRST_V, _FIRST_Y, _PRODUCT = range(6)
POLARITY_SIZE = 6


@inline_jit
def update_polarity(voltage: float, displacement: float, memory: FloatArray, dt: float) -> None:
    """Take the voltage [V] and the displacement [m] of one tick."""
    share, decay = min(1.0, dt / _SMOOTHING), min(1.0, dt / _DECAY)
    if memory[_STARTED] == 0.0:
        memory[_STARTED] = 1.0
        memory[_SLOW_V] = memory[_FIRST_V] = voltage
        memory[_SLOW_Y] = memory[_FIRST_Y] = displacement
    memory[_SLOW_V] += share * (voltage - memory[_SLOW_V])
    memory[_SLOW_Y] += share * (displacement - memory[_SLOW_Y])
    product = (memory[_SLOW_V] - memory[_FIRST_V]) * (memory[_SLOW_Y] - memory[_FIRST_Y])
    memory[_PRODUCT] += decay * (product - memory[_PRODUCT])


@inline_jit
def inverted(memory: FloatArray) -> bool:
    """Return whether displacement and voltage, relative to the start, are anticorrelated."""
    return bool(memory[_PRODUCT] < 0.0)


# A window in which the voltage was cut off for this share of the time, while what the link
# receives is within the range, is looked at: cut at both ends the loop swings between its limits,
# cut at one end and answered by the opposite sign the plant is inverted.
_CUT_SHARE = 0.25
_BOTH_ENDS = 0.08
_WINDOW = 0.5
_FADE = 0.2

# Places in the memory, behind that of the watch: why the law is off, ticks that were cut, then the
# window: its ticks, those cut at the low and at the high end.
_OFF, _SATURATED, _TICKS, _CUT_LOW, _CUT_HIGH = range(WATCH_SIZE, WATCH_SIZE + 5)
_DIVERGED, _INVERTED = 1.0, 2.0
_POLARITY = WATCH_SIZE + 5
_FADING = _POLARITY + POLARITY_SIZE
OWN = _FADING + FADE_SIZE  # where the memory of the law begins

# Places in the numbers; the parameters of the law follow.
DT, LOW, HIGH, SLEW, WINDOW, FROZEN = range(6)
SETTINGS = 6


class FeedbackLaw(NamedTuple):
    """A law on the error as kernels; `memory` is its own, `p` its parameters."""

    share: Callable[[float, FloatArray, FloatArray, float], float]  # [V] [m]
    hold: Callable[[FloatArray, FloatArray], float]  # [V]
    cut: Callable[[float, FloatArray, FloatArray, float], None]  # [V]


@inline_jit
def judge_error(excess: float, received_in_range: bool, memory: FloatArray, window: float) -> None:
    """Switch the law off if it is harmful."""
    memory[_TICKS] += 1.0
    if excess != 0.0 and received_in_range:
        memory[_SATURATED] += 1.0
        if excess > 0.0:
            memory[_CUT_LOW] += 1.0
        else:
            memory[_CUT_HIGH] += 1.0
    if memory[_TICKS] < window:
        return
    low, high, ticks = memory[_CUT_LOW], memory[_CUT_HIGH], memory[_TICKS]
    if low + high > _CUT_SHARE * ticks:
        if min(low, high) > _BOTH_ENDS * ticks:
            memory[_OFF] = _DIVERGED
        if inverted(memory[_POLARITY:_FADING]):
            memory[_OFF] = _INVERTED
    memory[_TICKS] = memory[_CUT_LOW] = memory[_CUT_HIGH] = 0.0
    if memory[_OFF] > 0.0:
        begin_fade(memory[_FADING:OWN])


def stepping(law: FeedbackLaw) -> Callable[..., float]:
    """Return the kernel of a link: ``step(given, received, memory, numbers)``.

    It returns `received` plus the share of the law [V].
    """
    share_of, hold, cut = law

    @jit
    def step(given: FloatArray, received: float, memory: FloatArray, numbers: FloatArray) -> float:
        point, read = given[:POINT_SIZE], given[POINT_SIZE:]
        dt, low, high, own = numbers[DT], numbers[LOW], numbers[HIGH], memory[OWN:]
        p = numbers[SETTINGS:]
        place = partner_of(point, read, memory, numbers[FROZEN])
        on = memory[_OFF] == 0.0
        if not on:
            share = 0.0
        elif place < 0:
            share = hold(own, p)
        else:
            reading = read[READ_DISPLACEMENT]
            update_polarity(read[READ_VOLTAGE], reading, memory[_POLARITY:_FADING], dt)
            share = share_of(memory[place + DISPLACEMENT] - reading, own, p, dt)
        unlimited = received + share
        safe = min(max(unlimited, low), high)
        if on and place >= 0:
            cut(safe - unlimited, own, p, dt)
            judge_error(safe - unlimited, low <= received <= high, memory, numbers[WINDOW])
        return received + fade(safe - received, memory[_FADING:OWN], dt, _FADE, numbers[SLEW])

    return step


@jit
def reset_feedback(memory: FloatArray, numbers: FloatArray) -> None:
    """Reset everything but the parameters."""
    reset_watch(memory)
    for k in range(WATCH_SIZE, memory.size):
        memory[k] = 0.0
    reset_fade(memory[_FADING:OWN])


def packed_settings(dt: float, limits: Limits | None) -> FloatArray:
    """Return the settings of the kernel."""
    bound = Limits(-math.inf, math.inf, math.inf) if limits is None else limits
    window = float(max(1, round(_WINDOW / dt)))
    return np.array([dt, bound.low, bound.high, bound.slew, window, frozen_ticks(dt)])


def _nothing() -> Callable[[FloatArray, FloatArray, FloatArray], None]:
    @inline_jit
    def change(memory: FloatArray, p: FloatArray, values: FloatArray) -> None:
        return

    return change


class FeedbackLink(CompiledLink):
    """Base of the feedback links: adds a law on the error to the voltage that it receives.

    The measurement is compared with the reference of its own tick. Without a valid measurement the
    law holds its output. If the plant has the opposite sign, or the loop oscillates between the
    limits, the law fades out and stays off until `reset`; `counters` report it.

    Parameters
    ----------
    dt : float
        Sampling interval [s].
    limits : Limits, optional
        Range of the output voltage [V]; the law receives the limited value (anti-windup).
    kernel : callable
        Kernel of the link, from `stepping`.
    packed : ndarray
        Parameters of the law, as its kernels read them.
    size : int
        Size of the memory of the law.
    """

    #: Kernel ``change(memory, p, values)`` before the parameters become `values`.
    change: Any = None

    def __init__(
        self,
        dt: float,
        limits: Limits | None,
        kernel: Callable[..., float],
        packed: FloatArray,
        size: int,
    ) -> None:
        if not (math.isfinite(dt) and dt > 0):
            raise CompensationError(f'the sampling interval must be positive, got {dt:g} s')
        self.dt = dt
        super().__init__(kernel, np.concatenate([packed_settings(dt, limits), packed]), OWN + size)
        self.reset()

    @property
    def packed(self) -> FloatArray:
        """Parameters of the law, as its kernels read them."""
        return self.numbers[SETTINGS:]

    def settable(self) -> tuple[str, ...]:
        """Return the parameters of its node that may change, in the order of its numbers."""
        return ()

    def compiled(self) -> CompiledLaw:
        """Return its kernels; the limits and what is `settable` change at run time."""
        names, change = self.settable(), self.change or _nothing()
        count = len(names)

        @inline_jit
        def take(
            values: FloatArray, bounds: FloatArray, memory: FloatArray, numbers: FloatArray,
            first: bool,
        ) -> int:  # fmt: skip
            if not first:
                change(memory[OWN:], numbers[SETTINGS:], values)
            for k in range(count):
                numbers[SETTINGS + k] = values[k]
            numbers[LOW], numbers[HIGH], numbers[SLEW] = bounds[0], bounds[1], bounds[2]
            return OK

        settable = tuple(zip(names, self.packed.tolist(), strict=False))
        return CompiledLaw('feedback', self.kernel, reset_feedback, take, settable)

    def counters(self) -> dict[str, int]:
        """Return the error counters by name."""
        return {
            'saturated': int(self.memory[_SATURATED]),
            'inverted_plant': int(self.memory[_OFF] == _INVERTED),
            'diverged': int(self.memory[_OFF] == _DIVERGED),
            **watch_counters(self.memory),
        }

    def reset(self) -> None:
        """Reset everything but the parameters."""
        reset_feedback(self.memory, self.numbers)


#: Laws on the tracking error.
FEEDBACKS = ('none', 'pid', 'fuzzy_pid', 'h_infinity')


@documented
@dataclass(frozen=True)
class PidGains:
    """Gains of a PID controller on the displacement error d - y.

    Raises
    ------
    CompensationError
        If one is invalid.
    """

    proportional: float = setting(0.0, 'Proportional gain.', 'V/m', low=0.0, high=1e12)
    integral: float = setting(3e4, 'Integral gain.', 'V/(m s)', low=0.0, high=1e12)
    derivative: float = setting(0.0, 'Derivative gain.', 'V s/m', low=0.0, high=1e12)
    derivative_filter: float = setting(
        2e-3, 'Time constant of the low-pass filter on the derivative.', 's', above=0.0, high=60.0
    )
    tracking_time: float = setting(
        0.05,
        'Anti-windup: tracking time constant of the integral in saturation.',
        's',
        above=0.0,
        high=1e6,
    )

    def __post_init__(self) -> None:
        for name in ('proportional', 'integral', 'derivative'):
            value = getattr(self, name)
            if not value >= 0.0:
                raise CompensationError(
                    f'the {name} gain must be 0 or more, got {value:g}; a plant of the opposite '
                    'sign is corrected at the sensor or amplifier, not by a negative gain'
                )
        refuse(judge(self))


@documented
@dataclass(frozen=True)
class FuzzyScales:
    """Input and output scales of a fuzzy PID.

    Raises
    ------
    CompensationError
        If one is impossible.
    """

    error_scale: float = setting(5e-6, 'Error that counts as big.', 'm', above=0.0, high=0.01)
    rate_scale: float = setting(
        1e-3, 'Rate of the error that counts as big.', 'm/s', above=0.0, high=100.0
    )
    proportional_range: float = setting(
        0.0, 'Largest change of the proportional gain.', 'V/m', low=0.0, high=1e12
    )
    integral_range: float = setting(
        1e4, 'Largest change of the integral gain.', 'V/(m s)', low=0.0, high=1e12
    )

    def __post_init__(self) -> None:
        refuse(judge(self))


@documented
@dataclass(frozen=True)
class HInfinityWeights:
    """What the closed loop shall achieve; Xiao 2014 gives no weights.

    The loop stays stable while the plant differs from its model, at any frequency, by less than
    ``control / gamma`` times its gain at rest.

    Raises
    ------
    CompensationError
        If one is impossible.
    """

    bandwidth: float = setting(
        2.0, 'Bandwidth: frequency up to which errors are attenuated.', 'Hz', above=0.0, high=1e4
    )
    steady_error: float = setting(
        1e-3, 'Remaining fraction of a constant disturbance.', '1', above=0.0, high=1.0
    )
    peak: float = setting(
        1.6,
        'Largest amplification of errors beyond the bandwidth; small values give robustness.',
        '1',
        above=1.0,
        high=100.0,
    )
    control: float = setting(0.5, 'Weight of the voltage.', '1', above=0.0, high=1e6)
    delay_ticks: int = setting(
        1,
        'Delay of the measurement in samples; 1 in lock-step. The hold of the voltage is '
        'included separately.',
        '1',
        low=0,
        high=20,
    )

    def __post_init__(self) -> None:
        if self.delay_ticks != int(self.delay_ticks):
            raise CompensationError('delay_ticks must be a whole number from 0')
        object.__setattr__(self, 'delay_ticks', int(self.delay_ticks))
        refuse(judge(self))


def refuse(reason: str) -> None:
    """Raise an error if there is a reason.

    Raises
    ------
    CompensationError
        With the reason.
    """
    if reason:
        raise CompensationError(reason)
