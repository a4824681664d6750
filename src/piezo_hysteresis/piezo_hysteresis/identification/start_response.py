"""What the unknown states at the start of a record do to its samples.

Every state of the dynamics (position and velocity of a mode, elements of creep, a lag) is moved
where the record begins, and so is every level of the voltage before it, which the memory still
knows; what follows is a transient that no parameter of a model at rest explains. A state is moved
by as much as the strongest input of the record could move it: what the actuator went through
before was no stronger.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.identification.record_start import path_to
from piezo_hysteresis.identification.sensitivities import parameter_step
from piezo_hysteresis.identification.targets import Target
from piezo_hysteresis.models import Model
from piezo_hysteresis.models.stages import free_states

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
        places = self._touched(free)
        kicks = list(zip(self._kicks, shares, strict=False))
        if not places or not any(share != 0.0 for _, share in kicks):
            return slopes
        usual = self._after(self._packed, kicks)
        for row, place in places.items():
            moved = self._packed.copy()
            moved[place] += parameter_step(self._model.parameters[place], moved[place])
            step = moved[place] - self._packed[place]
            slopes[row] = (self._after(moved, kicks) - usual) / step
        return slopes

    def _touched(self, free: Sequence[str]) -> dict[int, int]:
        """Return row in `free` and place of every parameter of a stage whose states are moved."""
        columns, names = np.arange(self._packed.size), self._model.parameter_names
        stages = {kick.stage for kick in self._kicks}
        own = [int(c) for k in sorted(stages) for c in columns[self._model.stages[k].columns]]
        return {free.index(names[place]): place for place in own if names[place] in free}

    def _rows(self) -> FloatArray:
        model, target, packed = self._model, self._target, self._packed
        least = _LEAST * (float(np.ptp(target.measured)) or 1.0)
        levels = target.begins.levels
        begun = self._begun(packed, levels)
        usual = self._run(packed, begun)
        reach = self._reach(packed, begun)
        rows: list[FloatArray] = []

        def used(row: FloatArray) -> bool:
            size = float(np.max(np.abs(row), initial=0.0))
            if np.isfinite(size) and size > least:
                rows.append(row)
                return True
            return False

        for k, stage in enumerate(model.stages):
            for place in free_states(stage, target.dt):
                state = [each.copy() for each in begun]
                state[k][place] += reach[k][place]
                if used(self._read(self._run(packed, state) - usual)):
                    self._kicks.append(_Kick(k, place))
        largest = float(np.max(np.abs(target.voltage)))
        for k, level in enumerate(levels):
            other = (*levels[:k], level + _LEVEL * largest, *levels[k + 1 :])
            moved = self._run(packed, self._begun(packed, other))
            used(self._read(moved - usual) / _LEVEL)
        return np.array(rows).reshape(len(rows), target.measured.size)

    def _after(self, packed: FloatArray, kicks: Sequence[tuple[_Kick, float]]) -> FloatArray:
        """Return what all states do together, each as much as it is there, shape (m,)."""
        begun = self._begun(packed, self._target.begins.levels)
        reach = self._reach(packed, begun)
        state = [each.copy() for each in begun]
        for kick, share in kicks:
            state[kick.stage][kick.place] += share * reach[kick.stage][kick.place]
        return self._read(self._run(packed, state) - self._run(packed, begun))

    def _reach(self, packed: FloatArray, begun: Sequence[FloatArray]) -> list[FloatArray]:
        """Return how far the record can move every state at most: by a step as large as its drive.

        The states are looked at after one tick, after two, four and so on to the end.
        """
        target, model = self._target, self._model
        signal = target.voltage[target.origin :]
        ends = np.unique(np.minimum(2 ** np.arange(signal.size.bit_length() + 1), signal.size))
        found = []
        for stage, first in zip(model.stages, begun, strict=True):
            p, most = packed[stage.columns], np.zeros(first.size)
            places = free_states(stage, target.dt)
            if places:
                step = np.full(signal.size, float(np.max(np.abs(signal))))
                state = stage.initial_state(target.dt, target.start)
                for low, high in pairwise((0, *ends)):
                    stage.respond(
                        step[low:high], p, target.dt, state=state, frequency=target.frequency
                    )
                    most = np.maximum(most, np.abs(state))
            found.append(most)
            signal = stage.respond(
                signal, p, target.dt, state=first.copy(), frequency=target.frequency
            )
        return found

    def _begun(self, packed: FloatArray, levels: tuple[float, ...]) -> list[FloatArray]:
        """Return the states with which the record begins."""
        target = self._target
        start = replace(target.begins, levels=levels)
        before = path_to(target.voltage[target.origin : target.origin + 2], start, target.dt)
        state = self._model.initial_state(target.dt, target.start)
        self._model.respond(before, packed, target.dt, state=state, frequency=target.frequency)
        return state

    def _run(self, packed: FloatArray, begun: Sequence[FloatArray]) -> FloatArray:
        """Return the answer over the whole drive; before the record it stands still."""
        target = self._target
        y = self._model.respond(
            target.voltage[target.origin :],
            packed,
            target.dt,
            state=[each.copy() for each in begun],
            frequency=target.frequency,
        )
        return np.concatenate([np.full(target.origin, y[0]), y])
