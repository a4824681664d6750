"""Propagation of derivatives through a block, by the generated derivative of its kernel."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Block
from piezo_hysteresis.blocks.parallel import parts_of
from piezo_hysteresis.kernels.forward import directional

_VALUES = 1 << 15  # derivative values propagated at a time, to fit into the cache
_BRANCH_OFFSET = 1e-6  # relative to the typical size


class At(NamedTuple):
    """A block, its parameters, and the parameters to differentiate by."""

    block: Block
    values: FloatArray
    columns: list[int]  # indices of the parameters to differentiate by


Each = Callable[[At, FloatArray, FloatArray], tuple[FloatArray, FloatArray]]
"""What a block makes of its input, given where it is, its memory and the derivatives of that."""


def side_by_side(
    each: Each, at: At, incoming: int, state: FloatArray, moved: FloatArray, dt: float
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
        part_at = At(part, at.values[first:last], [at.columns[k] - first for k in mine])
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


def through(
    kernel: Any,
    x: FloatArray,  # (n,)
    rows: FloatArray,  # (m, n)
    at: At,
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
        output, slopes = through(kernel, x, np.ones((1, n)), at, state, moved[m - 1 :], *clock)
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
                found = through(kernel, x, rows[:0], one, begin.copy(), other, *clock)
                answers[m + k], moved[m + k] = found[1][0], other[0]
    return output, answers


def _weighed(
    kernel: Any,
    x: FloatArray,
    rows: FloatArray,
    at: At,
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
    rest, still = At(block, p, [0] * len(others)), moved[places]
    output, found = through(kernel, x, rows, rest, state, still, *clock)
    answers = np.empty((len(moved), x.size))
    answers[places], moved[places] = found, still
    for k, column in enumerate(columns, start=len(rows)):
        if column:
            answers[k] = regressors[column - 1]
    return output, answers


def _off_branch(at: At, column: int) -> At | None:
    """Return values slightly off a special case of a law; None if the bounds do not allow it.

    With an exponent of 1, or a share or time of 0, a law may use a simpler branch on which the
    derivative is zero.
    """
    parameter, values = at.block.parameters[column], at.values.copy()
    step = _BRANCH_OFFSET * parameter.scale
    values[column] += step if values[column] + step <= parameter.high else -step
    is_new = values[column] not in (0.0, 1.0) and not parameter.held
    return At(at.block, values, [column]) if is_new else None


def _seeds(
    first: int, last: int, incoming: int, columns: Sequence[int], shape: tuple[int, int]
) -> FloatArray:
    """Return the seeds of the parameters for the derivatives `first` to `last`."""
    seeds = np.zeros(shape)
    for i in range(max(first, incoming), last):
        seeds[i - first, columns[i - incoming]] = 1.0
    return seeds
