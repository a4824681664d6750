"""The path of a signal between the ticks: construction, propagation through blocks, sampling.

A path has `points` values per tick, three per step: at the start of the step (after a possible
jump), in its middle and at its end. Between them it is a parabola.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import ceil, log2
from typing import NamedTuple

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Block, InterSample
from piezo_hysteresis.blocks.bouc_wen_oscillator import WEIGHTS, interpolate, place_of_order
from piezo_hysteresis.blocks.transport_delay import shift
from piezo_hysteresis.common.cached_property import cached_property
from piezo_hysteresis.jit import jit, scratch
from piezo_hysteresis.models.simulation.state_layout import (
    Layout,
    PlacedBlock,
    delay_of,
    layout_of,
    systems_of,
)
from piezo_hysteresis.models.simulation.state_space import (
    LinearStep,
    fastest,
    in_series,
    run_path,
    step_of,
)

#: Number of past samples of an interpolated path, and its steps per tick.
PAST: int = WEIGHTS.shape[0]
JOINED_STEPS: int = (WEIGHTS.shape[1] - 1) // 2


@jit
def joined(x: FloatArray, path: FloatArray, past: FloatArray, order: float) -> None:
    """Fill the path between the last two samples for each sample of `x`."""
    forces = scratch(WEIGHTS.shape[1])
    points = 3 * JOINED_STEPS
    for k in range(x.size):
        for j in range(PAST - 1, 0, -1):
            past[j] = past[j - 1]
        past[0] = x[k]
        interpolate(past, order, forces)
        for i in range(JOINED_STEPS):
            for j in range(3):
                path[k * points + 3 * i + j] = forces[2 * i + j]


@jit
def with_turns(x: FloatArray, wide: FloatArray, late: FloatArray) -> None:
    """Fill `wide`, four points per step, with `x` and the extremum of its parabola.

    `late` is whether the extremum is in the second half of a step. A step without an extremum has
    its middle twice.
    """
    for step in range(x.size // 3):
        start, middle, end = x[3 * step], x[3 * step + 1], x[3 * step + 2]
        slope = -3.0 * start + 4.0 * middle - end
        bend = 2.0 * (start - 2.0 * middle + end)
        place = 0.5
        if slope * bend < 0.0 and abs(slope) < 2.0 * abs(bend):
            place = -0.5 * slope / bend
        turn = middle if place == 0.5 else start + place * (slope + place * bend)
        turned = place > 0.5
        late[step] = 1.0 if turned else 0.0
        wide[4 * step] = start
        wide[4 * step + 1] = middle if turned else turn
        wide[4 * step + 2] = turn if turned else middle
        wide[4 * step + 3] = end


@jit
def without_turns(wide: FloatArray, late: FloatArray, y: FloatArray) -> None:
    """Fill `y`, three points per step, from `wide`, the inverse of `with_turns`."""
    for step in range(late.size):
        y[3 * step] = wide[4 * step]
        y[3 * step + 1] = wide[4 * step + (1 if late[step] > 0.0 else 2)]
        y[3 * step + 2] = wide[4 * step + 3]


def follow(
    block: Block, path: FloatArray, p: FloatArray, state: FloatArray, dt: float, *, turns: bool
) -> FloatArray:
    """Return the output of a block along a path, for a block that does not depend on time."""
    if not turns:
        return block.respond(path, p, dt, state=state)
    wide = np.empty(path.size // 3 * 4)
    late = np.empty(path.size // 3)
    with_turns(path, wide, late)
    answer = block.respond(wide, p, dt, state=state)
    output = np.empty_like(path)
    without_turns(answer, late, output)
    return output


def with_time(
    block: Block,
    path: FloatArray,
    p: FloatArray,
    state: FloatArray,
    dt: float,
    *,
    points: int,
    ahead: float,
) -> FloatArray:
    """Return the output of a time-dependent block along a path."""
    output = np.empty_like(path)
    for place, memory in moments(block, state, path.size // points, points // 3, ahead):
        part = np.ascontiguousarray(path[place])
        output[place] = block.respond(part, p, dt / (points // 3), state=memory)
    return output


def moments(
    block: Block, state: FloatArray, ticks: int, steps: int, ahead: float
) -> Iterator[tuple[slice, FloatArray]]:
    """Yield indices of start, middle and end of each step of a path, with a state of that time."""
    for place in range(3):
        memory = state.copy()
        memory[-1] = (state[-1] + ahead) * steps + 0.5 * place
        yield slice(place, None, 3), memory
    state[-1] += ticks


@jit
def read(path: FloatArray, y: FloatArray, points: int, part: float) -> None:
    """Sample a path in each tick after `part` of it, 0 < part <= 1."""
    steps = points // 3
    step = min(int(part * steps), steps - 1)
    t = part * steps - step
    for k in range(y.size):
        at = k * points + 3 * step
        slope = -3.0 * path[at] + 4.0 * path[at + 1] - path[at + 2]
        bend = 2.0 * (path[at] - 2.0 * path[at + 1] + path[at + 2])
        y[k] = path[at] + t * (slope + t * bend)


# Largest number of steps per tick; a power of two, so that small parameter changes keep the grid.
_MOST = 64
# Least number, and that of a chain with a rate limit.
_LEAST, _LEAST_AT_CORNERS = 8, 32
_STRIDE = 0.5  # longest step in units of the fastest time constant that shapes a path
# Blocks whose output moves while their input is held.
_MOVES = (InterSample.INNER, InterSample.CLOCK)
_VALUES = 1 << 14  # path values integrated at a time, to fit into the cache


class PathPiece(NamedTuple):
    """Blocks that are integrated together: linear ones as one system, the others one at a time."""

    parts: tuple[PlacedBlock, ...]
    memory: slice
    linear: bool
    turns: bool


@dataclass(frozen=True)
class PathRun:
    """Blocks in series after an input that is held over the tick.

    Delays are not integrated: they commute with time-invariant blocks and only shift the instant
    at which the path is sampled. Time-dependent blocks account for this shift.
    """

    parts: tuple[PlacedBlock, ...]  # delays first, then the blocks in order
    delays: int  # number of delays among the parts
    ahead: bool  # whether the output is sampled at the end of the tick and not at its start

    @property
    def blocks(self) -> tuple[Block, ...]:
        """Delays first, then the others in order."""
        return tuple(part.block for part in self.parts)

    @cached_property
    def _moving(self) -> tuple[PlacedBlock, ...]:
        return self.parts[self.delays :]

    @cached_property
    def _joining(self) -> PlacedBlock | None:
        places = (part for part in self._moving if place_of_order(part.block) is not None)
        return next(places, None)

    @cached_property
    def _groups(self) -> tuple[tuple[tuple[PlacedBlock, ...], bool, bool], ...]:
        """Groups of blocks integrated together: linear or not, with path extrema or without."""
        groups: list[tuple[tuple[PlacedBlock, ...], bool, bool]] = []
        turns = False
        for i, part in enumerate(self._moving):
            linear = part.block.system is not None
            if linear and groups and groups[-1][1]:
                groups[-1] = ((*groups[-1][0], part), True, False)
            else:
                groups.append(((part,), linear, turns))
            goes_on = part.block.monotonic and i == 0
            turns |= not goes_on and part.block.between is not InterSample.INSTANT
        return tuple(groups)

    @cached_property
    def _is_smooth(self) -> bool:
        """Whether a lag or rate limit, then static blocks or a memory, and linear blocks follow.

        Only the first block shapes the path, and the linear blocks behind average its deviation.
        """
        return self._moving[0].block.monotonic and all(
            linear or not (turns or parts[0].block.path_kernel or parts[0].block.between in _MOVES)
            for parts, linear, turns in self._groups[1:]
        )

    def layout(self, dt: float) -> Layout:
        """Return the layout of the state of the run."""
        return layout_of(self._moving, self.delays, PAST if self._joining else 0, dt)

    def free_states(self, dt: float, *, memory: bool = True) -> tuple[int, ...]:
        """Return the indices of the states that are unknown for an actuator in motion.

        If the output is sampled at the start of a tick, the last output is one of them.
        """
        inside = [
            own.start + place
            for part, own in zip(self._moving, self.layout(dt).memories, strict=True)
            for place in part.block.unknown_states(dt, memory=memory)
        ]
        return (*(() if self.ahead or not inside else (0,)), *inside)

    def pieces(self, layout: Layout) -> list[PathPiece]:
        """Return the groups with the indices of their states."""
        memories = layout.memories
        pieces, first = [], 0
        for parts, linear, turns in self._groups:
            last = first + len(parts)
            own = slice(memories[first].start, memories[last - 1].stop)
            pieces.append(PathPiece(parts, own, linear, turns))
            first = last
        return pieces

    def initial_state(self, dt: float, start: float) -> FloatArray:
        """Return the state at rest, with the indices of `layout`."""
        layout = self.layout(dt)
        state = np.zeros(layout.size)
        for part, memory in zip(self._moving, layout.memories, strict=True):
            state[memory] = part.block.initial_state(dt, start)
        return state

    def steps(self, p: FloatArray, dt: float) -> int:
        """Return the number of steps per tick for these parameters."""
        key = (p.tobytes(), dt)
        known: tuple[object, int] | None = self.__dict__.get('_steps')
        if known is None or known[0] != key:
            known = (key, self._count(p, dt))
            self.__dict__['_steps'] = known
        return known[1]

    def _count(self, p: FloatArray, dt: float) -> int:
        if self.order(p) > 0.0:
            return JOINED_STEPS
        bent = [part.block.monotonic and part.block.system is None for part in self._moving]
        corners = any(bent)
        least = _LEAST_AT_CORNERS if corners else _LEAST
        is_smooth = self._is_smooth and (corners or not self.delays)
        # where nothing else bends the path, what a lag does within a step is in its mean
        shaping = self._shaping()[1:] if is_smooth else self._shaping()
        pace = max((_pace(parts, p) for parts in shaping), default=0.0)
        if not np.isfinite(pace):
            return _MOST
        stride, most = (0.5 * _STRIDE, 2 * _MOST) if corners else (_STRIDE, _MOST)
        if is_smooth:
            # measured: 1e-4 of the stroke; a lag at the end does not average a corner
            few = 4 if not corners else 8 if pace > 0.0 else least
            least, stride = few, (0.13 if corners else 2.0) * _STRIDE
        elif corners and not bent[0]:
            least *= 2  # corners of a continuous input are not detected
        if corners and self.ahead and self.delays:
            least *= 8  # if it is sampled within a step and not at its end
        needed = int(2 ** ceil(log2(max(dt * pace / stride, 1.0))))
        return max(least, min(needed, most))

    def _shaping(self) -> list[tuple[PlacedBlock, ...]]:
        """Return the groups whose dynamics ask for steps: all but lags at the end of the chain.

        A lag at the end is exact for its input and sampled at the end of a step. A mode is not
        left out: it rings with what its input deviates between the points of the path.
        """
        *groups, (last, linear, _) = self._groups
        if linear and not self.delays:
            while last and last[-1].block.monotonic:
                last = last[:-1]
        return [*(parts for parts, _, _ in groups), *([last] if last else [])]

    def order(self, p: FloatArray) -> float:
        """Return the interpolation order of a measured input between ticks; 0 if it is held."""
        part = self._joining
        place = None if part is None else place_of_order(part.block)
        return 0.0 if part is None or place is None else float(p[part.span][place])

    def respond(
        self,
        signal: FloatArray,  # (n,)
        p: FloatArray,
        dt: float,  # [s]
        *,
        state: FloatArray,
        frequency: float,  # [Hz]
        steps: int | None = None,
    ) -> FloatArray:
        """Return one value per tick, updating `state` in place."""
        steps = self.steps(p, dt) if steps is None else steps
        layout = self.layout(dt)
        order, points = self.order(p), 3 * steps
        timing = self.timing(p, dt, order > 0.0)
        if self.delays:
            late = np.empty_like(signal)
            shift(signal, late, state[layout.ring], timing.ticks)
            signal = late
        clock = PathClock(dt, frequency, points, timing.ahead)
        output = np.empty_like(signal)
        pieces, made = self.pieces(layout), self.made(p, dt, steps)
        at_once = max(1, _VALUES // points)
        for first in range(0, signal.size, at_once):
            x = signal[first : first + at_once]
            if order > 0.0:
                path = np.empty(x.size * points)
                joined(x, path, state[layout.past], order)
            else:
                path = np.repeat(x, points)
            for piece, step in zip(pieces, made, strict=True):
                path = followed(piece, step, path, p, state[piece.memory], clock)
            read_ticks(path, output[first : first + at_once], state, points, timing.part)
        return output

    def timing(self, p: FloatArray, dt: float, is_joined: bool) -> Timing:
        """Return the sampling instant of the path; an interpolated path ends at its tick."""
        ticks, part = delay_of(p[: self.delays], dt, self.ahead or is_joined)
        late = 1.0 - part if self.delays else 0.0
        later = is_joined or (not self.ahead and self.delays > 0)
        return Timing(ticks, part, late - 1.0 if later else late)

    def made(self, p: FloatArray, dt: float, steps: int) -> tuple[LinearStep | None, ...]:
        """Return the steps of the linear pieces, cached for the last parameters."""
        key = (p.tobytes(), dt, steps)
        known: tuple[object, tuple[LinearStep | None, ...]] | None = self.__dict__.get('_last')
        if known is not None and known[0] == key:
            return known[1]
        made = tuple(
            step_of(in_series(systems_of(parts, p)), dt / steps) if linear else None
            for parts, linear, _ in self._groups
        )
        self.__dict__['_last'] = (key, made)
        return made


class Timing(NamedTuple):
    """Delay of the input in ticks, part of the tick to sample, time offset of the path [ticks]."""

    ticks: int
    part: float
    ahead: float


class PathClock(NamedTuple):
    """Time arguments of blocks: interval [s], drive [Hz], points per tick, ticks ahead."""

    dt: float
    frequency: float
    points: int
    ahead: float


def _pace(parts: Sequence[PlacedBlock], p: FloatArray) -> float:
    """Return the fastest rate of some parts [1/s]; 0 for parts without own dynamics."""
    inner = [part.block.mode.pace(p[part.span]) for part in parts if part.block.mode is not None]
    return max([fastest(systems_of(parts, p)), *inner])


def followed(
    piece: PathPiece,
    step: LinearStep | None,
    path: FloatArray,
    p: FloatArray,
    state: FloatArray,
    clock: PathClock,
) -> FloatArray:
    """Return the output of a piece along a path, updating its `state` in place."""
    if step is not None:
        output = np.empty_like(path)
        run_path(path, output, state, *step)
        return output
    ((block, span),) = piece.parts
    own = p[span]
    if block.between is InterSample.CLOCK:
        return with_time(block, path, own, state, clock.dt, points=clock.points, ahead=clock.ahead)
    if block.path_kernel is not None:
        output = np.empty_like(path)
        block.path_kernel(path, output, state, own, clock.dt, clock.frequency, clock.points)
        return output
    turns = piece.turns and block.between is InterSample.PATH
    return follow(block, path, own, state, clock.dt, turns=turns)


def read_ticks(
    path: FloatArray, output: FloatArray, state: FloatArray, points: int, part: float
) -> None:
    """Sample each tick; its start is the end of the previous one, stored in ``state[0]``."""
    ends = path[points - 1 :: points]
    if part == 1.0:
        output[:] = ends
    elif part == 0.0:
        output[0] = state[0]
        output[1:] = ends[:-1]
    else:
        read(path, output, points, part)
    state[0] = ends[-1]
