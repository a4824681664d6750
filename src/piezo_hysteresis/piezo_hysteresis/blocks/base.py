"""Definition of a block: a typed, compiled element of a model with an explicit state.

A block is one compiled recursion ``kernel(x, y, state, p, dt, frequency)`` that reads the input
``x``, writes the output ``y`` of the same length and updates ``state`` in place. A whole record is
one call, one sample is a call of length one; the results are bitwise equal.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.common.cached_property import cached_property
from piezo_hysteresis.errors import ModelError

Kernel = Callable[[FloatArray, FloatArray, FloatArray, FloatArray, float, float], None]
Regressors = Callable[[FloatArray, FloatArray, FloatArray, FloatArray], None]
Restoring = Callable[[FloatArray, float, float, float, float], tuple[float, float]]
Along = Callable[[FloatArray, FloatArray, FloatArray, FloatArray, float, float, int], None]


class Slot(StrEnum):
    """Where in the chain a block belongs; the chain is ordered by slot."""

    INPUT = 'input'
    HYSTERESIS = 'hysteresis'  # a block whose default output is 0 is added to the others
    STRUCTURE = 'structure'
    SLOW = 'slow'
    SENSOR = 'sensor'
    ADDED = 'added'  # functions of time: state[0] is the time of the first sample [s]


class InterSample(StrEnum):
    """Intersample behaviour of a block; it determines how a chain is simulated.

    A signal is held over a tick until a block with continuous dynamics (LINEAR, INNER, CLOCK);
    from there on the chain is simulated on the path between the ticks.
    """

    INSTANT = 'instant'  # a function of the input at the same instant
    PATH = 'path'  # a rate-independent function of the path of the input
    LINEAR = 'linear'  # a linear system with a state, see `Block.system`
    INNER = 'inner'  # has own dynamics with a held input: an `InnerMode`, or a limit of the rate
    CLOCK = 'clock'  # adds or multiplies by a function of time; its last state counts the samples
    DELAY = 'delay'  # the input later
    TICK = 'tick'  # a recursion from tick to tick: samples its input and holds its output


class InverseRole(StrEnum):
    """Role of a block in an inverse in closed form; chains of other blocks are solved numerically.

    The names are those of `compensation.inverses`.
    """

    EXACT = 'exact'  # Bouc-Wen by its exact step
    EULER = 'euler'  # Bouc-Wen by the papers' step
    MODIFIED = 'modified'  # Bouc-Wen with the terms of Fang 2019, solved numerically
    PLAYS = 'plays'  # a bank of plays whose weights are solved segment by segment
    GAIN = 'gain'
    RECURSION = 'recursion'  # an autoregression of the displacement
    OSCILLATOR = 'oscillator'  # the hysteresis is in the restoring force
    SELECTOR = 'selector'  # the law itself is from displacement to voltage
    STRUCTURE = 'structure'  # one mode, inverted on the derivatives of the reference
    ZERO = 'zero'  # a constant of the reading


class System(NamedTuple):
    """A linear system ``x' = a x + b u, y = c x + d u`` with one input and one output.

    Attributes
    ----------
    a : ndarray, shape (n, n)
        Dynamics [1/s].
    b, c : ndarray, shape (n,)
        Input and output.
    d : float
        Feedthrough.
    """

    a: FloatArray
    b: FloatArray
    c: FloatArray
    d: float


class InnerMode(NamedTuple):
    """The mode of an INNER block with inertia.

    Attributes
    ----------
    pace : callable
        ``pace(p)`` returns its fastest rate [1/s].
    restoring : callable or None
        ``restoring(p, x, before, memory, dt)``, compiled, returns the force on the mode in
        addition to its linear spring, in metres of static displacement, at `x` [m] after `before`
        [m], and its memory. None if the spring is linear, or the block has an inverse of its own.
    """

    pace: Callable[[FloatArray], float]
    restoring: Restoring | None = None


@dataclass(frozen=True)
class Parameter:
    """One parameter of a block.

    Attributes
    ----------
    name : str
        The field's standard name, as in the papers (``A1``, ``beta``, ``natural_frequency``).
    unit : str
        SI unit, ``1`` for dimensionless parameters.
    default : float
        Default value.
    low, high : float
        Physical bounds of fits and of loaded values.
    description : str
        One sentence.
    scale : float
        Typical size, used to scale the parameter in fits.
    powers : tuple of int, or None
        Powers of the input and displacement amplitudes with which default and scale grow; None:
        from the unit (V, m).
    follows_range : bool
        Whether it is held at a value proportional to the amplitudes (the range of thresholds).
    """

    name: str
    unit: str
    default: float
    low: float
    high: float
    description: str
    scale: float = 1.0
    powers: tuple[int, int] | None = None
    follows_range: bool = False

    @property
    def held(self) -> bool:
        """Whether the bounds coincide, so that it is not fitted."""
        return self.low == self.high


@dataclass(frozen=True)
class Block:
    """An immutable element of a model; its state is an array owned by the caller.

    Attributes
    ----------
    name : str
        Unique name, used in model files.
    slot : Slot
        Its position in the chain.
    parameters : tuple of Parameter
        In the order of the kernel.
    description : str
        One sentence on the physics of the block.
    source : str
        Paper and equation.
    kernel : callable or None
        ``kernel(x, y, state, p, dt, frequency)``, compiled; `frequency` is the fundamental
        frequency of the excitation [Hz], 0 if there is none. It takes one number per tick, held
        over it, and returns the output at the end of the tick, or with inertia at its start. None
        if `path_kernel` with one point per tick is equivalent.
    state_size : callable or int
        Length of the state, or a function of dt that gives it (delays); that of `system` if given.
    between : InterSample
        Its intersample behaviour.
    path_kernel : callable or None
        ``path_kernel(x, y, state, p, dt, frequency, points)``, compiled: the output along a path
        of `points` values per tick, three per step: at its start, middle and end; of a PATH block
        also one value per tick. Required for every INNER block, and for every PATH block that
        depends on ticks or steps.
    system : callable or None
        ``system(p)`` returns the continuous system of a LINEAR block, or the gain of a linear
        INSTANT one; its states are those of the kernel.
    mode : InnerMode or None
        The mode of an INNER block; None for a limit of the rate, whose path has a corner.
    unknown : tuple of int
        Indices of states that are unknown if a record starts in motion, and whose effect decays:
        the memory of a hysteresis, position and velocity. All states of a LINEAR block are.
    check : callable or None
        ``check(values)`` returns '' or the reason why these parameters are incompatible.
    role : InverseRole or None
        Its role in an inverse in closed form.
    regressors : callable or None
        ``regressors(x, rows, state, p)``, compiled: the regressors of the output, if every
        parameter but the first is a weight.
    """

    name: str
    slot: Slot
    parameters: tuple[Parameter, ...]
    description: str
    source: str = ''
    kernel: Kernel | None = None
    state_size: int | Callable[[float], int] = 0
    between: InterSample = InterSample.TICK
    path_kernel: Along | None = None
    system: Callable[[FloatArray], System] | None = None
    mode: InnerMode | None = None
    unknown: tuple[int, ...] = ()
    check: Callable[[Mapping[str, float]], str] | None = None
    role: InverseRole | None = None
    regressors: Regressors | None = None

    @cached_property
    def _usual(self) -> System | None:
        """Linear system at the defaults; its structure is that at all parameters."""
        if self.system is None:
            return None
        return self.system(np.array([each.default for each in self.parameters]))

    @cached_property
    def inertia(self) -> bool:
        """Whether it has inertia: its position at a tick does not depend on that tick's input."""
        if self.between is InterSample.INNER:
            return self.mode is not None
        own = self._usual
        return own is not None and own.b.size > 1 and own.d == 0.0 and float(own.c @ own.b) == 0.0

    @cached_property
    def monotonic(self) -> bool:
        """Whether it approaches a held input monotonically and continuously: a lag, a limit."""
        if self.between is InterSample.INNER:
            return self.mode is None
        own = self._usual
        return own is not None and own.b.size == 1 and own.d == 0.0

    @property
    def in_parallel(self) -> bool:
        """Whether its output is added to that of the hysteresis, which has the same input."""
        return self.slot is Slot.HYSTERESIS and not any(
            each.default for each in self.parameters if not each.follows_range
        )

    @property
    def is_tone(self) -> bool:
        """Whether it adds a function of the time of the record, independent of the drive."""
        return self.slot is Slot.ADDED and self.between is InterSample.CLOCK

    def initial_state(self, dt: float, start: float = 0.0) -> FloatArray:
        """Return the state of the block at rest, shape (state_size,).

        Parameters
        ----------
        dt : float
            Sampling interval [s].
        start : float
            Time of the first sample [s]; used by ADDED blocks only.
        """
        size = self.state_size if isinstance(self.state_size, int) else self.state_size(dt)
        if self._usual is not None:
            size = self._usual.b.size
        state = np.zeros(size)
        if self.slot is Slot.ADDED and size:
            state[0] = start
        return state

    def unknown_states(self, dt: float, *, memory: bool = True) -> tuple[int, ...]:
        """Return the indices of states that are unknown for an actuator in motion.

        Parameters
        ----------
        dt : float
            Sampling interval [s].
        memory : bool
            False omits states that follow from known extremes of the input.
        """
        if self.between is InterSample.LINEAR:
            return tuple(range(self.initial_state(dt).size))
        return () if self.between is InterSample.PATH and not memory else self.unknown

    @property
    def has_memory(self) -> bool:
        """Whether it has a memory that follows from the extremes of its input before a record."""
        return self.between is InterSample.PATH

    @property
    def needs_levels(self) -> bool:
        """Whether it has a memory that the states `unknown` do not contain."""
        return self.has_memory and not self.unknown

    def defaults(self) -> dict[str, float]:
        """Return the default of every parameter."""
        return {parameter.name: parameter.default for parameter in self.parameters}

    def pack(self, values: Mapping[str, float]) -> FloatArray:
        """Return `values` in the order of the kernel; missing ones take their default.

        Raises
        ------
        ModelError
            If a value is outside its bounds or not finite, or the combination is invalid.
        """
        known = {parameter.name for parameter in self.parameters}
        stray = sorted(set(values) - known)
        if stray:
            raise ModelError(
                f'block {self.name} has no parameter {", ".join(stray)}; '
                f'it has {", ".join(sorted(known))}'
            )
        packed = np.array([float(values.get(q.name, q.default)) for q in self.parameters])
        for parameter, value in zip(self.parameters, packed, strict=True):
            if not (parameter.low <= value <= parameter.high):
                raise ModelError(
                    f'{self.name}.{parameter.name} = {value:g} {parameter.unit} is '
                    f'outside {parameter.low:g} .. {parameter.high:g}'
                )
        if self.check is not None:
            reason = self.check(dict(zip((q.name for q in self.parameters), packed, strict=True)))
            if reason:
                raise ModelError(f'block {self.name}: {reason}')
        return packed

    def respond(
        self,
        signal: FloatArray,
        values: FloatArray,
        dt: float,
        *,
        state: FloatArray,
        frequency: float = 0.0,
    ) -> FloatArray:
        """Return the output for a whole signal, shape (n,), updating `state` in place."""
        output, drive = np.empty_like(signal), float(frequency)  # one signature only
        if self.kernel is not None:
            self.kernel(signal, output, state, values, dt, drive)
        else:
            assert self.path_kernel is not None
            self.path_kernel(signal, output, state, values, dt, drive, 1)
        return output
