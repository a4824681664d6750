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
from piezo_hysteresis.errors import ModelError

Kernel = Callable[[FloatArray, FloatArray, FloatArray, FloatArray, float, float], None]
Tuned = Callable[[Mapping[str, float], Mapping[str, float]], dict[str, float]]
Regressors = Callable[[FloatArray, FloatArray, FloatArray, FloatArray], None]
Restoring = Callable[[FloatArray, float, float, float, float], tuple[float, float]]
Along = Callable[[FloatArray, FloatArray, FloatArray, FloatArray, float, float, int], None]


class Slot(StrEnum):
    """Where in the chain a block belongs; the chain is ordered by slot."""

    INPUT = 'input'
    HYSTERESIS = 'hysteresis'
    STRUCTURE = 'structure'
    SLOW = 'slow'
    SENSOR = 'sensor'
    ADDED = 'added'


class InterSample(StrEnum):
    """Intersample behaviour of a block; it determines how a chain is simulated.

    A signal is held over a tick until a block with continuous dynamics (LINEAR, INNER, CLOCK);
    from there on the chain is simulated on the path between the ticks.
    """

    INSTANT = 'instant'  # a function of the input at the same instant
    PATH = 'path'  # a rate-independent function of the path of the input
    LINEAR = 'linear'  # a linear system with a state, see `Block.system`
    INNER = 'inner'  # has own dynamics with a held input, see `Block.path_kernel`
    CLOCK = 'clock'  # adds or multiplies by a function of time
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
    kernel : callable or None
        ``kernel(x, y, state, p, dt, frequency)``, compiled; `frequency` is the fundamental
        frequency of the excitation [Hz], 0 if there is none. None if `path_kernel` with one point
        per tick is equivalent.
    state_size : callable or int
        Length of the state, or a function of dt that gives it (delays).
    description : str
        One sentence on the physics of the block.
    source : str
        Paper and equation.
    check : callable or None
        ``check(values)`` returns '' or the reason why these parameters are incompatible.
    phased : bool
        Whether it follows the phase of a drive that started at time 0; ``state[0]`` is then the
        time of the first sample [s].
    clocked : bool
        Whether ``state[0]`` is the time [s] of the first sample, for blocks that depend on it.
    in_parallel : bool
        Whether the block is connected in parallel with the hysteresis of a model and not in
        series: it has the same input, and its output is added.
    parts : tuple of Block
        The parallel blocks of this one; empty for a single block.
    between : InterSample
        Its intersample behaviour. The kernel takes one number per tick, held over it, and returns
        the output at the end of the tick, or with inertia at its start.
    inertia : bool
        Whether it has inertia: its position at a tick does not depend on the input of that tick.
    system : callable or None
        ``system(p)`` returns the continuous system of a LINEAR block, or the gain of a linear
        INSTANT one; its states are those of the kernel.
    path_kernel : callable or None
        ``path_kernel(x, y, state, p, dt, frequency, points)``, compiled: the output along a path
        of `points` values per tick, three per step: at its start, middle and end; of a PATH block
        also one value per tick. Required for every INNER block, and for every PATH block that
        depends on ticks or steps.
    monotonic : bool
        Whether it approaches a held input monotonically and continuously: a lag (LINEAR), or a
        rate limit (INNER), whose path has a corner.
    pace : callable or None
        ``pace(p)`` returns the fastest rate [1/s] at which an INNER block moves.
    count : int or None
        Index of the sample counter in the state of a CLOCK block.
    joins : callable or None
        ``joins(p)`` returns how the block interpolates a measured input between ticks: 0 held, 1
        linear, 2 band-limited.
    step_bound : bool
        Whether its step is the sampling interval (forward Euler, first order).
    unknown : tuple of int
        Indices of states that are unknown if a record starts in motion, and whose effect decays:
        the memory of a hysteresis, position and velocity. All states of a LINEAR block are.
    tuned : callable or None
        ``tuned(values, mode)`` returns the parameters of a differently parametrised mode for the
        ``natural_frequency`` [Hz] and ``damping_ratio`` in `mode`; missing ones are unchanged.
    part : Part or None
        Its role in an inverse in closed form.
    predictor : tuple of str
        Parameters that multiply the measurements one, two, ... samples ago in a prediction; '' is
        the factor 1.
    restoring : callable or None
        ``restoring(p, x, before, memory, dt)``, compiled, returns the force on a mode in addition
        to its linear spring, in metres of static displacement, at `x` [m] after `before` [m], and
        its memory.
    regressors : callable or None
        ``regressors(x, rows, state, p)``, compiled: the regressors of the output, if every
        parameter but the first is a weight.
    """

    name: str
    slot: Slot
    parameters: tuple[Parameter, ...]
    state_size: int | Callable[[float], int]
    description: str
    kernel: Kernel | None = None
    source: str = ''
    check: Callable[[Mapping[str, float]], str] | None = None
    clocked: bool = False
    phased: bool = False
    in_parallel: bool = False
    parts: tuple[Block, ...] = ()
    between: InterSample = InterSample.TICK
    inertia: bool = False
    system: Callable[[FloatArray], System] | None = None
    path_kernel: Along | None = None
    monotonic: bool = False
    pace: Callable[[FloatArray], float] | None = None
    count: int | None = None
    joins: Callable[[FloatArray], float] | None = None
    step_bound: bool = False
    unknown: tuple[int, ...] = ()
    tuned: Tuned | None = None
    part: InverseRole | None = None
    predictor: tuple[str, ...] = ()
    restoring: Restoring | None = None
    regressors: Regressors | None = None

    def initial_state(self, dt: float, start: float = 0.0) -> FloatArray:
        """Return the state of the block at rest, shape (state_size,).

        Parameters
        ----------
        dt : float
            Sampling interval [s].
        start : float
            Time of the first sample [s]; used by clocked and phased blocks only.
        """
        size = self.state_size if isinstance(self.state_size, int) else self.state_size(dt)
        state = np.zeros(size)
        if self.clocked or self.phased:
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
        if self.between is InterSample.PATH and not memory:
            return ()
        places, first = [], 0
        for part in self.parts:
            places += [first + place for place in part.unknown_states(dt, memory=memory)]
            first += part.initial_state(dt).size
        return (*self.unknown, *places)

    @property
    def has_memory(self) -> bool:
        """Whether it has a memory that follows from the extremes of its input before a record."""
        if self.parts:
            return any(part.has_memory for part in self.parts)
        return self.between is InterSample.PATH

    @property
    def needs_levels(self) -> bool:
        """Whether it has a memory that the states `unknown` do not contain."""
        if self.parts:
            return any(part.needs_levels for part in self.parts)
        return self.between is InterSample.PATH and not self.unknown

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
