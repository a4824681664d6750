"""Runs of a chain from an unknown initial state, and the sensitivity of the output to that state.

The history before a record is simulated by a lead-in. A lead-in does not determine the states of
the actuator at the first sample (position and velocity of a mode, h of a Bouc-Wen loop, elements
of creep), the earlier voltage levels that a hysteresis depends on, and the input that was held
before the first sample.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from piezo_hysteresis.arrays import BoolArray, FloatArray
from piezo_hysteresis.identification.initial_conditions.free_response import FreeResponse
from piezo_hysteresis.identification.initial_conditions.record_start import path_to
from piezo_hysteresis.identification.sensitivities import StateOffset
from piezo_hysteresis.identification.targets import Target
from piezo_hysteresis.models import Model
from piezo_hysteresis.models.chain import State
from piezo_hysteresis.models.simulation.plan import PathStage, free_states
from piezo_hysteresis.numerics.linalg import solve_square
from piezo_hysteresis.numerics.qr import gram, products

# Step of an initial state for its sensitivity, as a share of its size.
_NUDGE = 1e-2
# Step of a voltage level before the record, as a share of the largest voltage.
_LEVEL = 3e-3
# Samples after which the decay of a response is first checked, then after twice as many, and the
# share of its maximum at which it has decayed.
_PIECE = 512
_FADED = 1e-7
# Share of the input of linear stages by which a constant difference may vary.
_EQUAL = 1e-13
# Rows with an effect below this share of the stroke are ignored.
_NOTHING = 1e-11


class InitialStateRun:
    """Free runs of a chain over one target, lead-in included, from offset initial states.

    The response to an offset decays; it is simulated only until it has.
    """

    def __init__(self, model: Model, packed: FloatArray, target: Target) -> None:  # packed (p,)
        self.model, self.target = model, target
        self._packed = packed
        self._grids = [
            {'steps': stage.run.steps(packed[stage.columns], target.dt)}
            if isinstance(stage, PathStage)
            else {}
            for stage in model.stages
        ]
        self.places = tuple(
            (k, place)
            for k, stage in enumerate(model.stages)
            # levels before a record determine every memory, also one with a single state
            for place in free_states(stage, target.dt, memory=not target.begins.levels)
        )
        self._states: list[FloatArray] = []  # at the first sample, after the lead-in
        self._sizes: list[FloatArray] = []
        self._led = [target.drive]
        for k, stage in enumerate(model.stages):
            state = stage.initial_state(target.dt, target.start)
            before = self._through(k, self._led[k][: target.origin], packed, state)
            self._states.append(state.copy())
            after = self._through(k, self._led[k][target.origin :], packed, state)
            self._sizes.append(np.maximum(np.abs(self._states[k]), np.abs(state)))
            self._led.append(np.concatenate([before, after]))
        self._free_response = FreeResponse(model, packed, self._led, target)
        self.moved: tuple[StateOffset, ...] = ()
        #: Displacement from the offset states, shape (n,) [m].
        self.response = self._led[-1]

    def _through(
        self, k: int, signal: FloatArray, packed: FloatArray, state: FloatArray
    ) -> FloatArray:
        stage, target = self.model.stages[k], self.target
        return stage.respond(
            np.ascontiguousarray(signal),
            packed[stage.columns],
            target.dt,
            state=state,
            frequency=target.frequency,
            **self._grids[k],
        )

    def go(self, moved: tuple[StateOffset, ...]) -> None:
        """Set the offsets of the initial state and simulate."""
        self.moved = moved
        others = tuple(each for each in moved if not self._free_response.holds(each))
        self.response = self._run_from(others) if others else self._led[-1]
        if len(others) < len(moved):
            self.response = self.response + self._free_response.response(moved)

    def in_proportion(self, moved: StateOffset) -> bool:
        """Return whether the response is proportional to the offset of a state."""
        return self._free_response.holds(moved) or self._affine_from(moved.stage)

    def _affine_from(self, first: int) -> bool:
        return all(self._free_response.affine(k, 0) for k in range(first, len(self.model.stages)))

    def reach(self) -> dict[tuple[int, int], float]:
        """Return the largest values expected of linear states, see `FreeResponse.reach`."""
        return self._free_response.reach()

    def nudged(self, nudge: StateOffset) -> FloatArray:
        """Return the change of the displacement by an offset of one state, shape (n,)."""
        if self._free_response.holds(nudge):
            return self._free_response.response((nudge,))
        return self._run_from((nudge,)) - self._led[-1]

    def driven(self, drive: FloatArray) -> FloatArray:
        """Return the displacement for another drive as long as that of the target, shape (n,)."""
        first, begin = self._free_response.last_linear(), self.target.origin
        states, signal = self.model.initial_state(self.target.dt, self.target.start), drive
        for k in range(first):
            signal = self._through(k, signal, self._packed, states[k])
        change = signal[begin:] - self._led[first][begin:]
        limit = _EQUAL * float(np.max(np.abs(signal)))
        unlike = np.flatnonzero(~(np.abs(change - change[-1]) <= limit))
        end = begin + (int(unlike[-1]) + 1 if unlike.size else 0)
        if first == len(states) or 2 * end > signal.size:
            return self._onward(first, signal, states)
        return self._rejoined(first, signal[:end], states, float(change[-1]))

    def _onward(self, first: int, signal: FloatArray, states: State) -> FloatArray:
        """Return the displacement for an input of stage `first`; `states` in place."""
        for k in range(first, len(states)):
            signal = self._through(k, signal, self._packed, states[k])
        return signal

    def _rejoined(self, first: int, signal: FloatArray, states: State, later: float) -> FloatArray:
        """Return the displacement for an input that differs by a constant after its first samples.

        Of the earlier differences only those of the states of the linear stages last.
        """
        begin, end = self.target.origin, signal.size
        y, usual = self._onward(first, signal, states), [state.copy() for state in self._states]
        self._onward(first, self._led[first][begin:end], usual)
        late, free = self._led[-1][end:], self._free_response
        change = free.difference(first, states, usual) + later * free.step(first)
        return np.concatenate([y, late + change[: late.size]])

    def _run_from(self, moved: tuple[StateOffset, ...]) -> FloatArray:
        """Return the displacement from offset states, simulated until they have no effect.

        A memory of levels responds at once, so that no change returns after the response has
        decayed.
        """
        count, first = len(self.model.stages), min(each.stage for each in moved)
        states = {k: self._states[k].copy() for k in range(first, count)}
        for each in moved:
            states[each.stage][each.place] += each.amount
        y = self._led[-1].copy()
        begin, peak, length = self.target.origin, 0.0, _PIECE
        while begin < y.size:
            piece = slice(begin, begin + length)
            signal = self._led[first][piece]
            for k in range(first, count):
                signal = self._through(k, signal, self._packed, states[k])
            change = float(np.max(np.abs(signal - y[piece])))
            y[piece] = signal
            begin, peak, length = begin + length, max(peak, change), 2 * length
            if not change > _FADED * peak:
                break
        return y

    def size(self, stage: int, place: int, otherwise: float) -> float:
        """Return the magnitude of a state at the first and last sample."""
        seen = float(self._sizes[stage][place])
        return seen if seen > 0.0 and np.isfinite(seen) else otherwise


def start_rows(motion: InitialStateRun) -> tuple[list[FloatArray], list[StateOffset]]:
    """Return the responses to offsets of the initial state, each of shape (n,)."""
    # -> rows [m]
    target = motion.target
    stroke = float(np.ptp(target.measured)) or 1.0
    reach = motion.reach()
    rows: list[FloatArray] = []
    moved: list[StateOffset] = []
    for k, place in motion.places:
        known = (k, place) in reach
        amount = reach[k, place] if known else _NUDGE * motion.size(k, place, stroke)
        if not amount > 0.0:
            continue
        row = motion.nudged(StateOffset(k, place, amount))
        size = float(np.max(np.abs(row), initial=0.0))
        if not _NOTHING * stroke < size < np.inf:
            continue
        share = 1.0 if known else stroke / size
        rows.append(share * row)
        moved.append(StateOffset(k, place, share * amount))
    return rows, moved


def level_rows(motion: InitialStateRun) -> list[FloatArray]:
    """Return the derivatives by levels before a record, per largest voltage, each shape (n,)."""
    target, rows = motion.target, list[FloatArray]()
    known = () if target.begins.held else target.begins.levels
    largest = float(np.max(np.abs(target.voltage)))
    for k, level in enumerate(known):
        other = (*known[:k], level + _LEVEL * largest, *known[k + 1 :])
        start = replace(target.begins, levels=other)
        before = path_to(target.voltage[target.origin : target.origin + 2], start, target.dt)
        drive = np.concatenate([before, target.drive[target.origin :]])
        rows.append((motion.driven(drive) - motion.response) / _LEVEL)
    return rows


class BestFit:
    """Weighted least squares of an error on rows, with a prior."""

    def __init__(self, rows: FloatArray, prior: FloatArray) -> None:
        # rows [m] (q, m); prior [m] (q,)
        self._rows, self._prior = np.ascontiguousarray(rows), prior
        self._gram = gram(self._rows)
        self._gram[np.diag_indices(len(prior))] += prior**2

    def __call__(
        self, error: FloatArray, pull: FloatArray, among: BoolArray | None = None
    ) -> FloatArray:  # error [m] (m,); pull, among (q,)
        """Return the coefficients of the best fit, shape (q,)."""
        target = products(self._rows, np.ascontiguousarray(error)) - self._prior**2 * pull
        if among is None or np.all(among):
            return _solved(self._gram, target)
        found = np.zeros(target.size)
        found[among] = _solved(self._gram[np.ix_(among, among)], target[among])
        return found


def _solved(square: FloatArray, target: FloatArray) -> FloatArray:
    if target.size == 1 and square[0, 0] > 0.0:
        return np.asarray(target / square[0, 0])
    return solve_square(square, target).values
