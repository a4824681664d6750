"""Numerical inverse of any chain of blocks, block by block from the reading to the voltage."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Block, InterSample, Restoring, Slot, System
from piezo_hysteresis.compensation.inverses.block_inverse import (
    CLAMPED,
    CORNERS,
    FIRST_SLOPE,
    STATE_SIZE,
    Answer,
    BlockInverse,
    block_inverse,
    carry_ahead,
    from_rest,
    lift_droop,
    packed_block,
)
from piezo_hysteresis.compensation.inverses.inverse_link import OFFSET, InverseLink, Motion, Run
from piezo_hysteresis.compensation.inverses.physical import structure_coefficients
from piezo_hysteresis.compensation.link import Limits
from piezo_hysteresis.errors import CompensationError
from piezo_hysteresis.jit import inline_jit
from piezo_hysteresis.models.chain import Model
from piezo_hysteresis.numerics.linalg import solve_square

# Indices in the parameters: structure, lead, reading at rest; restoring force and blocks follow.
_K1, _K2, _LEAD, REST, _BACK = range(5)
# Indices in the memory: counters, structure, memory of the restoring force, last displacement.
_CLAMPED, _STROKE, STRUCTURE = range(3)
_FORCE = STRUCTURE + STATE_SIZE
_MOVED = _FORCE + 1
_MEMORIES = _MOVED + 1


#: ``through(motion, memory, p, dt)``: blocks in series, applied to a motion.
_Through = Callable[[Motion, FloatArray, FloatArray, float], Motion]


class ChainKernel(NamedTuple):
    """The kernel of an inverse and its memory at rest."""

    run: Run
    start: FloatArray


def chain_kernel(stages: _Stages, dt: float) -> ChainKernel:  # dt [s]
    """Return the inverse of a chain."""
    solved: _Through = _passing
    undone: _Through = _passing
    kept: _Through = _passing
    start, counts = [np.zeros(_MEMORIES)], list[int]()
    memory, numbers = _MEMORIES, _BACK + stages.values.size
    for i, each in enumerate((*stages.front, *stages.back)):
        inverse = block_inverse(each.block, dt, each.joined)
        if i < len(stages.front):
            solved = _before(_plain(inverse.solve, memory, numbers), solved)
            kept = _before(kept, _plain(inverse.commit, memory, numbers))
        else:
            undone = _before(_undo(inverse, memory, numbers), undone)
        counts.append(memory + CLAMPED)
        start.append(inverse.start)
        memory += inverse.start.size
        numbers += each.packed.size
    acting: Any = _nothing_back
    if stages.restoring is not None:
        acting = _acting_back(stages.restoring, stages.values.size)
    return ChainKernel(_whole(undone, solved, kept, acting, counts), np.concatenate(start))


def _whole(
    undone: _Through, solved: _Through, kept: _Through, back: Any, counts: Sequence[int]
) -> Run:
    places = np.array(counts, np.int64)

    @inline_jit
    def run(
        at: Motion, memory: FloatArray, p: FloatArray, dt: float, low: float, high: float
    ) -> float:
        structure = memory[STRUCTURE:_FORCE]
        ahead = carry_ahead(at, structure, p[_LEAD], dt)
        rising = Motion(ahead.displacement + p[REST], ahead.velocity, ahead.acceleration)
        inner = undone(rising, memory, p, dt)
        target = inner.displacement + p[_K1] * inner.velocity + p[_K2] * inner.acceleration
        if p[_LEAD] > 0.0:
            target = lift_droop(target, structure)
        target += back(inner.displacement, memory, p, dt)
        u = solved(Motion(target, 0.0, 0.0), memory, p, dt).displacement
        if u > high or u < low:
            u = min(max(u, low), high)
            memory[_STROKE] += 1.0
        kept(Motion(u, 0.0, 0.0), memory, p, dt)
        total = 0.0
        for k in range(places.size):
            total += memory[places[k]]
        memory[_CLAMPED] = total
        return float(u)

    return run


@inline_jit
def _nothing_back(x: float, memory: FloatArray, p: FloatArray, dt: float) -> float:
    return 0.0


def _acting_back(restoring: Any, count: int) -> Any:
    """Return the restoring force on the mode, to be added to the target at `x` [m]."""
    last = _BACK + count

    @inline_jit
    def back(x: float, memory: FloatArray, p: FloatArray, dt: float) -> float:
        force, memory[_FORCE] = restoring(p[_BACK:last], x, memory[_MOVED], memory[_FORCE], dt)
        memory[_MOVED] = x
        return float(force)

    return back


@inline_jit
def _passing(at: Motion, memory: FloatArray, p: FloatArray, dt: float) -> Motion:
    return at


def _before(one: _Through, other: _Through) -> _Through:
    """Return `one` followed by `other`."""

    @inline_jit
    def through(at: Motion, memory: FloatArray, p: FloatArray, dt: float) -> Motion:
        return other(one(at, memory, p, dt), memory, p, dt)

    return through


def _plain(answer: Answer, place: int, numbers: int) -> _Through:
    """Return a kernel of a block, by its places, as one on a signal without derivatives."""

    @inline_jit
    def through(at: Motion, memory: FloatArray, p: FloatArray, dt: float) -> Motion:
        return Motion(answer(at.displacement, memory[place:], p[numbers:], dt), 0.0, 0.0)

    return through


def _undo(inverse: BlockInverse, place: int, numbers: int) -> _Through:
    """Return the step from the output of a block to its input with both derivatives."""
    solve, commit, shape = inverse.solve, inverse.commit, inverse.shape

    @inline_jit
    def through(at: Motion, memory: FloatArray, p: FloatArray, dt: float) -> Motion:
        own, numbers_of_it = memory[place:], p[numbers:]
        d = solve(at.displacement, own, numbers_of_it, dt)
        slope, bend = shape(d, own, numbers_of_it, dt)
        commit(d, own, numbers_of_it, dt)
        if slope == 0.0:
            slope = numbers_of_it[FIRST_SLOPE]
        v = at.velocity / slope
        return Motion(d, v, (at.acceleration - bend * v * v) / slope)

    return through


class _Solver(NamedTuple):
    """A block to solve: whether its input is linearly interpolated, and its packed values."""

    block: Block
    joined: bool
    packed: FloatArray


@dataclass
class _Stages:
    """Decomposition of a chain for its inverse, from the voltage to the reading."""

    front: list[_Solver] = field(default_factory=list)  # before the dynamic structure
    back: list[_Solver] = field(default_factory=list)  # after it
    k1: float = 0.0  # [s]
    k2: float = 0.0  # [s^2]
    lead: float = 0.0  # [s]
    rest: float = 0.0  # reading at rest [m]
    restoring: Restoring | None = None  # added to the spring of a mode
    values: FloatArray = field(default_factory=lambda: np.zeros(0))

    def packed(self) -> FloatArray:
        """Return the parameters of the kernel."""
        own = [self.k1, self.k2, self.lead, self.rest]
        solvers = (each.packed for each in (*self.front, *self.back))
        return np.concatenate([own, self.values, *solvers])


def _take_apart(model: Model, packed: FloatArray, dt: float, scale: float) -> _Stages:
    stages = _Stages()
    inertia = not model.answers_at_once
    first = 0
    for block in model.blocks:
        own = packed[first : first + len(block.parameters)].copy()
        first += len(block.parameters)
        if block.slot is Slot.ADDED:
            continue
        values = dict(zip((q.name for q in block.parameters), own.tolist(), strict=True))
        if block.between is InterSample.DELAY:
            stages.lead += sum(values.values())
        elif block.slot is Slot.STRUCTURE and block.between in (
            InterSample.LINEAR,
            InterSample.INNER,
        ):
            # sampled at the start of the tick over which the voltage is held, or at its end
            held = 0.5 * dt if inertia else -0.5 * dt
            _take_structure(stages, block, own, values, held)
        else:
            behind = stages.k2 > 0.0 or block.slot in (Slot.SLOW, Slot.SENSOR)
            joined = behind and inertia and block.between is InterSample.LINEAR
            numbers = packed_block(block, own, dt, 1e-4 * scale, joined)
            slope = float(numbers[FIRST_SLOPE])
            above, below = (from_rest(block, numbers, x, dt, joined) for x in (scale, -scale))
            if not (math.isfinite(slope) and slope * (above - below) > 0.0):
                raise CompensationError(
                    f'block {block.name} has slope {slope:g} at rest and does not keep its sign, '
                    'so the model has no inverse; identify with bounds that keep it'
                )
            if inertia and block.monotonic and block.system is not None:
                stages.lead += _end_before_mean(block.system(own), dt)
            (stages.back if behind else stages.front).append(_Solver(block, joined, numbers))
            stages.rest = from_rest(block, numbers, stages.rest, dt, joined)
            scale *= abs(slope)
    return stages


def _take_structure(
    stages: _Stages, block: Block, own: FloatArray, values: Mapping[str, float], held: float
) -> None:
    """Add a block of the dynamic structure; it is inverted by derivatives of the reference.

    The coefficients of several blocks are added: exact for one, accurate to second order in
    frequency over natural frequency for more. `held` is the lead that compensates the hold [s].
    """
    if block.mode is not None and block.mode.restoring is not None:
        stages.restoring, stages.values = block.mode.restoring, own
    # the direct feedthrough past a mode has no lag
    share = 1.0 - block.system(own).d if block.system is not None and not block.inertia else 1.0
    k1, k2 = _inverse_of(block, own, values)
    stages.k1 += k1
    stages.k2 += k2
    stages.lead += share * held


def _end_before_mean(lag: System, dt: float) -> float:
    """Return the lead of the end of a tick over the mean output of a lag in that tick [s].

    If the value at the end of the tick is the target, the mean over the hold leads by this time.
    """
    rate = -float(lag.a[0, 0])
    # dt / (exp(rate dt) - 1) in a form that does not overflow for a fast lag
    return 1.0 / rate + dt * math.exp(-rate * dt) / math.expm1(-rate * dt)


def _inverse_of(block: Block, own: FloatArray, values: Mapping[str, float]) -> tuple[float, float]:
    """Return k1 [s] and k2 [s^2] of the inverse ``v = y + k1 y' + k2 y''`` for slow motion."""
    if block.system is None:
        return structure_coefficients(values)
    a, b, c, d = block.system(own)
    # moments of the response: gain, and its first two derivatives by i omega, over the gain
    once = solve_square(a, b).values
    twice = solve_square(a, once).values
    thrice = solve_square(a, twice).values
    gain = d - float(c @ once)
    first, second = -float(c @ twice) / gain, -float(c @ thrice) / gain
    return -first, first * first - second


class ChainInverse(InverseLink):
    """Feedforward for any model whose displacement rises, or falls, with the voltage.

    From the reading back to the voltage: sensor and slow blocks and the hysteresis are solved
    numerically, sample by sample; modes are inverted on the reference's derivatives; a delay is
    a lead. Added tones are not compensated by the inverse, but by `HarmonicAttenuation`.
    """

    def __init__(
        self,
        model: Model,
        values: Mapping[str, float],
        dt: float,  # [s]
        *,
        scale: float = 1.0,  # [V]
        limits: Limits | None = None,
        start: float = 0.5,
        transition: float = 0.2,
    ) -> None:
        self._model = model
        self._scale = scale
        self._dt = dt
        stages = _take_apart(model, model.pack(values), dt, scale)
        self._kernel = chain_kernel(stages, dt)
        self.run = self._kernel.run
        self.memory_size = self._kernel.start.size
        super().__init__(values, dt, limits=limits, start=start, transition=transition)
        self.numbers[OFFSET] = self.packed[REST]

    def set_parameters(self, parameters: Mapping[str, float]) -> None:
        """Change parameters at run time; the output changes smoothly, the memory is kept."""
        super().set_parameters(parameters)
        self.numbers[OFFSET] = self.packed[REST]

    def _packed(self, parameters: Mapping[str, float], before: FloatArray | None) -> FloatArray:
        packed = self._model.pack(parameters)
        return _take_apart(self._model, packed, self._dt, self._scale).packed()

    def initial_memory(self) -> FloatArray:
        """Return the memory of every block at rest."""
        return self._kernel.start.copy()

    def counters(self) -> dict[str, int]:
        """Return the error counters; ``corners`` counts steps of the slope of the reference."""
        return {**super().counters(), 'corners': int(self.own[STRUCTURE + CORNERS])}
