"""The simulation plan of a chain: its blocks in stages, on held samples or between the ticks.

A held signal stays held through every block that does not depend on time. The first block with
continuous dynamics needs no substeps if only its values at the ticks are used. If a nonlinear
block, or one with its own memory, follows, the run of blocks is integrated between the ticks.

The output of a chain with inertia is sampled at the tick, before its voltage acts; without inertia
at the end of the tick, just before the next voltage acts.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from piezo_hysteresis.arrays import FloatArray, IntArray
from piezo_hysteresis.blocks.base import Block, InterSample
from piezo_hysteresis.blocks.transport_delay import ring_size, shift
from piezo_hysteresis.models.simulation.state_layout import PlacedBlock, delay_of
from piezo_hysteresis.models.simulation.state_space import (
    LinearStep,
    hold_of,
    in_series,
    run_free,
    run_held,
    run_held_four,
)
from piezo_hysteresis.models.simulation.substep_run import PathRun

# Number of cached recursions of a linear stage: records of one fit, and steps of its parameters.
_CACHED = 32
# Blocks that keep a held signal held.
_HOLDS = (InterSample.INSTANT, InterSample.PATH, InterSample.TICK, InterSample.DELAY)


class Stage(Protocol):
    """Consecutive blocks of a chain that are simulated together."""

    @property
    def blocks(self) -> tuple[Block, ...]:
        """Blocks of the stage, in the order of the chain."""

    @property
    def columns(self) -> slice | IntArray:
        """Indices of their parameters in the chain, in the order of `respond`."""

    def initial_state(self, dt: float, start: float) -> FloatArray:
        """Return the state at rest; `start` is the time of the first sample [s]."""

    def respond(
        self, signal: FloatArray, p: FloatArray, dt: float, *, state: FloatArray, frequency: float
    ) -> FloatArray:
        """Return one number per tick, shape (n,), updating `state` in place."""


@dataclass(frozen=True)
class TickStage:
    """One block on one value per tick."""

    block: Block
    columns: slice
    ahead: bool  # whether the output is sampled at the end of the tick

    @property
    def blocks(self) -> tuple[Block, ...]:
        """The block."""
        return (self.block,)

    def initial_state(self, dt: float, start: float) -> FloatArray:
        """Return the memory at rest."""
        state = self.block.initial_state(dt, start)
        if self.ahead and self.block.between is InterSample.CLOCK:
            state[-1] += 1.0
        return state

    def respond(
        self, signal: FloatArray, p: FloatArray, dt: float, *, state: FloatArray, frequency: float
    ) -> FloatArray:
        """Return one number per tick."""
        return self.block.respond(signal, p, dt, state=state, frequency=frequency)


@dataclass(frozen=True)
class LinearStage:
    """Linear blocks after a held input, with or without delay, as one exact recursion.

    A delay commutes with a time-invariant chain: a delay by a fraction of a tick is the undelayed
    response sampled earlier by that fraction.
    """

    parts: tuple[PlacedBlock, ...]  # blocks and their parameters in `columns`, delays first
    columns: IntArray  # parameters of the stage in the chain
    delays: int  # number of delays among the parts
    ahead: bool  # whether the output is sampled at the end of the tick

    @property
    def blocks(self) -> tuple[Block, ...]:
        """Delays first, then the linear blocks."""
        return tuple(part.block for part in self.parts)

    def initial_state(self, dt: float, start: float) -> FloatArray:
        """Return the state at rest: ring buffer of the delays, then states of the blocks."""
        ring = self.delays * ring_size(dt) + 1 if self.delays else 0
        return np.concatenate(
            [np.zeros(ring), *(p.block.initial_state(dt) for p in self.parts[self.delays :])]
        )

    def respond(
        self, signal: FloatArray, p: FloatArray, dt: float, *, state: FloatArray, frequency: float
    ) -> FloatArray:
        """Return one number per tick."""
        whole, hold = self.hold(p, dt)
        ring = self.delays * ring_size(dt) + 1 if self.delays else 0
        if ring:
            late = np.empty_like(signal)
            shift(signal, late, state[:ring], whole)
            signal = late
        output = np.empty_like(signal)
        run_held(signal, output, state[ring:], *hold)
        return output

    def carried(
        self, signals: FloatArray, p: FloatArray, dt: float, states: FloatArray | None = None
    ) -> FloatArray:
        """Return the responses to several inputs, shape (m, n), in one pass.

        The `states`, shape (m, s), are updated in place; by default the inputs begin at rest.
        """
        whole, hold = self.hold(p, dt)
        if states is None:
            states = np.tile(self.initial_state(dt, 0.0), (len(signals), 1))
        late = np.ascontiguousarray(signals)
        ring = self.delays * ring_size(dt) + 1 if self.delays else 0
        if ring:
            late = np.empty_like(signals)
            for row, answer, state in zip(signals, late, states, strict=True):
                shift(np.ascontiguousarray(row), answer, state[:ring], whole)
        output, memory = np.empty_like(late), np.ascontiguousarray(states[:, ring:])
        run_held_four(late, output, memory, *hold)
        states[:, ring:] = memory
        return output

    def released(self, p: FloatArray, dt: float, count: int) -> FloatArray:
        """Return the free response from a unit value of each state, shape (q, `count`).

        Hundreds of initial conditions are tested with the same parameters: the last result is
        cached.
        """
        key = (p.tobytes(), dt, count)
        known: tuple[object, FloatArray] | None = self.__dict__.get('_released')
        if known is None or known[0] != key:
            hold = self.hold(p, dt)[1]
            known = key, np.empty((hold.rows.size, count))
            run_free(known[1], hold.phi, hold.rows[0])
            self.__dict__['_released'] = known
        return known[1]

    def hold(self, p: FloatArray, dt: float) -> tuple[int, LinearStep]:
        """Return the delay in ticks and the recursion, cached for the last few parameters."""
        key = (p.tobytes(), dt)
        last: dict[object, tuple[int, LinearStep]] = self.__dict__.setdefault('_last', {})
        known = last.get(key)
        if known is not None:
            return known
        whole, part = delay_of(p[: self.delays], dt, self.ahead)
        systems = [
            part.block.system(p[part.span])
            for part in self.parts[self.delays :]
            if part.block.system is not None
        ]
        made = whole, hold_of(in_series(systems), dt, part)
        # shared by threads: a full cache is cleared
        self.__dict__['_last'] = {**last, key: made} if len(last) < _CACHED else {key: made}
        return made


@dataclass(frozen=True)
class PathStage:
    """Blocks that are integrated between the ticks; see `PathRun`."""

    run: PathRun  # integration of the blocks
    columns: IntArray  # parameters of the stage in the chain

    @property
    def blocks(self) -> tuple[Block, ...]:
        """Delays first, then the others in order."""
        return self.run.blocks

    def initial_state(self, dt: float, start: float) -> FloatArray:
        """Return the memory at rest."""
        return self.run.initial_state(dt, start)

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
        """Return one value per tick; `steps` per tick as given, or as `p` requires."""
        return self.run.respond(signal, p, dt, state=state, frequency=frequency, steps=steps)


def as_linear(block: Block) -> LinearStage:
    """Return the stage of a single linear block, which propagates four derivatives at a time."""
    known: LinearStage | None = block.__dict__.get('_as_linear')
    if known is None:
        places = np.arange(len(block.parameters))
        part = PlacedBlock(block, slice(0, places.size))
        known = LinearStage((part,), places, 0, ahead=not block.inertia)
        block.__dict__['_as_linear'] = known  # as long as the block: each fit has its own
    return known


def free_states(stage: Stage, dt: float, *, memory: bool = True) -> tuple[int, ...]:
    """Return the indices of the states of a stage that are unknown for an actuator in motion.

    Their effect decays: position and velocity of a mode, elements of creep, and with `memory` the
    h of a Bouc-Wen loop.
    """
    if isinstance(stage, TickStage):
        return stage.block.unknown_states(dt, memory=memory)
    if isinstance(stage, PathStage):
        return stage.run.free_states(dt, memory=memory)
    size = stage.initial_state(dt, 0.0).size
    linear = [b.initial_state(dt).size for b in stage.blocks if b.between is InterSample.LINEAR]
    return tuple(range(size - sum(linear), size))


def stages_of(blocks: Sequence[Block]) -> tuple[Stage, ...]:
    """Return the stages of a chain of `blocks`."""
    return _Planner(blocks).plan()


class _Planner:
    """Planner of the stages of a chain, which determines where a path is required."""

    def __init__(self, blocks: Sequence[Block]) -> None:
        self._blocks = tuple(blocks)
        self._ahead = not any(block.inertia for block in blocks)
        counts = np.cumsum([0, *(len(block.parameters) for block in blocks)])
        self._spans = [slice(int(a), int(b)) for a, b in itertools.pairwise(counts)]
        self._waiting: list[int] = []  # delays that are not yet part of a stage with dynamics
        self._stages: dict[int, Stage] = {}

    def plan(self) -> tuple[Stage, ...]:
        """Return the stages in the order of the chain."""
        place = 0
        while place < len(self._blocks):
            kind = self._blocks[place].between
            if kind in _HOLDS:
                self._alone(place)
                self._waiting += [place] if kind is InterSample.DELAY else []
                place += 1
            else:
                place = self._run_from(place)
        return tuple(self._stages[place] for place in sorted(self._stages))

    def _alone(self, place: int) -> None:
        self._stages[place] = TickStage(self._blocks[place], self._spans[place], self._ahead)

    def _run_from(self, first: int) -> int:
        """Plan the run that begins with a dynamic block; return the index after it."""
        end = first
        while end < len(self._blocks) and self._blocks[end].between is not InterSample.TICK:
            end += 1
        later = [i for i in range(first, end) if self._blocks[i].between is InterSample.DELAY]
        inside = [i for i in range(first, end) if i not in later]
        delays = [*self._waiting, *later]
        last = self._needed(inside, bool(delays))
        if last:
            for place in self._waiting:
                del self._stages[place]
            self._waiting = []
            self._follow(delays, inside[:last])
        for place in inside[last:]:
            self._alone(place)
        return end

    def _needed(self, inside: Sequence[int], late: bool) -> int:
        """Return the number of blocks integrated together; the others use their samples."""
        kinds = [self._blocks[i].between for i in inside]
        last = len(inside)
        while last and kinds[last - 1] in (InterSample.INSTANT, InterSample.CLOCK):
            last -= 1
        # for a memory, a monotonic approach is equivalent to its samples
        first, behind = self._blocks[inside[0]], [self._blocks[i] for i in inside[1:last]]
        if first.monotonic and behind and self._ahead and not late:
            *static, memory = behind
            kinds = [block.between for block in static]
            if memory.between is InterSample.PATH and memory.path_kernel is None:
                return 1 if set(kinds) <= {InterSample.INSTANT} else last
        return last

    def _follow(self, delays: Sequence[int], needed: Sequence[int]) -> None:
        blocks = [self._blocks[i] for i in needed]
        single = len(blocks) == 1 and blocks[0].between is not InterSample.CLOCK
        if single and not delays and blocks[0].inertia is not self._ahead:
            self._alone(needed[0])
            return
        parts: list[PlacedBlock] = []
        columns: list[int] = []
        for place in (*delays, *needed):
            span = self._spans[place]
            own = list(range(span.start, span.stop))
            parts.append(
                PlacedBlock(self._blocks[place], slice(len(columns), len(columns) + len(own)))
            )
            columns += own
        places = np.array(columns, dtype=np.int64)
        if all(block.system is not None for block in blocks):
            stage: Stage = LinearStage(tuple(parts), places, len(delays), self._ahead)
        else:
            stage = PathStage(PathRun(tuple(parts), len(delays), self._ahead), places)
        self._stages[needed[0]] = stage
