"""Derivatives of a run that is followed between the ticks, carried along its path.

Pieces pass them on one after another: linear ones by the step that they take themselves, blocks
with a compiled kernel by that, and the others by differences of that block alone. A parameter
costs its own piece and those behind it, and not the whole run.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.transport_delay import shift
from piezo_hysteresis.models.linear_runs import (
    LinearStep,
    in_series,
    run_path,
    run_path_four,
    step_of,
)
from piezo_hysteresis.models.parts import systems_of
from piezo_hysteresis.models.path_runs import PathClock, PathPiece, PathRun, followed, read_ticks

_VALUES = 1 << 15  # values of path and derivatives that are followed at a time
_STEP = 1e-6  # of a difference by what comes from upstream, over the size of the signal

Around = Mapping[int, tuple[float, float]]
"""Values below and above, one of them the parameter itself where a bound leaves no room."""


class _Through(Protocol):
    """Takes a path and what is carried along through a piece, and goes on from there."""

    def go(self, path: FloatArray, rows: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return path and rows behind the piece, those by its own parameters last."""


class _Linear:
    """Blocks that are one linear system; a parameter changes its step.

    What it does to the states is a second system of the same step behind the first.
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

    def go(self, path: FloatArray, rows: FloatArray) -> tuple[FloatArray, FloatArray]:
        output, answers = np.empty_like(path), np.empty((len(rows) + len(self._own), path.size))
        m = len(rows)
        together = m if m % 4 == 3 else m - m % 4  # two alone are no faster side by side
        run_path_four(rows[:together], answers[:together], self._states[:together], *self._step)
        for j in range(together, m):
            run_path(rows[j], answers[j], self._states[j], *self._step)
        for answer, (step, state) in zip(answers[m:], self._own, strict=True):
            run_path(path, answer, state, *step)
        run_path(path, output, self._state, *self._step)
        return output, answers


class _Carried:
    """A block that carries derivatives by a kernel of its own."""

    def __init__(
        self, piece: PathPiece, p: FloatArray, around: Around, clock: PathClock,
        state: FloatArray, incoming: int,
    ) -> None:  # fmt: skip
        ((self._block, span),) = piece.parts
        self._p, self._clock, self._state = p[span], clock, state
        by = [column - span.start for column in _columns(piece, around)]
        self._by = np.array(by, dtype=np.int64)
        self._moved = np.zeros((incoming + len(by), state.size))

    def go(self, path: FloatArray, rows: FloatArray) -> tuple[FloatArray, FloatArray]:
        output, answers = np.empty_like(path), np.empty((len(self._moved), path.size))
        assert self._block.carry is not None
        self._block.carry(
            path, output, rows, answers, self._state, self._moved, self._p, self._by,
            self._clock.dt, self._clock.points,
        )  # fmt: skip
        return output, answers


class _Differenced:
    """A block without such a kernel: it is followed once more for each derivative."""

    def __init__(
        self, piece: PathPiece, p: FloatArray, around: Around, clock: PathClock,
        state: FloatArray, sizes: Sequence[float],
    ) -> None:  # fmt: skip
        self._piece, self._p, self._clock, self._state = piece, p, clock, state
        self._sizes = sizes
        self._states = [state.copy() for _ in sizes]
        self._own = [
            (_with(p, column, _other(p, column, around)), state.copy())
            for column in _columns(piece, around)
        ]

    def go(self, path: FloatArray, rows: FloatArray) -> tuple[FloatArray, FloatArray]:
        answers = np.empty((len(rows) + len(self._own), path.size))
        output = followed(self._piece, None, path, self._p, self._state, self._clock)
        for j, (row, size) in enumerate(zip(rows, self._sizes, strict=True)):
            moved = path + size * row
            other = followed(self._piece, None, moved, self._p, self._states[j], self._clock)
            answers[j] = (other - output) / size
        for answer, (p, state) in zip(answers[len(rows) :], self._own, strict=True):
            other = followed(self._piece, None, path, p, state, self._clock)
            answer[:] = (other - output) / float(np.sum(p - self._p))
        return output, answers


def carried(
    run: PathRun, signal: FloatArray, tangent: FloatArray, p: FloatArray, around: Around,
    dt: float, *, start: float, frequency: float,
) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    """Return the output of a run from rest and its derivatives, one number per tick.

    Parameters
    ----------
    run : PathRun
        One that is followed by steps, its input held over the tick.
    signal, tangent : ndarray, shapes (n,) and (m, n)
        Held input, and its derivatives by what is upstream.
    p : ndarray
        Parameters of the parts.
    around : mapping of int to pair of float
        Which of them to differentiate by, none of them a delay; see `Around`.
    dt, start, frequency : float
        Sampling interval [s], time of the first sample [s], fundamental frequency [Hz].

    Returns
    -------
    output : ndarray, shape (n,)
        As `PathRun.respond` has it.
    rows : ndarray, shape (m + len(around), n)
        Derivatives by what is upstream, then by parameters in the order of the run.
    """
    steps, layout = run.steps(p, dt), run.layout(dt)
    timing, state = run.timing(p, dt, is_joined=False), run.initial_state(dt, start)
    if run.delays:
        signal = _late(signal, timing.ticks, state[layout.ring].size)
        tangent = np.array([_late(row, timing.ticks, state[layout.ring].size) for row in tangent])
        tangent = tangent.reshape(-1, signal.size)
    clock = PathClock(dt, frequency, 3 * steps, timing.ahead)
    sizes = _sizes(signal, tangent)
    pieces: list[_Through] = []
    for piece, step in zip(run.pieces(layout), run.made(p, dt, steps), strict=True):
        memory = state[piece.memory]
        pieces.append(_piece(piece, step, p, around, clock, memory, sizes))
        sizes += [_other(p, c, around) - float(p[c]) for c in _columns(piece, around)]
    output, rows = np.empty(signal.size), np.empty((len(sizes), signal.size))
    last = np.zeros((1 + len(sizes), 1))
    last[0, 0] = state[0]
    at_once = max(1, _VALUES // (clock.points * (1 + len(sizes))))
    for first in range(0, signal.size, at_once):
        chunk = slice(first, first + at_once)
        path = np.repeat(signal[chunk], clock.points)
        along = np.repeat(tangent[:, chunk], clock.points, axis=1)
        for each in pieces:
            path, along = each.go(path, along)
        read_ticks(path, output[chunk], last[0], clock.points, timing.part)
        for j, row in enumerate(along):
            read_ticks(row, rows[j, chunk], last[1 + j], clock.points, timing.part)
    return output, rows


def _piece(
    piece: PathPiece, step: LinearStep | None, p: FloatArray, around: Around, clock: PathClock,
    state: FloatArray, sizes: Sequence[float],
) -> _Through:  # fmt: skip
    if step is not None:
        h = 3.0 * clock.dt / clock.points
        return _Linear(piece, step, p, around, h, state, len(sizes))
    if piece.parts[0].block.carry is not None:
        return _Carried(piece, p, around, clock, state, len(sizes))
    return _Differenced(piece, p, around, clock, state, tuple(sizes))


def _columns(piece: PathPiece, around: Around) -> list[int]:
    """Return those of `around` that are parameters of a piece."""
    inside = range(piece.parts[0].span.start, piece.parts[-1].span.stop)
    return [column for column in inside if column in around]


def _other(p: FloatArray, column: int, around: Around) -> float:
    """Return the value to which a parameter is moved for a difference to one side."""
    below, above = around[column]
    return above if above != p[column] else below


def _with(p: FloatArray, column: int, value: float) -> FloatArray:
    moved = p.copy()
    moved[column] = value
    return moved


def _moved_step(
    piece: PathPiece, step: LinearStep, p: FloatArray, column: int, around: tuple[float, float],
    h: float,
) -> LinearStep:  # fmt: skip
    """Return the step of states and their derivatives by a parameter, which is what it answers."""
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


def _late(signal: FloatArray, ticks: int, ring: int) -> FloatArray:
    answer = np.empty(signal.size)
    shift(np.ascontiguousarray(signal), answer, np.zeros(ring), ticks)
    return answer


def _sizes(signal: FloatArray, tangent: FloatArray) -> list[float]:
    """Return how much of each derivative is added to the signal for a difference."""
    span = float(np.max(np.abs(signal), initial=0.0)) or 1.0
    sizes = np.max(np.abs(tangent), axis=1, initial=0.0)
    return [_STEP * span / float(size) if size > 0.0 else 1.0 for size in sizes]
