"""What the unknown states at the start of a record do to its samples.

Every state of the dynamics (position and velocity of a mode, elements of creep, a lag) is moved
where the record begins, and so is every level of the voltage before it, which the memory still
knows; what follows is a transient that no parameter of a model at rest explains. A state is moved
by as much as the strongest input of the record could move it: what the actuator went through
before was no stronger.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.identification.record_start import path_to
from piezo_hysteresis.identification.sensitivities import parameter_step
from piezo_hysteresis.identification.targets import Target
from piezo_hysteresis.models import Model
from piezo_hysteresis.models.stages import LinearStage, Stage, free_states

# A level of the voltage before a record is moved by this share of the largest one.
_LEVEL = 3e-3
# What does less than this share of the stroke is of no use.
_LEAST = 1e-9

#: Reads what a chain answers as the recording does, shape (n,) to (m,).
Reader = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True)
class _Kick:
    """A state that is moved: number of its stage, and place in it."""

    stage: int
    place: int


class StartResponse:
    """The answer of a chain to the unknown states at the start of a record.

    Parameters
    ----------
    model : Model
        The chain.
    packed : ndarray, shape (p,)
        Its parameters.
    target : Target
        That begins in a way that is estimated.
    read : callable
        Reads an answer over the whole drive of `target` as the recording does.

    Attributes
    ----------
    rows : ndarray, shape (q, m)
        What each does that lies where it may be expected at most [m].
    """

    def __init__(self, model: Model, packed: FloatArray, target: Target, read: Reader) -> None:
        self._model, self._packed, self._target, self._read = model, packed, target, read
        self._kicks: list[_Kick] = []
        self._begun = self._start_of(target.begins.levels)
        signal = np.ascontiguousarray(target.voltage[target.origin :], dtype=np.float64)
        self._entering = list(self._followed(0, signal, self._begun))
        self._usual = self._entering[-1]
        self.rows = self._rows()

    def slopes(self, free: Sequence[str], shares: FloatArray) -> FloatArray:
        """Return how the sum of the rows moves with the parameters, shape (len(free), m).

        Rows of the states alone count, and parameters of the blocks that have them: the transient
        of a creep that was under way decays with the time constants of the creep.

        Parameters
        ----------
        free : sequence of str
            Parameters.
        shares : ndarray, shape (q,)
            How much of each row there is.
        """
        slopes = np.zeros((len(free), self._target.measured.size))
        for k in sorted({kick.stage for kick in self._kicks}):
            columns = self._model.stages[k].columns
            p = self._packed[columns]
            own = [self._model.parameters[c] for c in np.arange(self._packed.size)[columns]]
            most = np.zeros(self._begun[k].size)
            for kick, share in zip(self._kicks, shares, strict=False):
                if kick.stage == k:
                    most[kick.place] = share
            usual = self._alone(k, p, most)
            for row, place in self._touched(free, k).items():
                moved = p.copy()
                moved[place] += parameter_step(own[place], p[place])
                slopes[row] = (self._alone(k, moved, most) - usual) / (moved[place] - p[place])
        return slopes

    def _touched(self, free: Sequence[str], k: int) -> dict[int, int]:
        """Return row in `free` and place in the stage `k` of every parameter of that stage."""
        names = self._model.parameter_names
        own = np.arange(self._packed.size)[self._model.stages[k].columns]
        return {free.index(names[c]): j for j, c in enumerate(own) if names[c] in free}

    def _rows(self) -> FloatArray:
        target = self._target
        least = _LEAST * (float(np.ptp(target.measured)) or 1.0)
        levels = target.begins.levels
        rows: list[FloatArray] = []

        def used(row: FloatArray) -> bool:
            size = float(np.max(np.abs(row), initial=0.0))
            if np.isfinite(size) and size > least:
                rows.append(row)
                return True
            return False

        for k, stage in enumerate(self._model.stages):
            places = free_states(stage, target.dt)
            if places:
                p = self._packed[stage.columns]
                reach = self._reach(stage, p, self._entering[k])
                for place, row in zip(places, self._released(k, p, reach), strict=True):
                    if used(self._behind(k, row)):
                        self._kicks.append(_Kick(k, place))
        largest = float(np.max(np.abs(target.voltage)))
        for j, level in enumerate(levels):
            other = (*levels[:j], level + _LEVEL * largest, *levels[j + 1 :])
            moved = self._run(0, target.voltage[target.origin :], self._start_of(other))
            used(self._read(self._whole(moved - self._usual)) / _LEVEL)
        return np.array(rows).reshape(len(rows), target.measured.size)

    def _alone(self, k: int, p: FloatArray, shares: FloatArray) -> FloatArray:
        """Return what the states of stage `k` do together, each as much as it is there."""
        stage = self._model.stages[k]
        places = free_states(stage, self._target.dt)
        rows = self._released(k, p, self._reach(stage, p, self._entering[k]))
        return self._behind(k, shares[places.start : places.stop] @ rows)

    def _released(self, k: int, p: FloatArray, reach: FloatArray) -> FloatArray:
        """Return what each free state of stage `k` does to the output of the stage."""
        stage, target, count = self._model.stages[k], self._target, self._entering[k].size
        places = free_states(stage, target.dt)
        if isinstance(stage, LinearStage):
            return stage.released(p, target.dt, reach[places.start : places.stop], count)
        still, rows = np.zeros(count), np.empty((len(places), count))
        for row, place in enumerate(places):
            state = stage.initial_state(target.dt, target.start)
            state[place] += reach[place]
            rows[row] = stage.respond(still, p, target.dt, state=state, frequency=target.frequency)
        return rows

    def _behind(self, k: int, moved: FloatArray) -> FloatArray:
        """Return what is read of a change of the output of stage `k`, shape (m,)."""
        answer = self._run(k + 1, self._entering[k + 1] + moved, self._begun) - self._usual
        return self._read(self._whole(answer))

    def _whole(self, answer: FloatArray) -> FloatArray:
        """Return an answer with what came before the record, where it stands still."""
        return np.concatenate([np.full(self._target.origin, answer[0]), answer])

    def _reach(self, stage: Stage, p: FloatArray, signal: FloatArray) -> FloatArray:
        """Return how far a step as large as what enters the stage moves its states at most.

        They are looked at after one tick, after two, four and so on to the end.
        """
        target = self._target
        state = stage.initial_state(target.dt, target.start)
        most = np.zeros(state.size)
        step = np.full(signal.size, float(np.max(np.abs(signal))))
        ends = np.unique(np.minimum(2 ** np.arange(signal.size.bit_length() + 1), signal.size))
        for low, high in pairwise((0, *ends)):
            stage.respond(step[low:high], p, target.dt, state=state, frequency=target.frequency)
            most = np.maximum(most, np.abs(state))
        return most

    def _start_of(self, levels: tuple[float, ...]) -> list[FloatArray]:
        """Return the states with which the record begins."""
        target = self._target
        start = replace(target.begins, levels=levels)
        before = path_to(target.voltage[target.origin : target.origin + 2], start, target.dt)
        state = self._model.initial_state(target.dt, target.start)
        self._model.respond(
            before, self._packed, target.dt, state=state, frequency=target.frequency
        )
        return state

    def _run(self, first: int, signal: FloatArray, begun: Sequence[FloatArray]) -> FloatArray:
        """Return the answer of the stages from `first` on, from the states `begun`."""
        *_, answer = self._followed(first, signal, begun)
        return answer

    def _followed(
        self, first: int, signal: FloatArray, begun: Sequence[FloatArray]
    ) -> Iterator[FloatArray]:
        """Yield what enters each stage from `first` on, and the answer of the last."""
        target = self._target
        yield signal
        for stage, state in zip(self._model.stages[first:], begun[first:], strict=True):
            signal = stage.respond(
                signal,
                self._packed[stage.columns],
                target.dt,
                state=state.copy(),
                frequency=target.frequency,
            )
            yield signal
