"""Initial state of a record, and the free response of the linear blocks.

The history before a record is simulated by a lead-in. A lead-in does not determine the states of
the actuator at the first sample (position and velocity of a mode, h of a Bouc-Wen loop, elements
of creep), the earlier voltage levels that a hysteresis depends on, and the input that was held
before the first sample.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from piezo_hysteresis.arrays import BoolArray, FloatArray
from piezo_hysteresis.blocks.base import Block, InterSample
from piezo_hysteresis.identification.fit_data import FitData
from piezo_hysteresis.identification.initial_conditions.record_start import path_to
from piezo_hysteresis.identification.sensitivities import StateOffset
from piezo_hysteresis.models import Model
from piezo_hysteresis.models.chain import State
from piezo_hysteresis.models.simulation.plan import (
    LinearStage,
    PathStage,
    TickStage,
    as_linear,
    free_states,
)
from piezo_hysteresis.models.simulation.state_layout import PlacedBlock
from piezo_hysteresis.numerics.linalg import solve_square
from piezo_hysteresis.numerics.qr import gram, products

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
        self, model: Model, packed: FloatArray, led: Sequence[FloatArray], target: FitData
    ) -> None:  # packed (p,)
        self._stages, self._packed = model.stages, packed
        self._led, self._target = led, target
        self._tails = [self._tail_of(k) for k in range(len(self._stages))]

    def affine_from(self, first: int) -> bool:
        """Return whether the stages from `first` on respond linearly to a change."""
        return all(_passes(block) for stage in self._stages[first:] for block in stage.blocks)

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
        if isinstance(stage, PathStage) or not all(map(_passes, stage.blocks)):
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
        if not self.affine_from(k + 1):
            return None
        if isinstance(stage, TickStage):
            linear = stage.block.between is InterSample.LINEAR
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
    if block.between in (InterSample.LINEAR, InterSample.DELAY, InterSample.CLOCK):
        return True
    return block.between is InterSample.INSTANT and _straight(block)


@cache
def _straight(block: Block) -> bool:
    """Return whether a block without memory is affine for all parameters."""
    rng = np.random.default_rng(0)
    own = np.array([q.default + q.scale * rng.uniform(0.5, 1.5) for q in block.parameters])
    x = np.array([-1.0, -0.25, 0.0, 1.0, 3.0])
    answer = block.respond(x, own, 1.0, state=np.empty(0))
    line = answer[2] + (answer[3] - answer[2]) * x
    return bool(np.allclose(answer, line, rtol=1e-12, atol=1e-12 * float(np.ptp(answer))))


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

    def __init__(self, model: Model, packed: FloatArray, target: FitData) -> None:  # packed (p,)
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
        self.free_response = FreeResponse(model, packed, self._led, target)
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
        others = tuple(each for each in moved if not self.free_response.holds(each))
        self.response = self._run_from(others) if others else self._led[-1]
        if len(others) < len(moved):
            self.response = self.response + self.free_response.response(moved)

    def in_proportion(self, moved: StateOffset) -> bool:
        """Return whether the response is proportional to the offset of a state."""
        return self.free_response.holds(moved) or self.free_response.affine_from(moved.stage)

    def nudged(self, nudge: StateOffset) -> FloatArray:
        """Return the change of the displacement by an offset of one state, shape (n,)."""
        if self.free_response.holds(nudge):
            return self.free_response.response((nudge,))
        return self._run_from((nudge,)) - self._led[-1]

    def driven(self, drive: FloatArray) -> FloatArray:
        """Return the displacement for another drive as long as that of the target, shape (n,)."""
        first, begin = self.free_response.last_linear(), self.target.origin
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
        late, free = self._led[-1][end:], self.free_response
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
    reach = motion.free_response.reach()
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
