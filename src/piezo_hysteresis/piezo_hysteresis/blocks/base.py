"""What a block is: a typed, compiled piece of a model with an explicit memory.

A block is one compiled recursion ``kernel(x, y, state, p, dt, frequency)`` that reads the input
``x``, writes the output ``y`` of the same length and updates ``state`` in place. A whole record is
one call, one sample is a call of length one: both give the same bits because they are the same
code.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks._counterpart import Counterpart
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


class Between(StrEnum):
    """What a block makes of its input between two ticks; a chain is run accordingly.

    A signal is held over a tick until a block of one of the moving kinds (LINEAR, INNER, CLOCK)
    stands in its way; from there on the chain runs on the path between the ticks.
    """

    INSTANT = 'instant'  # a function of the input at the same instant
    PATH = 'path'  # a function of the path of the input, at whatever rate
    LINEAR = 'linear'  # a linear system with a state of its own, see `Block.system`
    INNER = 'inner'  # moves by itself under a held input, see `Block.along`
    CLOCK = 'clock'  # adds or multiplies by a function of the time
    DELAY = 'delay'  # the input later
    TICK = 'tick'  # a recursion from tick to tick: samples its input and holds its answer


class Part(StrEnum):
    """What a block is to an inverse in closed form; chains of other blocks are solved numerically.

    Named after what `compensation.inverses` does with it.
    """

    EXACT = 'exact'  # Bouc-Wen by its exact step
    EULER = 'euler'  # Bouc-Wen by the papers' step
    MODIFIED = 'modified'  # Bouc-Wen with the terms of Fang 2019, solved numerically
    PLAYS = 'plays'  # a bank of plays whose weights are solved segment by segment
    GAIN = 'gain'
    RECURSION = 'recursion'  # an autoregression of the displacement
    OSCILLATOR = 'oscillator'  # the hysteresis sits in the restoring force
    SELECTOR = 'selector'  # the law itself leads from displacement to voltage
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


class Approach(NamedTuple):
    """How a signal goes to where it is held: by a lag, or no faster than at a rate.

    Attributes
    ----------
    time : float
        Time constant [s]; 0 where a rate rules.
    most : float
        Largest rate [1/s]; infinite where there is none.
    """

    time: float
    most: float


@dataclass(frozen=True)
class Parameter:
    """One number of a block.

    Attributes
    ----------
    name : str
        The field's standard name, as in the papers (``A1``, ``beta``, ``natural_frequency``).
    unit : str
        SI unit, ``1`` where there is none.
    default : float
        Value used where nothing better is known.
    low, high : float
        Bounds of what is physically possible; fits stay inside, loading refuses what is outside.
    description : str
        One sentence.
    scale : float
        Typical size, by which fits scale the parameter.
    powers : tuple of int, or None
        Powers of the input and of the displacement amplitude by which default and scale grow;
        read off the unit (V, m) where it is None.
    follows_range : bool
        Held at a value that grows with the amplitudes (the range that thresholds refer to).
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
        """Whether the bounds leave it no room, so that fits leave it alone."""
        return self.low == self.high


@dataclass(frozen=True)
class Block:
    """One immutable piece of a model; its memory is an array that the caller holds.

    Attributes
    ----------
    name : str
        Unique name, used in model files.
    slot : Slot
        Its place in the chain.
    parameters : tuple of Parameter
        In the order in which the kernel reads them.
    kernel : callable or None
        ``kernel(x, y, state, p, dt, frequency)``, compiled; `frequency` is the fundamental
        frequency of the excitation [Hz], 0 where there is none. None where `along` at one point
        per tick says the same.
    state_size : callable or int
        Length of the state, or a function of dt that gives it (delays).
    description : str
        One sentence on what the block does physically.
    source : str
        Paper and equation.
    check : callable or None
        ``check(values)`` returns '' or the reason why these parameters are impossible together.
    phased : bool
        Whether it follows the phase of a drive that began at time 0; ``state[0]`` is the time
        of the first sample then [s].
    clocked : bool
        Whether ``state[0]`` is the time [s] of the first sample, for blocks that depend on it.
    beside : bool
        Whether the block belongs beside the hysteresis of a model and not behind it: it answers
        the same voltage, and its answer is added.
    parts : tuple of Block
        The blocks that stand side by side in this one; empty for a single block.
    between : Between
        What it makes of its input between the ticks. The kernel takes one number per tick, held
        over it, and answers at the end of the tick, or where there is inertia at its start.
    inertia : bool
        Whether it is a mass: its position at a tick knows nothing of the input of that tick.
    system : callable or None
        ``system(p)`` returns the continuous system of a LINEAR block, or the gain of a linear
        INSTANT one; its states are those of the kernel.
    along : callable or None
        ``along(x, y, state, p, dt, frequency, points)``, compiled: the answer along a path of
        `points` values per tick, three to each step: at its start, in its middle, at its end; of
        a PATH block also one value per tick.
        Every INNER block has one, and every PATH block that wants to know the tick or a jump.
    approach : callable or None
        ``approach(p)`` returns how it approaches a held input, where that is monotonic and without
        a jump.
    pace : callable or None
        ``pace(p)`` returns the fastest rate [1/s] at which an INNER block moves.
    least_steps : int
        Steps per tick that its path needs at least; more where it has corners.
    count : int or None
        Place in the state of a CLOCK block of the number of samples so far.
    joins : callable or None
        ``joins(p)`` returns how the block takes its input to go from tick to tick where that is
        measured and not commanded: 0 held, 1 joined by lines, 2 band-limited.
    step_bound : bool
        Whether its step is that of the samples (forward Euler): right to first order only.
    unknown : tuple of int
        Places in the state that nothing tells where a record begins in motion, and that die out
        by themselves: the one number in which a memory is kept, position and velocity. All of a
        LINEAR block's are.
    tuned : callable or None
        ``tuned(values, mode)`` returns the parameters of a mode of other parameters for the
        ``natural_frequency`` [Hz] and ``damping_ratio`` in `mode`; what is not there stays.
    part : Part or None
        What it is to an inverse in closed form.
    predictor : tuple of str
        Parameters by which it predicts from what was measured one, two, ... samples ago; ''
        stands for the factor 1.
    restoring : callable or None
        ``restoring(p, x, before, memory, dt)``, compiled, returns the force that acts back on a
        mode beside its linear spring, in metres of static displacement, at `x` [m] after
        `before` [m], and its memory.
    regressors : callable or None
        ``regressors(x, rows, state, p)``, compiled: the signals whose weighted sum the answer is,
        where every parameter but the first is a weight.
    counterpart : callable or None
        ``counterpart(values)`` returns the parameters of the simulator node that mean the same;
        besides its own values it gets the gain ``A1`` of the model, where there is one.
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
    between: Between = Between.TICK
    inertia: bool = False
    system: Callable[[FloatArray], System] | None = None
    along: Along | None = None
    approach: Callable[[FloatArray], Approach] | None = None
    pace: Callable[[FloatArray], float] | None = None
    least_steps: int = 8
    count: int | None = None
    joins: Callable[[FloatArray], float] | None = None
    step_bound: bool = False
    unknown: tuple[int, ...] = ()
    tuned: Tuned | None = None
    part: Part | None = None
    predictor: tuple[str, ...] = ()
    restoring: Restoring | None = None
    regressors: Regressors | None = None
    counterpart: Counterpart | None = field(default=None, compare=False)

    def initial_state(self, dt: float, start: float = 0.0) -> FloatArray:
        """Return the memory of the block at rest, shape (state_size,).

        Parameters
        ----------
        dt : float
            Sampling interval [s].
        start : float
            Time of the first sample [s]; matters to clocked and phased blocks only.
        """
        size = self.state_size if isinstance(self.state_size, int) else self.state_size(dt)
        state = np.zeros(size)
        if self.clocked or self.phased:
            state[0] = start
        return state

    def unknown_states(self, dt: float, *, memory: bool = True) -> tuple[int, ...]:
        """Return the places in its state that an actuator in motion begins with.

        Parameters
        ----------
        dt : float
            Sampling interval [s].
        memory : bool
            False leaves out what the extremes of its input tell, where these are known.
        """
        if self.between is Between.LINEAR:
            return tuple(range(self.initial_state(dt).size))
        if self.between is Between.PATH and not memory:
            return ()
        places, first = [], 0
        for part in self.parts:
            places += [first + place for place in part.unknown_states(dt, memory=memory)]
            first += part.initial_state(dt).size
        return (*self.unknown, *places)

    @property
    def has_memory(self) -> bool:
        """Whether it has a memory that extremes of its input before a record tell."""
        if self.parts:
            return any(part.has_memory for part in self.parts)
        return self.between is Between.PATH

    @property
    def needs_levels(self) -> bool:
        """Whether it has a memory that no state of `unknown` tells."""
        if self.parts:
            return any(part.needs_levels for part in self.parts)
        return self.between is Between.PATH and not self.unknown

    def defaults(self) -> dict[str, float]:
        """Return every parameter at its default."""
        return {parameter.name: parameter.default for parameter in self.parameters}

    def pack(self, values: Mapping[str, float]) -> FloatArray:
        """Order `values` as the kernel reads them; missing ones take their default.

        Raises
        ------
        ModelError
            If a value is outside its bounds, not finite, or the block refuses the combination.
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
            assert self.along is not None
            self.along(signal, output, state, values, dt, drive, 1)
        return output
