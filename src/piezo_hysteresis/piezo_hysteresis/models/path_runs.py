"""A run of blocks followed between the ticks, on as fine a grid as they move."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import ceil, log2
from typing import NamedTuple

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Between, Block, System, Way
from piezo_hysteresis.blocks.transport_delay import in_ticks, ring_size, shift
from piezo_hysteresis.models.linear_runs import Step, fastest, in_series, run_path, step_of
from piezo_hysteresis.models.paths import (
    JOINED_STEPS,
    PAST,
    follow,
    joined,
    on_the_clock,
    read,
)
from piezo_hysteresis.models.way_runs import (
    SLOW,
    Response,
    gauss_of,
    response_of,
    take_up,
    ways,
)

_HEAD = 2  # places in the state: what was read last, and the input that was held last
# Most steps per tick; always a power of two, so that few changes of a parameter change the grid.
_MOST = 64
_STRIDE = 0.5  # longest step in units of the fastest time constant that shapes a path
_VALUES = 1 << 14  # values of a path that are followed at a time: what a cache holds


class Part(NamedTuple):
    """A block and where its parameters stand among those of its stage."""

    block: Block
    span: slice


class _Piece(NamedTuple):
    """Parts that are followed together: linear ones as one system, the others one by one."""

    parts: tuple[Part, ...]
    memory: slice
    linear: bool
    turns: bool


def delay_of(delays: FloatArray, dt: float, ahead: bool) -> tuple[int, float]:
    """Return ticks by which the input comes late and after which part of a tick to read."""
    if not delays.size:
        return 0, 1.0 if ahead else 0.0
    whole, part = in_ticks(float(delays.sum()), dt)
    return whole if ahead else whole + 1, 1.0 - part


@dataclass(frozen=True)
class PathRun:
    """Blocks in a row behind an input that is held over the tick.

    Delays are not among what is followed: they pass through blocks that do not change with time,
    and are a matter of when the path is read. Functions of the time know that.

    Attributes
    ----------
    parts : tuple of Part
        Delays first, then the blocks in order.
    delays : int
        How many of the parts are delays.
    ahead : bool
        Whether the chain is read at the end of the tick, and not at its start.
    """

    parts: tuple[Part, ...]
    delays: int
    ahead: bool

    @property
    def blocks(self) -> tuple[Block, ...]:
        """Delays first, then the others in order."""
        return tuple(part.block for part in self.parts)

    @cached_property
    def _moving(self) -> tuple[Part, ...]:
        return self.parts[self.delays :]

    @cached_property
    def _joining(self) -> Part | None:
        return next((part for part in self._moving if part.block.joins is not None), None)

    @cached_property
    def _groups(self) -> tuple[tuple[tuple[Part, ...], bool, bool], ...]:
        """Parts that are followed together, whether they are linear, whether a path turns."""
        groups: list[tuple[tuple[Part, ...], bool, bool]] = []
        turns = False
        for i, part in enumerate(self._moving):
            linear = part.block.system is not None
            if linear and groups and groups[-1][1]:
                groups[-1] = ((*groups[-1][0], part), True, False)
            else:
                groups.append(((part,), linear, turns))
            goes_on = part.block.way is not None and i == 0
            turns |= not goes_on and part.block.between is not Between.INSTANT
        return tuple(groups)

    def _pieces(self, dt: float) -> tuple[list[_Piece], int]:
        """Return the groups with their places in the state, and its size."""
        memories = self._memories(dt)
        pieces, first = [], 0
        for parts, linear, turns in self._groups:
            last = first + len(parts)
            own = slice(memories[first].start, memories[last - 1].stop)
            pieces.append(_Piece(parts, own, linear, turns))
            first = last
        return pieces, memories[-1].stop

    def _ring(self, dt: float) -> int:
        return self.delays * ring_size(dt) + 1 if self.delays else 0

    def initial_state(self, dt: float, start: float) -> FloatArray:
        """Return the memory at rest: two last values, ring of the delays, past samples, blocks."""
        pieces, size = self._pieces(dt)
        state = np.zeros(size)
        for piece in pieces:
            own = [part.block.initial_state(dt, start) for part in piece.parts]
            state[piece.memory] = np.concatenate(own)
        return state

    def steps(self, p: FloatArray, dt: float) -> int:
        """Return how many steps per tick these parameters need; 0 where none, see `way_runs`."""
        key = (p.tobytes(), dt)
        known: tuple[object, int] | None = self.__dict__.get('_steps')
        if known is None or known[0] != key:
            known = (key, self._count(p, dt))
            self.__dict__['_steps'] = known
        return known[1]

    def _count(self, p: FloatArray, dt: float) -> int:
        if self._order(p) > 0.0:
            return JOINED_STEPS
        if self._behind_way and dt * _pace(self._moving[self._behind_way :], p) <= SLOW:
            return 0
        pace = max(_pace(parts, p) for parts, _, _ in self._groups)
        if not np.isfinite(pace):
            return _MOST
        least = max(part.block.least_steps for part in self._moving)
        corners = least > Block.least_steps
        if self._moving[0].block.least_steps < least:
            least *= 2  # a corner that a moving input makes is not known to be one
        if corners and self.ahead and self.delays:
            least *= 8  # where it is read anywhere, and not at the end of a step
        stride, most = (0.5 * _STRIDE, 2 * _MOST) if corners else (_STRIDE, _MOST)
        needed = int(2 ** ceil(log2(max(dt * pace / stride, 1.0))))
        return max(least, min(needed, most))

    @cached_property
    def _behind_way(self) -> int:
        """Number of parts up to the linear ones that take up a way; 0 where it is not so."""
        parts = self._moving
        last = len(parts)
        while last and parts[last - 1].block.system is not None:
            last -= 1
        middle = [part.block for part in parts[1:last]]
        memories = [block for block in middle if block.between is Between.PATH]
        simple = all(block.between is Between.INSTANT for block in middle if block not in memories)
        if parts[0].block.way is None or last in (0, len(parts)) or not simple:
            return 0
        return last if len(memories) <= 1 and all(b.along is None for b in memories) else 0

    def _memories(self, dt: float) -> list[slice]:
        """Return where the memory of each part stands in the state."""
        place = _HEAD + self._ring(dt) + (PAST if self._joining else 0)
        memories = []
        for part in self._moving:
            size = part.block.initial_state(dt).size
            memories.append(slice(place, place + size))
            place += size
        return memories

    def _way(self, p: FloatArray, dt: float) -> tuple[Way, FloatArray, FloatArray, Response]:
        """Return the way, its Gauss points and what takes it up, made anew where it is new."""
        key = (p.tobytes(), dt)
        known: tuple[object, tuple[Way, FloatArray, FloatArray, Response]] | None
        known = self.__dict__.get('_last_way')
        if known is None or known[0] != key:
            first = self._moving[0]
            assert first.block.way is not None
            way = first.block.way(p[first.span])
            behind = _systems(self._moving[self._behind_way :], p)
            known = (key, (way, *gauss_of(way, behind, dt), response_of(behind, dt)))
            self.__dict__['_last_way'] = known
        return known[1]

    def _by_ways(
        self, signal: FloatArray, p: FloatArray, dt: float, state: FloatArray
    ) -> FloatArray:
        """Answer where all that is followed is a way within the tick, see `way_runs`."""
        ring = self._ring(dt)
        way, places, weights, response = self._way(p, dt)
        whole, part = in_ticks(float(p[: self.delays].sum()), dt)
        old = new = signal
        if ring:
            new = np.empty_like(signal)
            shift(signal, new, state[_HEAD : _HEAD + ring], whole)
            old = np.concatenate([state[1:2], new[:-1]])
            state[1] = new[-1]
        pieces = 2 if part > 0.0 else 1
        memories = self._memories(dt)
        output = np.empty_like(signal)
        at_once = max(1, _VALUES // (pieces * (places.size + 1)))
        for begin in range(0, signal.size, at_once):
            chunk = slice(begin, begin + at_once)
            count = output[chunk].size
            values, lasts = np.empty((count, pieces, places.size + 1)), np.empty((count, pieces))
            memory = state[memories[0]]
            ways(old[chunk], new[chunk], part, memory, way, dt, places, values, lasts)
            flat = values.ravel()
            for each, place in zip(self._moving[1 : self._behind_way], memories[1:], strict=False):
                flat = each.block.respond(flat, p[each.span], dt, state=state[place])
            behind = slice(memories[self._behind_way].start, memories[-1].stop)
            take_up(
                flat.reshape(values.shape), lasts, part, places, weights, output[chunk],
                state[behind], state[:1], *response, self.ahead,
            )  # fmt: skip
        return output

    def _order(self, p: FloatArray) -> float:
        part = self._joining
        return 0.0 if part is None or part.block.joins is None else part.block.joins(p[part.span])

    def respond(
        self,
        signal: FloatArray,
        p: FloatArray,
        dt: float,
        *,
        state: FloatArray,
        frequency: float,
        steps: int | None = None,
    ) -> FloatArray:
        """Answer one number per tick, updating `state` in place.

        Parameters
        ----------
        signal : ndarray, shape (n,)
            Held input.
        p : ndarray
            Parameters of the parts.
        dt, frequency : float
            Sampling interval [s] and fundamental frequency of the drive [Hz].
        state : ndarray
            From `initial_state`.
        steps : int, optional
            Steps per tick; as many as `p` needs where it is not given.
        """
        steps = self.steps(p, dt) if steps is None else steps
        if steps == 0:
            return self._by_ways(signal, p, dt, state)
        order, ring, points = self._order(p), self._ring(dt), 3 * steps
        timing = self._timing(p, dt, order > 0.0)
        if ring:
            late = np.empty_like(signal)
            shift(signal, late, state[_HEAD : _HEAD + ring], timing.ticks)
            signal = late
        clock = _Clock(dt, frequency, points, timing.ahead)
        output = np.empty_like(signal)
        pieces, made = self._pieces(dt)[0], self._made(p, dt, steps)
        at_once = max(1, _VALUES // points)
        for first in range(0, signal.size, at_once):
            x = signal[first : first + at_once]
            if order > 0.0:
                path = np.empty(x.size * points)
                joined(x, path, state[_HEAD + ring : _HEAD + ring + PAST], order)
            else:
                path = np.repeat(x, points)
            for piece, step in zip(pieces, made, strict=True):
                path = _followed(piece, step, path, p, state[piece.memory], clock)
            _read(path, output[first : first + at_once], state, points, timing.part)
        return output

    def _timing(self, p: FloatArray, dt: float, is_joined: bool) -> _Timing:
        """Return when the path is read; one that is joined ends at its tick."""
        ticks, part = delay_of(p[: self.delays], dt, self.ahead or is_joined)
        late = 1.0 - part if self.delays else 0.0
        begun = is_joined or (not self.ahead and self.delays > 0)
        return _Timing(ticks, part, late - 1.0 if begun else late)

    def _made(self, p: FloatArray, dt: float, steps: int) -> tuple[Step | None, ...]:
        """Return the steps of the linear pieces, made anew where the parameters are new."""
        key = (p.tobytes(), dt, steps)
        known: tuple[object, tuple[Step | None, ...]] | None = self.__dict__.get('_last')
        if known is not None and known[0] == key:
            return known[1]
        made = tuple(
            step_of(in_series(_systems(parts, p)), dt / steps) if linear else None
            for parts, linear, _ in self._groups
        )
        self.__dict__['_last'] = (key, made)
        return made


class _Timing(NamedTuple):
    """Ticks by which the input comes late, part of the tick to read, time ahead of it [ticks]."""

    ticks: int
    part: float
    ahead: float


class _Clock(NamedTuple):
    """What blocks know of the time: interval [s], drive [Hz], points per tick, ticks ahead."""

    dt: float
    frequency: float
    points: int
    ahead: float


def _systems(parts: Sequence[Part], p: FloatArray) -> list[System]:
    return [part.block.system(p[part.span]) for part in parts if part.block.system is not None]


def _pace(parts: Sequence[Part], p: FloatArray) -> float:
    """Return the fastest rate at which some parts move [1/s]; 0 where they only follow."""
    inner = [part.block.pace(p[part.span]) for part in parts if part.block.pace is not None]
    return max([fastest(_systems(parts, p)), *inner])


def _followed(
    piece: _Piece,
    step: Step | None,
    path: FloatArray,
    p: FloatArray,
    state: FloatArray,
    clock: _Clock,
) -> FloatArray:
    if step is not None:
        output = np.empty_like(path)
        run_path(path, output, state, *step)
        return output
    ((block, span),) = piece.parts
    own = p[span]
    if block.between is Between.CLOCK:
        return on_the_clock(
            block, path, own, state, clock.dt, points=clock.points, ahead=clock.ahead
        )
    if block.along is not None:
        output = np.empty_like(path)
        block.along(path, output, state, own, clock.dt, clock.frequency, clock.points)
        return output
    turns = piece.turns and block.between is Between.PATH
    return follow(block, path, own, state, clock.dt, turns=turns)


def _read(
    path: FloatArray, output: FloatArray, state: FloatArray, points: int, part: float
) -> None:
    """Read every tick; the start of one is the end of the one before, kept in ``state[0]``."""
    ends = path[points - 1 :: points]
    if part == 1.0:
        output[:] = ends
    elif part == 0.0:
        output[0] = state[0]
        output[1:] = ends[:-1]
    else:
        read(path, output, points, part)
    state[0] = ends[-1]
