"""Derivatives through a block and between the ticks, by generated kernels.

Each piece propagates them: linear ones with their own step, the others with the generated
derivative of their kernel. The cost of a parameter is that of its piece and the following ones,
not that of the whole run.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple, Protocol

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Block, InterSample
from piezo_hysteresis.blocks.parallel import parts_of
from piezo_hysteresis.blocks.transport_delay import shift
from piezo_hysteresis.kernels.forward import directional, directions_of
from piezo_hysteresis.models.simulation.state_layout import StateJump, systems_of
from piezo_hysteresis.models.simulation.state_space import (
    LinearStep,
    in_series,
    run_path,
    run_path_four,
    step_of,
)
from piezo_hysteresis.models.simulation.substep_run import (
    PathClock,
    PathPiece,
    PathRun,
    joined,
    moments,
    read_ticks,
    with_turns,
    without_turns,
)

_VALUES = 1 << 17  # derivative values propagated at a time: fewer calls, and still in the cache
_BRANCH_OFFSET = 1e-6  # relative to the typical size


class BlockPoint(NamedTuple):
    """A block, its parameters, and the parameters to differentiate by."""

    block: Block
    values: FloatArray
    columns: list[int]  # indices of the parameters to differentiate by


Each = Callable[[BlockPoint, FloatArray, FloatArray], tuple[FloatArray, FloatArray]]
"""What a block makes of its input, given where it is, its memory and the derivatives of that."""


def sum_parallel(
    each: Each, at: BlockPoint, incoming: int, state: FloatArray, moved: FloatArray, dt: float
) -> tuple[FloatArray, FloatArray]:
    """Return the output of parallel blocks and its derivatives."""
    # state (s,); moved (incoming + q, s); dt [s] -> output (n,), answers (incoming + q, n)
    parts = parts_of(at.block)
    if len(parts) == 1:
        return each(at, state, moved)
    total: tuple[FloatArray, FloatArray] | None = None
    first = memory = 0
    for part in parts:
        last, end = first + len(part.parameters), memory + part.initial_state(dt).size
        mine = [k for k, column in enumerate(at.columns) if first <= column < last]
        places = [*range(incoming), *(incoming + k for k in mine)]
        part_at = BlockPoint(part, at.values[first:last], [at.columns[k] - first for k in mine])
        part_moved = moved[places, memory:end]
        output, found = each(part_at, state[memory:end], part_moved)
        if total is None:
            total = np.zeros_like(output), np.zeros((len(moved), output.size))
        total[0][:] += output
        total[1][places] += found
        moved[places, memory:end] = part_moved
        first, memory = last, end
    assert total is not None
    return total


def propagate_derivatives(
    kernel: Any,
    x: FloatArray,  # (n,)
    rows: FloatArray,  # (m, n)
    at: BlockPoint,
    state: FloatArray,  # (s,)
    moved: FloatArray,  # (m + q, s)
    *clock: Any,  # [s] [Hz]
) -> tuple[FloatArray, FloatArray]:  # -> output (n,), answers (m + q, n)
    """Return the output of a kernel and its derivatives; the states are updated in place."""
    block, p, columns = at
    if block.regressors is not None and any(columns):
        return _weighed(kernel, x, rows, at, state, moved, *clock)
    m, q, n = len(rows), len(columns), x.size
    output, answers = np.empty_like(x), np.empty((m + q, n))
    if state.size == 0 and m > 1:  # a static function: one slope for every row
        output, slopes = propagate_derivatives(
            kernel, x, np.ones((1, n)), at, state, moved[m - 1 :], *clock
        )
        np.multiply(slopes[0], rows, out=answers[:m])
        answers[m:] = slopes[1:]
        return output, answers
    if m + q == 0:
        kernel(x, output, state, p, *clock)
        return output, answers
    derivative = directional(kernel, p.size)
    own, lanes = derivative.own, derivative.lanes
    multiple = clock[2] if len(clock) > 2 else 1
    most = max(1, _VALUES // ((own + lanes) * multiple)) * multiple
    begin, count, first_moved = state.copy(), m if own else m + q, moved.copy()
    for first in range(0, max(count, 1), lanes):
        given = slice(first, min(first + lanes, count))
        here = slice(own, own + given.stop - first)
        incoming = max(min(m, given.stop) - first, 0)
        tangent = np.zeros((own + lanes, state.size))
        tangent[here] = moved[given]
        alone = own > 0 and first == 0  # its own parameters are in the first portion
        if alone:
            tangent[columns] = moved[m:]
        seeds = () if own else (_seeds(first, given.stop, m, columns, (lanes, p.size)),)
        state[:] = begin
        for start in range(0, n, most):
            chunk = slice(start, min(start + most, n))
            if start == 0 or chunk.stop - start < most:
                x_d, y_d = np.zeros((2, own + lanes, chunk.stop - start))
            x_d[own : own + incoming] = rows[first : first + incoming, chunk]
            derivative.run(x[chunk], output[chunk], state, p, *clock, x_d, y_d, tangent, *seeds)
            answers[given, chunk] = y_d[here]
            if alone:
                answers[m:, chunk] = y_d[columns]
        moved[given] = tangent[here]
        if alone:
            moved[m:] = tangent[columns]
    for k, column in enumerate(columns):
        if p[column] in (0.0, 1.0) and not np.any(answers[m + k]):
            # one at a time: a parameter without effect is moved off its value only for itself
            one = _off_branch(at, column)
            if one is not None:
                other = first_moved[m + k, None]
                found = propagate_derivatives(
                    kernel, x, rows[:0], one, begin.copy(), other, *clock
                )
                answers[m + k], moved[m + k] = found[1][0], other[0]
    return output, answers


def _weighed(
    kernel: Any,
    x: FloatArray,
    rows: FloatArray,
    at: BlockPoint,
    state: FloatArray,
    moved: FloatArray,
    *clock: Any,
) -> tuple[FloatArray, FloatArray]:
    """Do the same for a block that is linear in its weights, whose derivatives are its regressors.

    The generated derivative does not use this and takes 30 times as long for twenty plays.
    """
    block, p, columns = at
    regressors = np.empty((p.size - 1, x.size))
    assert block.regressors is not None
    block.regressors(x, regressors, state.copy(), p)
    others = [k for k, column in enumerate(columns) if column == 0]
    places = [*range(len(rows)), *(len(rows) + k for k in others)]
    rest, still = BlockPoint(block, p, [0] * len(others)), moved[places]
    output, found = propagate_derivatives(kernel, x, rows, rest, state, still, *clock)
    answers = np.empty((len(moved), x.size))
    answers[places], moved[places] = found, still
    for k, column in enumerate(columns, start=len(rows)):
        if column:
            answers[k] = regressors[column - 1]
    return output, answers


def _off_branch(at: BlockPoint, column: int) -> BlockPoint | None:
    """Return values slightly off a special case of a law; None if the bounds do not allow it.

    With an exponent of 1, or a share or time of 0, a law may use a simpler branch on which the
    derivative is zero.
    """
    parameter, values = at.block.parameters[column], at.values.copy()
    step = _BRANCH_OFFSET * parameter.scale
    values[column] += step if values[column] + step <= parameter.high else -step
    is_new = values[column] not in (0.0, 1.0) and not parameter.held
    return BlockPoint(at.block, values, [column]) if is_new else None


def _seeds(
    first: int, last: int, incoming: int, columns: Sequence[int], shape: tuple[int, int]
) -> FloatArray:
    """Return the seeds of the parameters for the derivatives `first` to `last`."""
    seeds = np.zeros(shape)
    for i in range(max(first, incoming), last):
        seeds[i - first, columns[i - incoming]] = 1.0
    return seeds


Around = Mapping[int, tuple[float, float]]
"""Values below and above, one of them the parameter itself where a bound leaves no room."""


class _Through(Protocol):
    """Propagates a path and its derivatives through a piece, portion by portion."""

    def go(self, path: FloatArray, rows: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return path and derivatives after the piece, those by its own parameters last."""


class _Linear:
    """Blocks that form one linear system; a parameter changes its step.

    The derivative of the states is a second system with the same step, driven by the first.
    """

    def __init__(
        self, piece: PathPiece, step: LinearStep, p: FloatArray, around: Around, h: float,
        state: FloatArray, incoming: int,
    ) -> None:  # fmt: skip
        self._step, self._state = step, state
        self._states = np.zeros((incoming, state.size))
        self._own = [
            (_moved_step(piece, step, p, column, around[column], h), np.zeros(2 * state.size))
            for column in _columns(piece, around)
        ]

    def offset(self, amounts: FloatArray) -> None:
        """Add offsets of the state to its copies for the derivatives by its own parameters."""
        for _, state in self._own:
            state[: amounts.size] += amounts

    def go(self, path: FloatArray, rows: FloatArray) -> tuple[FloatArray, FloatArray]:
        output, answers = np.empty_like(path), np.empty((len(rows) + len(self._own), path.size))
        m = len(rows)
        together = m if m % 4 == 3 else m - m % 4  # two are not faster if interleaved
        run_path_four(rows[:together], answers[:together], self._states[:together], *self._step)
        for j in range(together, m):
            run_path(rows[j], answers[j], self._states[j], *self._step)
        for answer, (step, state) in zip(answers[m:], self._own, strict=True):
            run_path(path, answer, state, *step)
        run_path(path, output, self._state, *self._step)
        return output, answers


class _Nonlinear:
    """One block, or parallel ones, by the derivatives of their kernels."""

    def __init__(
        self, piece: PathPiece, p: FloatArray, around: Around, clock: PathClock,
        state: FloatArray, incoming: int,
    ) -> None:  # fmt: skip
        ((self._block, span),) = piece.parts
        self._turns = piece.turns
        self._p, self._clock, self._state = p[span], clock, state
        self._columns = [column - span.start for column in _columns(piece, around)]
        self._moved = np.zeros((incoming + len(self._columns), state.size))

    def go(self, path: FloatArray, rows: FloatArray) -> tuple[FloatArray, FloatArray]:
        at = BlockPoint(self._block, self._p, self._columns)
        each = partial(self._of, path, rows)
        return sum_parallel(each, at, len(rows), self._state, self._moved, self._clock.dt)

    def _of(
        self,
        path: FloatArray,
        rows: FloatArray,
        at: BlockPoint,
        state: FloatArray,
        moved: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:
        block = at.block
        dt, frequency, points, _ = clock = self._clock
        if block.between is InterSample.CLOCK:
            return with_time(block, path, rows, at, state, clock)
        if block.path_kernel is not None:
            return propagate_derivatives(
                block.path_kernel, path, rows, at, state, moved, dt, frequency, points
            )
        turns = (
            self._turns and block.between is InterSample.PATH and self._block.path_kernel is None
        )
        if not turns:
            return propagate_derivatives(block.kernel, path, rows, at, state, moved, dt, 0.0)
        wide, late, wide_rows = turned(path, rows)
        y, found = propagate_derivatives(block.kernel, wide, wide_rows, at, state, moved, dt, 0.0)
        output, answers = np.empty_like(path), np.empty((len(found), path.size))
        for each, answer in zip((y, *found), (output, *answers), strict=True):
            without_turns(each, late, answer)
        return output, answers


def turned(path: FloatArray, rows: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return a path with its extrema, the half of the step of each, and derivatives there."""
    wide, late = np.empty(path.size // 3 * 4), np.empty(path.size // 3)
    with_turns(path, wide, late)
    answers, none = np.empty((len(rows), wide.size)), np.zeros((1, late.size))
    along = directions_of(with_turns, 1)
    for row, answer in zip(rows, answers, strict=True):
        along(path, wide, late, row[None], answer[None], none)
    return wide, late, answers


def with_time(
    block: Block,
    path: FloatArray,
    rows: FloatArray,
    at: BlockPoint,
    state: FloatArray,
    clock: PathClock,
) -> tuple[FloatArray, FloatArray]:
    """Return the output of a time-dependent block and its derivatives, see `intersample`."""
    count, steps = len(rows) + len(at.columns), clock.points // 3
    output, answers = np.empty_like(path), np.empty((count, path.size))
    for place, memory in moments(block, state, path.size // clock.points, steps, clock.ahead):
        part, still = np.ascontiguousarray(path[place]), np.zeros((count, state.size))
        output[place], answers[:, place] = propagate_derivatives(
            block.kernel, part, rows[:, place], at, memory, still, clock.dt / steps, 0.0
        )
    return output, answers


class PathTangents:
    """A run from rest and its derivatives, one value per tick, block by block of samples."""

    def __init__(
        self, run: PathRun, p: FloatArray, around: Around, dt: float, *, start: float,
        frequency: float, incoming: int,
    ) -> None:  # fmt: skip
        # dt, start [s]; frequency [Hz]
        steps, layout = run.steps(p, dt), run.layout(dt)
        self._timing, self._state = (
            run.timing(p, dt, is_joined=run.order(p) > 0.0),
            run.initial_state(dt, start),
        )
        self._rings = np.zeros((1 + incoming, self._state[layout.ring].size if run.delays else 0))
        self._order = run.order(p)
        self._pasts = np.zeros((1 + incoming, self._state[layout.past].size))
        self._clock = PathClock(dt, frequency, 3 * steps, self._timing.ahead)
        self._pieces: list[tuple[_Through, slice]] = []
        count = incoming
        for piece, step in zip(run.pieces(layout), run.made(p, dt, steps), strict=True):
            memory = self._state[piece.memory]
            made = _piece(piece, step, p, around, self._clock, memory, count)
            self._pieces.append((made, piece.memory))
            count += len(_columns(piece, around))
        self._last = np.zeros((1 + count, 1))
        self._last[0, 0] = self._state[0]

    def go(
        self, signal: FloatArray, tangent: FloatArray, jump: StateJump | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Return the output of the next samples and its derivatives."""
        # signal (n,); tangent (m, n) -> output (n,), rows (m + len(around)
        points, last, count = self._clock.points, self._last, len(self._last)
        if self._rings.shape[1]:
            late = zip((signal, *tangent), self._rings, strict=True)
            signal, *moved = (_late(row, self._timing.ticks, ring) for row, ring in late)
            tangent = np.array(moved).reshape(-1, signal.size)
        output, rows = np.empty(signal.size), np.empty((count - 1, signal.size))
        jump = jump or StateJump(0, np.zeros(self._state.size))
        for chunk in jump.chunks(signal.size, max(1, _VALUES // (points * count)), self._state):
            if chunk.start == jump.sample:
                last[0, 0] += jump.amounts[0]
                for each, memory in self._pieces:
                    if isinstance(each, _Linear):
                        each.offset(jump.amounts[memory])
            path, *inside = (
                self._path(row[chunk], past)
                for row, past in zip((signal, *tangent), self._pasts, strict=True)
            )
            along = np.array(inside).reshape(-1, path.size)
            for each, _ in self._pieces:
                path, along = each.go(path, along)
            read_ticks(path, output[chunk], last[0], points, self._timing.part)
            for j, row in enumerate(along):
                read_ticks(row, rows[j, chunk], last[1 + j], points, self._timing.part)
        return output, rows

    def _path(self, x: FloatArray, past: FloatArray) -> FloatArray:
        """Return the path of an input, or of its derivative: both are linear in their samples."""
        if not self._order > 0.0:
            return np.repeat(x, self._clock.points)
        path = np.empty(x.size * self._clock.points)
        joined(np.ascontiguousarray(x), path, past, self._order)
        return path


def _piece(
    piece: PathPiece, step: LinearStep | None, p: FloatArray, around: Around, clock: PathClock,
    state: FloatArray, incoming: int,
) -> _Through:  # fmt: skip
    if step is None:
        return _Nonlinear(piece, p, around, clock, state, incoming)
    return _Linear(piece, step, p, around, 3.0 * clock.dt / clock.points, state, incoming)


def _columns(piece: PathPiece, around: Around) -> list[int]:
    """Return the entries of `around` that are parameters of a piece."""
    inside = range(piece.parts[0].span.start, piece.parts[-1].span.stop)
    return [column for column in inside if column in around]


def _with(p: FloatArray, column: int, value: float) -> FloatArray:
    moved = p.copy()
    moved[column] = value
    return moved


def _moved_step(
    piece: PathPiece, step: LinearStep, p: FloatArray, column: int, around: tuple[float, float],
    h: float,
) -> LinearStep:  # fmt: skip
    """Return the step of states and of their derivatives by a parameter."""
    below, above = (
        step_of(in_series(systems_of(piece.parts, _with(p, column, value))), h) for value in around
    )
    phi, gamma, rows, gains = (
        (high - low) / (around[1] - around[0]) for low, high in zip(below, above, strict=True)
    )
    return LinearStep(
        np.block([[step.phi, phi], [np.zeros_like(phi), step.phi]]),
        np.vstack([step.gamma, gamma]),
        np.ascontiguousarray(np.hstack([rows, step.rows])),
        np.ascontiguousarray(gains),
    )


def _late(signal: FloatArray, ticks: int, ring: FloatArray) -> FloatArray:
    answer = np.empty(signal.size)
    shift(np.ascontiguousarray(signal), answer, ring, ticks)
    return answer
