"""Base of the feedforward inverses: conditioned reference, counters, bumpless parameter change.

An inverse is one compiled kernel on a sample of the conditioned reference with an explicit state;
arrays are a loop over it, so that they give bitwise equal results.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.compensation.link import (
    FADE_SIZE,
    OK,
    CompiledLaw,
    CompiledLink,
    Limits,
    ReferencePoint,
    begin_fade,
    fade,
    reset_fade,
)
from piezo_hysteresis.errors import CompensationError
from piezo_hysteresis.jit import inline_jit, jit, scratch
from piezo_hysteresis.numerics.smooth import smooth_step


class Motion(NamedTuple):
    """A displacement [m] with its first two derivatives, or a signal without derivatives."""

    displacement: float
    velocity: float
    acceleration: float


#: Kernel of an inverse: ``run(motion, memory, p, dt, low, high)`` returns the voltage [V].
Run = Callable[[Motion, FloatArray, FloatArray, float, float, float], float]

# Indices in the state of the conditioning kernel, the first part of the memory of a link; the
# memory of a transition follows, then that of the inverse.
_TICK, _LAST, REFUSED = 0, 1, 2
FADING = 3
OWN = FADING + FADE_SIZE

# Indices in the numbers; the packed parameters of the inverse follow.
DT, LOW, HIGH, OFFSET, EASING, DURATION, SLEW = range(7)
SETTINGS = 7

#: Ticks of the reference that an inverse is simulated with before its use, so that its hysteresis
#: has the history of the previous one.
HISTORY = 1000

# Limits beyond the range of any actuator, at which the arithmetic does not overflow.
_ABSURD, _ABSURD_RATE = 1e3, 1e9


@inline_jit
def condition(given: Motion, state: FloatArray, offset: float, ticks: float, dt: float) -> Motion:
    """Refer the reference to the rest position, with a smooth start over the first `ticks`.

    Values that are not finite or out of range are replaced by the last displacement at rest.
    """
    d, v, a = given
    if not (abs(d) < _ABSURD and abs(v) < _ABSURD_RATE and abs(a) < _ABSURD_RATE):
        d, v, a = state[_LAST], 0.0, 0.0
        state[REFUSED] += 1.0
    state[_LAST] = d
    d -= offset
    s = state[_TICK] / ticks if ticks > 0.0 else 1.0
    if s < 1.0:
        gain, rate, bend = smooth_step(s)
        rate /= ticks * dt
        bend /= (ticks * dt) ** 2
        a = bend * d + 2.0 * rate * v + gain * a
        v = rate * d + gain * v
        d = gain * d
        state[_TICK] += 1.0
    return Motion(d, v, a)


@functools.cache
def stepping(run: Run) -> tuple[Callable[..., float], Callable[..., None]]:
    """Return the kernel of a link, and that of arrays without a transition.

    ``step(given, received, memory, numbers)`` returns `received` plus the voltage of the inverse
    [V]; ``over(reference, voltage, memory, numbers)`` fills the voltages of rows of displacement,
    velocity and acceleration.
    """

    @jit
    def over(
        reference: FloatArray, voltage: FloatArray, memory: FloatArray, numbers: FloatArray
    ) -> None:
        dt, state, own, p = numbers[DT], memory[:FADING], memory[OWN:], numbers[SETTINGS:]
        for k in range(voltage.size):
            given = Motion(reference[k, 0], reference[k, 1], reference[k, 2])
            at = condition(given, state, numbers[OFFSET], numbers[EASING], dt)
            voltage[k] = run(at, own, p, dt, numbers[LOW], numbers[HIGH])

    @jit
    def step(given: FloatArray, received: float, memory: FloatArray, numbers: FloatArray) -> float:
        row, answer = scratch((1, 3)), scratch(1)
        row[0, 0], row[0, 1], row[0, 2] = given[1], given[2], given[3]
        over(row, answer, memory, numbers)
        changing, slew = memory[FADING:OWN], numbers[SLEW]
        return received + fade(answer[0], changing, numbers[DT], numbers[DURATION], slew)

    return step, over


#: ``pack(values, p, own, dt, first)`` fills the packed parameters `p` from the values of `reads`,
#: and converts the memory `own` unless `first`; it returns OK, or IMPOSSIBLE with both unchanged.
Pack = Callable[[FloatArray, FloatArray, FloatArray, float, bool], int]


def _constant() -> Pack:
    """Return the packing of a law whose parameters are constants in the code."""

    @inline_jit
    def pack(values: FloatArray, p: FloatArray, own: FloatArray, dt: float, first: bool) -> int:
        return OK

    return pack


class InverseLink(CompiledLink):
    """Base of the feedforward links; the first of a chain.

    Subclasses define `counter_names`, their kernel, the size of its memory and how their
    parameters are packed.

    Parameters
    ----------
    parameters : mapping of str to float
        Parameters of the model to invert, by name, in SI units.
    dt : float
        Sampling interval [s].
    limits : Limits, optional
        Range of the plant voltage [V]; the memory of the inverse follows the limited voltage, so
        that a reference beyond the stroke does not corrupt the hysteresis.
    start : float
        Duration of the smooth start from the rest position [s].
    transition : float
        Duration of the transition after a change of the parameters [s].

    Raises
    ------
    CompensationError
        If the model cannot be inverted.
    """

    counter_names: tuple[str, ...] = ('clamped_slopes', 'out_of_stroke')
    memory_size: int = 8
    #: Kernel of the inverse.
    run: Any
    pack: Any = None
    #: Parameters that `pack` takes, in order, 0 where they are missing; how many numbers they
    #: become; which of them is the gain, whose sign a running inverse keeps.
    reads: tuple[str, ...] = ()
    packed_size, leading = 0, 0
    live: tuple[str, ...] = ()  # parameters that can change in C; the others are constants

    def __init__(
        self,
        parameters: Mapping[str, float],
        dt: float,
        *,
        limits: Limits | None = None,
        start: float = 0.5,
        transition: float = 0.2,
    ) -> None:
        if not (math.isfinite(dt) and dt > 0):
            raise CompensationError(f'the sampling interval must be positive, got {dt:g} s')
        self.dt = dt
        bound = Limits(-math.inf, math.inf, math.inf) if limits is None else limits
        self._parameters = dict(parameters)
        packed = self._packed(self._parameters, None)
        offset = float(self._parameters.get('offset', 0.0))
        ease = float(round(start / dt))
        settings = (dt, bound.low, bound.high, offset, ease, transition, bound.slew)
        numbers = np.concatenate([settings, packed])
        step, self._over = stepping(self.run)
        super().__init__(step, numbers, OWN + self.memory_size)
        self.reset()

    @property
    def packed(self) -> FloatArray:
        """Packed parameters, as the kernel reads them."""
        return self.numbers[SETTINGS:]

    @property
    def parameters(self) -> dict[str, float]:
        """Current parameters by name."""
        return dict(self._parameters)

    def compiled(self, names: Sequence[str] = ()) -> CompiledLaw:
        """Return its kernels; the parameters of the model, in the order of `names`, may change."""
        rest, count = self.initial_memory(), len(names)
        place = {name: k for k, name in enumerate(names)}
        at = np.array([place.get(name, -1) for name in self.reads], np.int64)
        offset, pack, size = place.get('offset', -1), self.pack or _constant(), len(self.reads)
        at_rest, changes = not np.any(rest), bool(place.keys() & set(self.live))
        if rest.size == 0:
            rest = np.zeros(1)

        @inline_jit
        def reset(memory: FloatArray, numbers: FloatArray) -> None:
            for k in range(memory.size):
                memory[k] = 0.0 if at_rest or k < OWN else rest[k - OWN]
            reset_fade(memory[FADING:OWN])

        @inline_jit
        def take(
            values: FloatArray, bounds: FloatArray, memory: FloatArray, numbers: FloatArray,
            first: bool,
        ) -> int:  # fmt: skip
            if changes:
                before = scratch(numbers.size)
                for k in range(numbers.size):
                    before[k] = numbers[k]
                own = scratch(size)
                for k in range(size):
                    own[k] = values[at[k]] if at[k] >= 0 else 0.0
                code = int(pack(own, numbers[SETTINGS:], memory[OWN:], numbers[DT], first))
                if code != OK:
                    return code
                if offset >= 0:
                    numbers[OFFSET] = values[offset]
                moved = before[OFFSET] != numbers[OFFSET]
                for k in range(SETTINGS, numbers.size):
                    moved = moved or before[k] != numbers[k]
                if moved and not first:
                    begin_fade(memory[FADING:OWN])
            numbers[EASING] = float(round(values[count] / numbers[DT]))
            numbers[DURATION] = values[count + 1]
            numbers[LOW], numbers[HIGH], numbers[SLEW] = bounds[0], bounds[1], bounds[2]
            return OK

        settable = (
            ('start', float(self.numbers[EASING] * self.dt)),
            ('transition', float(self.numbers[DURATION])),
        )
        return CompiledLaw('feedforward', self.kernel, reset, take, settable)

    def respond(
        self,
        displacement: FloatArray,
        velocity: FloatArray | None = None,
        acceleration: FloatArray | None = None,
    ) -> FloatArray:
        """Return the voltage [V] for a whole reference from rest, without changing the link.

        The result is bitwise that of stepping a link after a reset.

        Parameters
        ----------
        displacement : ndarray, shape (n,)
            Reference [m].
        velocity, acceleration : ndarray, shape (n,), optional
            Its analytic derivatives [m/s], [m/s^2]; default 0, which is correct only for inverses
            that do not use them.
        """
        reference = np.zeros((len(displacement), 3))
        for place, column in enumerate((displacement, velocity, acceleration)):
            if column is not None:
                reference[:, place] = column
        voltage, memory = np.empty(len(reference)), np.zeros(self.memory.size)
        memory[OWN:] = self.initial_memory()
        self._over(reference, voltage, memory, self.numbers)
        return voltage

    def set_parameters(self, parameters: Mapping[str, float]) -> None:
        """Change parameters at run time; the output changes smoothly.

        Parameters
        ----------
        parameters : mapping of str to float
            New values by name; the others are unchanged.

        Raises
        ------
        CompensationError
            If the new set cannot be inverted; the previous one is kept.
        """
        merged = {**self._parameters, **parameters}
        packed = self._packed(merged, self.packed)
        self.numbers = np.concatenate([self.numbers[:SETTINGS], packed])
        self._parameters = merged
        self.numbers[OFFSET] = float(merged.get('offset', 0.0))
        begin_fade(self.memory[FADING:OWN])

    def follow(self, past: Iterable[ReferencePoint]) -> None:
        """Take the memory that the last points of a running reference leave."""
        self.reset()
        self.memory[_TICK] = self.numbers[EASING]
        reference = np.array([point[1:4] for point in past], dtype=np.float64).reshape(-1, 3)
        self._over(reference, np.empty(len(reference)), self.memory, self.numbers)

    def counters(self) -> dict[str, int]:
        """Return the error counters by name."""
        own = self.memory[OWN : OWN + len(self.counter_names)]
        counts = {name: int(n) for name, n in zip(self.counter_names, own, strict=True)}
        counts['refused_references'] = int(self.memory[REFUSED])
        return counts

    def reset(self) -> None:
        """Reset the memory; the parameters are kept."""
        self.memory[:FADING] = 0.0
        self.memory[OWN:] = self.initial_memory()
        reset_fade(self.memory[FADING:OWN])

    @property
    def own(self) -> FloatArray:
        """Memory of the inverse itself."""
        return self.memory[OWN:]

    def initial_memory(self) -> FloatArray:
        """Return the memory of the inverse itself at rest."""
        return np.zeros(self.memory_size)

    def _packed(self, parameters: Mapping[str, float], before: FloatArray | None) -> FloatArray:
        """Return the packed parameters; a memory that runs with those `before` is converted."""
        values, first = np.array(self._values(parameters)), before is None
        packed = np.zeros(self.packed_size) if before is None else before.copy()
        own = np.zeros(self.memory_size) if before is None else self.own
        if self.pack(values, packed, own, self.dt, first) != OK:
            raise CompensationError(
                self._reason(values)
                or f'{self.reads[self.leading]} = {values[self.leading]:g} m/V would reverse the '
                'voltage of a running inverse; load the model anew'
            )
        return packed

    def _values(self, parameters: Mapping[str, float]) -> list[float]:
        """Return the values of `reads`; refuse those that are missing or no numbers."""
        raise NotImplementedError

    def _reason(self, values: FloatArray) -> str:
        """Return why `pack` refuses `values`, '' if it does so only while it runs."""
        raise NotImplementedError


def take(parameters: Mapping[str, float], required: tuple[str, ...], what: str) -> list[float]:
    """Return the `required` parameters in order."""
    missing = [name for name in required if name not in parameters]
    if missing:
        raise CompensationError(
            f'{what} needs the parameter(s) {", ".join(missing)}; identify a model that has them'
        )
    bad = [name for name in required if not math.isfinite(parameters[name])]
    if bad:
        raise CompensationError(f'{what}: {", ".join(bad)} must be finite; identify again')
    return [float(parameters[name]) for name in required]
