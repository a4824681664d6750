"""Free response of the linear blocks at the end of a chain.

The response to an initial state depends neither on the drive nor on what it is added to: it is one
free response of a linear system, however finely the chain before it must be integrated.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache, lru_cache
from itertools import pairwise

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Between, Block
from piezo_hysteresis.identification.sensitivities import StateOffset
from piezo_hysteresis.identification.targets import Target
from piezo_hysteresis.models import Model
from piezo_hysteresis.models.simulation.plan import LinearStage, PathStage, TickStage
from piezo_hysteresis.models.simulation.state_layout import PlacedBlock


class FreeResponse:
    """States of the linear tail of a chain and their free response.

    Parameters
    ----------
    model : Model
        The chain.
    led : sequence of ndarray
        Input of each stage, and output of the last.
    target : Target
        What drives it.
    """

    def __init__(self, model: Model, led: Sequence[FloatArray], target: Target) -> None:
        self._stages, self._led, self._target = model.stages, led, target
        self._known: tuple[tuple[int, bytes], dict[int, FloatArray]] | None = None
        self._tail = [self._of(k) for k in range(len(self._stages))]

    def affine(self, stage: int, first: int) -> bool:
        """Return whether the blocks of a stage from `first` on respond linearly to a change."""
        return all(_passes(block) for block in self._stages[stage].blocks[first:])

    def holds(self, moved: StateOffset) -> bool:
        """Return whether a state belongs to a linear tail."""
        tail = self._tail[moved.stage]
        return tail is not None and moved.place >= tail[1]

    def reach(self, packed: FloatArray) -> dict[tuple[int, int], float]:
        """Return the largest value of each state in a tail under the largest input of the record.

        The input before the record is assumed to be no stronger. The response to a step of that
        size is evaluated after 1, 2, 4, ... ticks.
        """
        found: dict[tuple[int, int], float] = {}
        dt = self._target.dt
        for k, tail in enumerate(self._tail):
            if tail is None:
                continue
            stage, first = tail
            # what enters the tail of a path is not kept: what leaves it is as large
            inside = isinstance(self._stages[k], PathStage)
            size = float(np.max(np.abs(self._led[k + 1 if inside else k])))
            count = self._target.drive.size - self._target.origin
            state = stage.initial_state(dt, 0.0)
            most, step = np.zeros(state.size), np.full(count, size)
            ends = np.unique(np.minimum(2 ** np.arange(count.bit_length() + 1), count))
            for low, high in pairwise((0, *(int(end) for end in ends))):
                stage.respond(
                    step[low:high], packed[stage.columns], dt, state=state, frequency=0.0
                )
                most = np.maximum(most, np.abs(state))
            found |= {(k, first + i): float(value) for i, value in enumerate(most)}
        return found

    def rows(self, packed: FloatArray, moved: Sequence[StateOffset]) -> list[FloatArray]:
        """Return the displacement by each of some offsets in tails [m]."""
        answers: list[FloatArray] = []
        for each in moved:
            known = self._released(packed, each.stage)
            change = np.zeros(self._target.drive.size)
            change[self._target.origin :] = each.amount * known[each.place]
            answers.append(change)
        return answers

    def _released(self, packed: FloatArray, k: int) -> dict[int, FloatArray]:
        """Return the displacement by a unit offset of each state in the tail of a stage."""
        key = k, packed.tobytes()
        if self._known is not None and self._known[0] == key:
            return self._known[1]
        tail = self._tail[k]
        assert tail is not None
        stage, first = tail
        dt, count = self._target.dt, self._target.drive.size - self._target.origin
        size = stage.initial_state(dt, 0.0).size
        if isinstance(stage, LinearStage):
            free = stage.released(packed[stage.columns], dt, np.ones(size), count)
        else:
            free = _free_runs(stage.block, packed[stage.columns].tobytes(), dt, count).copy()
        if not stage.ahead and self._on_a_path(k, packed):
            free[:, 0] = 0.0  # there, what was read last is a state of its own
        rows = {first + i: self._passed_on(k + 1, packed, row) for i, row in enumerate(free)}
        self._known = key, rows
        return rows

    def response(self, packed: FloatArray, moved: Sequence[StateOffset]) -> FloatArray:
        """Return the displacement by offsets in tails together, shape (n,) [m].

        Parameters
        ----------
        packed : ndarray, shape (p,)
            Parameters of the chain.
        moved : sequence of StateOffset
            Offsets outside tails are ignored.
        """
        change = np.zeros(self._target.drive.size)
        origin, dt = self._target.origin, self._target.dt
        nothing = np.zeros(change.size - origin)
        for k, tail in enumerate(self._tail):
            mine = [each for each in moved if each.stage == k and self.holds(each)]
            if tail is None or not mine:
                continue
            stage, first = tail
            state = stage.initial_state(dt, 0.0)
            state[:] = 0.0
            for each in mine:
                state[each.place - first] += each.amount
            answer = stage.respond(nothing, packed[stage.columns], dt, state=state, frequency=0.0)
            if not stage.ahead and self._on_a_path(k, packed):
                answer[0] = 0.0  # there, what was read last is a state of its own
            change[origin:] += self._passed_on(k + 1, packed, answer)
        return change

    def _on_a_path(self, k: int, packed: FloatArray) -> bool:
        stage = self._stages[k]
        if not isinstance(stage, PathStage):
            return False
        return stage.run.steps(packed[stage.columns], self._target.dt) > 0

    def _passed_on(self, first: int, packed: FloatArray, change: FloatArray) -> FloatArray:
        """Return the response of the stages from `first` on to a change of their input."""
        if first == len(self._stages):
            return change
        target = self._target
        usual = self._led[first][target.origin :]
        moved = usual + change
        for stage in self._stages[first:]:
            p, pair = packed[stage.columns], []
            for signal in (usual, moved):
                state = stage.initial_state(target.dt, target.start)
                pair.append(
                    stage.respond(signal, p, target.dt, state=state, frequency=target.frequency)
                )
            usual, moved = pair
        return moved - usual

    def _of(self, k: int) -> tuple[LinearStage | TickStage, int] | None:
        """Return the linear tail of a stage, as a stage, and its first place in the state."""
        stage, dt = self._stages[k], self._target.dt
        if not all(self.affine(later, 0) for later in range(k + 1, len(self._stages))):
            return None
        if isinstance(stage, TickStage):
            return (stage, 0) if stage.block.between is Between.LINEAR else None
        if isinstance(stage, LinearStage):
            return None if stage.delays else (stage, 0)
        assert isinstance(stage, PathStage)
        if stage.run.delays:
            return None
        parts, memories = stage.run.parts, stage.run.layout(dt).memories
        first = len(parts)
        while first and parts[first - 1].block.system is not None:
            first -= 1
        if first == len(parts):
            return None
        begin, kept, columns = 0, [], []
        for part in parts[first:]:
            own = stage.columns[part.span]
            kept.append(PlacedBlock(part.block, slice(begin, begin + own.size)))
            columns.append(own)
            begin += own.size
        tail = LinearStage(tuple(kept), np.concatenate(columns), 0, stage.run.ahead)
        return tail, memories[first].start


def _passes(block: Block) -> bool:
    """Return whether the response of a block to a change is independent of its input."""
    if block.between in (Between.LINEAR, Between.DELAY, Between.CLOCK):
        return True
    return block.between is Between.INSTANT and _straight(block)


@lru_cache(maxsize=4)
def _free_runs(block: Block, packed: bytes, dt: float, count: int) -> FloatArray:
    """Return the free response from a unit value of each state, shape (states, count).

    Start hypotheses are tried by the hundred with the same parameters.
    """
    p, nothing = np.frombuffer(packed).copy(), np.zeros(count)
    states = np.eye(block.initial_state(dt).size)
    return np.array([block.respond(nothing, p, dt, state=state) for state in states])


@cache
def _straight(block: Block) -> bool:
    """Return whether a block without memory is a straight line, whatever its parameters."""
    rng = np.random.default_rng(0)
    own = np.array([q.default + q.scale * rng.uniform(0.5, 1.5) for q in block.parameters])
    x = np.array([-1.0, -0.25, 0.0, 1.0, 3.0])
    answer = block.respond(x, own, 1.0, state=np.empty(0))
    line = answer[2] + (answer[3] - answer[2]) * x
    return bool(np.allclose(answer, line, rtol=1e-12, atol=1e-12 * float(np.ptp(answer))))
