"""Free response of the linear blocks at the end of a chain.

The response to an initial state is independent of the drive and of the rest of the response: it is
a free response of a linear system, for any step of the integration before it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache, partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Between, Block
from piezo_hysteresis.identification.sensitivities import StateOffset
from piezo_hysteresis.identification.targets import Target
from piezo_hysteresis.models import Model
from piezo_hysteresis.models.chain import State
from piezo_hysteresis.models.simulation.plan import LinearStage, PathStage, TickStage, as_linear
from piezo_hysteresis.models.simulation.state_layout import PlacedBlock

# Largest number of values of free responses that a stage keeps (32 MB).
_MOST_KEPT = 4_000_000


class _Tail(NamedTuple):
    """Linear blocks at the end of a stage, with parameters and the index of their first state."""

    stage: LinearStage
    values: FloatArray
    first: int


class FreeResponse:
    """States of the linear tail of a chain and their free response."""

    def __init__(
        self, model: Model, packed: FloatArray, led: Sequence[FloatArray], target: Target
    ) -> None:  # packed (p,)
        self._stages, self._packed = model.stages, packed
        self._led, self._target = led, target
        self._tails = [self._tail_of(k) for k in range(len(self._stages))]

    def affine(self, stage: int, first: int) -> bool:
        """Return whether the blocks of a stage from `first` on respond linearly to a change."""
        return all(_passes(block) for block in self._stages[stage].blocks[first:])

    def holds(self, moved: StateOffset) -> bool:
        """Return whether a state belongs to a linear tail."""
        tail = self._tails[moved.stage]
        return tail is not None and moved.place >= tail.first

    def reach(self) -> dict[tuple[int, int], float]:
        """Return the largest value of each state in a tail under the largest input of the record.

        The input before the record is assumed to be no stronger. The response to a step of that
        size is evaluated after 1, 2, 4, ... ticks.
        """
        found: dict[tuple[int, int], float] = {}
        dt, count = self._target.dt, self._target.drive.size - self._target.origin
        for k, tail in enumerate(self._tails):
            if tail is None:
                continue
            # the input of the tail of a path is not stored: its output has the same size
            inside = isinstance(self._stages[k], PathStage)
            size = float(np.max(np.abs(self._led[k + 1 if inside else k])))
            most = _remembered(
                tail.stage,
                'reach',
                (tail.values.tobytes(), dt, count),
                partial(_reach, tail, dt, count),
            )
            found |= {(k, tail.first + i): size * float(value) for i, value in enumerate(most)}
        return found

    def response(self, moved: Sequence[StateOffset]) -> FloatArray:
        """Return the displacement by offsets in tails together, shape (n,) [m]."""
        change = np.zeros(self._target.drive.size)
        for each in moved:
            tail = self._tails[each.stage]
            if tail is not None and each.place >= tail.first:
                row = self._released(each.stage, tail)[each.place - tail.first]
                change[self._target.origin :] += each.amount * row
        return change

    def last_linear(self) -> int:
        """Return the first of the stages at the end of the chain that keep no nonlinear state."""
        first = len(self._stages)
        while first and self._is_linear(first - 1):
            first -= 1
        return first

    def _is_linear(self, k: int) -> bool:
        """Return whether a stage is affine, and all of its states are in its linear tail."""
        stage, tail = self._stages[k], self._tails[k]
        if isinstance(stage, PathStage) or not self.affine(k, 0):
            return False
        states = stage.initial_state(self._target.dt, 0.0).size
        return states == (0 if tail is None else len(self._released(k, tail)))

    def difference(self, first: int, states: State, others: State) -> FloatArray:
        """Return the free response to the difference of the states of stages from `first` on."""
        change = np.zeros(self._target.drive.size - self._target.origin)
        for k in range(first, len(self._stages)):
            tail = self._tails[k]
            if tail is not None:
                change += (states[k] - others[k]) @ self._released(k, tail)
        return change

    def step(self, first: int) -> FloatArray:
        """Return the response of the stages from `first` on to a unit step, shape (n,)."""
        key, count = self._key(first)
        return _remembered(
            self._stages[first], 'step', key, lambda: self._passed_on(first, np.ones(count))
        )

    def _key(self, k: int) -> tuple[object, int]:
        """Return what the responses of the stages from `k` on depend on, and their length."""
        own = np.concatenate([self._packed[stage.columns] for stage in self._stages[k:]])
        count = self._target.drive.size - self._target.origin
        return (k, own.tobytes(), self._target.dt, count, self._target.frequency), count

    def _released(self, k: int, tail: _Tail) -> FloatArray:
        """Return the displacement by a unit offset of each state in a tail, shape (q, n)."""
        key, _ = self._key(k)
        return _remembered(self._stages[k], 'passed_on', key, lambda: self._release(k, tail))

    def _release(self, k: int, tail: _Tail) -> FloatArray:
        """Return the displacement by a unit offset of each state in a tail, shape (q, n)."""
        dt, count = self._target.dt, self._target.drive.size - self._target.origin
        free = tail.stage.released(tail.values, dt, count)
        stage = self._stages[k]
        on_a_path = isinstance(stage, PathStage) and stage.run.steps(
            self._packed[stage.columns], dt
        )
        if on_a_path and not tail.stage.ahead:
            free = free.copy()
            free[:, 0] = 0.0  # the last reading is a separate state in this case
        if k + 1 == len(self._stages):
            return free
        return np.array([self._passed_on(k + 1, row) for row in free])

    def _passed_on(self, first: int, change: FloatArray) -> FloatArray:
        """Return the response of the stages from `first` on to a change of their input."""
        target = self._target
        usual, moved = np.zeros_like(change), change  # other inputs cancel: all are affine
        for stage in self._stages[first:]:
            p, pair = self._packed[stage.columns], []
            for signal in (usual, moved):
                state = stage.initial_state(target.dt, 0.0)
                pair.append(
                    stage.respond(signal, p, target.dt, state=state, frequency=target.frequency)
                )
            usual, moved = pair
        return moved - usual

    def _tail_of(self, k: int) -> _Tail | None:
        """Return the linear tail of a stage, None if it has none."""
        stage, dt = self._stages[k], self._target.dt
        p = self._packed[stage.columns]
        if not all(self.affine(later, 0) for later in range(k + 1, len(self._stages))):
            return None
        if isinstance(stage, TickStage):
            linear = stage.block.between is Between.LINEAR
            return _Tail(as_linear(stage.block), p, 0) if linear else None
        if isinstance(stage, LinearStage):
            return None if stage.delays else _Tail(stage, p, 0)
        assert isinstance(stage, PathStage)
        if stage.run.delays:
            return None
        parts, memories = stage.run.parts, stage.run.layout(dt).memories
        first = len(parts)
        while first and parts[first - 1].block.system is not None:
            first -= 1
        if first == len(parts):
            return None
        begin = parts[first].span.start
        kept = [
            PlacedBlock(part.block, slice(part.span.start - begin, part.span.stop - begin))
            for part in parts[first:]
        ]
        tail = LinearStage(tuple(kept), np.arange(begin, p.size), 0, stage.run.ahead)
        return _Tail(tail, p[begin:], memories[first].start)


def _reach(tail: _Tail, dt: float, count: int) -> FloatArray:
    """Return the largest value of each state of a tail under a unit step."""
    state = tail.stage.initial_state(dt, 0.0)
    most, step = np.zeros(state.size), np.ones(count)
    ends = np.unique(np.minimum(2 ** np.arange(count.bit_length() + 1), count))
    for low, high in pairwise((0, *(int(end) for end in ends))):
        tail.stage.respond(step[low:high], tail.values, dt, state=state, frequency=0.0)
        most = np.maximum(most, np.abs(state))
    return most


def _remembered(
    owner: object, name: str, key: object, made: Callable[[], FloatArray]
) -> FloatArray:
    """Return what was made for a key; hundreds of starts are tested with the same parameters."""
    known: dict[object, FloatArray] = owner.__dict__.get(f'_{name}', {})
    if key in known:
        return known[key]
    new = made()
    size = new.size + sum(each.size for each in known.values())
    # shared by threads, therefore replaced and never changed
    owner.__dict__[f'_{name}'] = {**known, key: new} if size <= _MOST_KEPT else {key: new}
    return new


def _passes(block: Block) -> bool:
    """Return whether the response of a block to a change is independent of its input."""
    if block.between in (Between.LINEAR, Between.DELAY, Between.CLOCK):
        return True
    return block.between is Between.INSTANT and _straight(block)


@cache
def _straight(block: Block) -> bool:
    """Return whether a block without memory is affine for all parameters."""
    rng = np.random.default_rng(0)
    own = np.array([q.default + q.scale * rng.uniform(0.5, 1.5) for q in block.parameters])
    x = np.array([-1.0, -0.25, 0.0, 1.0, 3.0])
    answer = block.respond(x, own, 1.0, state=np.empty(0))
    line = answer[2] + (answer[3] - answer[2]) * x
    return bool(np.allclose(answer, line, rtol=1e-12, atol=1e-12 * float(np.ptp(answer))))
