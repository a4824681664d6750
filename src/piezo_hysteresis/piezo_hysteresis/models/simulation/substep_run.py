"""Integration of a run of blocks between the ticks, on a grid that their dynamics require."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, log2
from typing import NamedTuple

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Between, Block
from piezo_hysteresis.blocks.transport_delay import shift
from piezo_hysteresis.common.cached_property import cached_property
from piezo_hysteresis.models.simulation.intersample import (
    JOINED_STEPS,
    PAST,
    follow,
    joined,
    read,
    with_time,
)
from piezo_hysteresis.models.simulation.quadrature_run import QuadratureRun
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

# Largest number of steps per tick; a power of two, so that small parameter changes keep the grid.
_MOST = 64
_STRIDE = 0.5  # longest step in units of the fastest time constant that shapes a path
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
        return next((part for part in self._moving if part.block.joins is not None), None)

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
            goes_on = part.block.approach is not None and i == 0
            turns |= not goes_on and part.block.between is not Between.INSTANT
        return tuple(groups)

    @cached_property
    def by_quadrature(self) -> QuadratureRun | None:
        """The same run by quadrature, if its input is approached monotonically."""
        return QuadratureRun.of(self._moving, self.delays, self.ahead)

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
        """Return the number of steps per tick for these parameters; 0 for `quadrature_run`."""
        key = (p.tobytes(), dt)
        known: tuple[object, int] | None = self.__dict__.get('_steps')
        if known is None or known[0] != key:
            known = (key, self._count(p, dt))
            self.__dict__['_steps'] = known
        return known[1]

    def _count(self, p: FloatArray, dt: float) -> int:
        if self.order(p) > 0.0:
            return JOINED_STEPS
        if self.by_quadrature is not None and self.by_quadrature.fits(p, dt):
            return 0
        pace = max((_pace(parts, p) for parts in self._shaping()), default=0.0)
        if not np.isfinite(pace):
            return _MOST
        least = max(part.block.least_steps for part in self._moving)
        corners = least > Block.least_steps
        if self._moving[0].block.least_steps < least:
            least *= 2  # corners of a continuous input are not detected
        if corners and self.ahead and self.delays:
            least *= 8  # if it is sampled within a step and not at its end
        stride, most = (0.5 * _STRIDE, 2 * _MOST) if corners else (_STRIDE, _MOST)
        needed = int(2 ** ceil(log2(max(dt * pace / stride, 1.0))))
        return max(least, min(needed, most))

    def _shaping(self) -> list[tuple[PlacedBlock, ...]]:
        """Return the groups whose dynamics ask for steps: all but lags at the end of the chain.

        A lag at the end is exact for its input and sampled at the end of a step. A mode is not
        left out: it rings with what its input deviates between the points of the path.
        """
        *groups, (last, linear, _) = self._groups
        if linear and not self.delays:
            while last and last[-1].block.approach is not None:
                last = last[:-1]
        return [*(parts for parts, _, _ in groups), *([last] if last else [])]

    def order(self, p: FloatArray) -> float:
        """Return the interpolation order of a measured input between ticks; 0 if it is held."""
        part = self._joining
        return 0.0 if part is None or part.block.joins is None else part.block.joins(p[part.span])

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
        if steps == 0 and self.by_quadrature is not None:
            return self.by_quadrature.respond(signal, p, dt, state=state, layout=layout)
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
    inner = [part.block.pace(p[part.span]) for part in parts if part.block.pace is not None]
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
    if block.between is Between.CLOCK:
        return with_time(block, path, own, state, clock.dt, points=clock.points, ahead=clock.ahead)
    if block.along is not None:
        output = np.empty_like(path)
        block.along(path, output, state, own, clock.dt, clock.frequency, clock.points)
        return output
    turns = piece.turns and block.between is Between.PATH
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
