"""The path of a signal between the ticks: construction, propagation through blocks, sampling.

A path has `points` values per tick, three per step: at the start of the step (after a possible
jump), in its middle and at its end. Between them it is a parabola.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Block
from piezo_hysteresis.blocks.bouc_wen_oscillator import WEIGHTS, interpolate
from piezo_hysteresis.jit import jit, scratch

#: Number of past samples of an interpolated path, and its steps per tick.
PAST: int = WEIGHTS.shape[0]
JOINED_STEPS: int = (WEIGHTS.shape[1] - 1) // 2


@jit
def joined(x: FloatArray, path: FloatArray, past: FloatArray, order: float) -> None:
    """Fill the path between the last two samples for each sample of `x`."""
    forces = scratch(WEIGHTS.shape[1])
    points = 3 * JOINED_STEPS
    for k in range(x.size):
        for j in range(PAST - 1, 0, -1):
            past[j] = past[j - 1]
        past[0] = x[k]
        interpolate(past, order, forces)
        for i in range(JOINED_STEPS):
            for j in range(3):
                path[k * points + 3 * i + j] = forces[2 * i + j]


@jit
def with_turns(x: FloatArray, wide: FloatArray, late: FloatArray) -> None:
    """Fill `wide`, four points per step, with `x` and the extremum of its parabola.

    `late` is whether the extremum is in the second half of a step. A step without an extremum has
    its middle twice.
    """
    for step in range(x.size // 3):
        start, middle, end = x[3 * step], x[3 * step + 1], x[3 * step + 2]
        slope = -3.0 * start + 4.0 * middle - end
        bend = 2.0 * (start - 2.0 * middle + end)
        place = 0.5
        if slope * bend < 0.0 and abs(slope) < 2.0 * abs(bend):
            place = -0.5 * slope / bend
        turn = middle if place == 0.5 else start + place * (slope + place * bend)
        turned = place > 0.5
        late[step] = 1.0 if turned else 0.0
        wide[4 * step] = start
        wide[4 * step + 1] = middle if turned else turn
        wide[4 * step + 2] = turn if turned else middle
        wide[4 * step + 3] = end


@jit
def without_turns(wide: FloatArray, late: FloatArray, y: FloatArray) -> None:
    """Fill `y`, three points per step, from `wide`, the inverse of `with_turns`."""
    for step in range(late.size):
        y[3 * step] = wide[4 * step]
        y[3 * step + 1] = wide[4 * step + (1 if late[step] > 0.0 else 2)]
        y[3 * step + 2] = wide[4 * step + 3]


def follow(
    block: Block, path: FloatArray, p: FloatArray, state: FloatArray, dt: float, *, turns: bool
) -> FloatArray:
    """Return the output of a block along a path, for a block that does not depend on time."""
    if not turns:
        return block.respond(path, p, dt, state=state)
    wide = np.empty(path.size // 3 * 4)
    late = np.empty(path.size // 3)
    with_turns(path, wide, late)
    answer = block.respond(wide, p, dt, state=state)
    output = np.empty_like(path)
    without_turns(answer, late, output)
    return output


def with_time(
    block: Block,
    path: FloatArray,
    p: FloatArray,
    state: FloatArray,
    dt: float,
    *,
    points: int,
    ahead: float,
) -> FloatArray:
    """Return the output of a time-dependent block along a path."""
    output = np.empty_like(path)
    for place, memory in moments(block, state, path.size // points, points // 3, ahead):
        part = np.ascontiguousarray(path[place])
        output[place] = block.respond(part, p, dt / (points // 3), state=memory)
    return output


def moments(
    block: Block, state: FloatArray, ticks: int, steps: int, ahead: float
) -> Iterator[tuple[slice, FloatArray]]:
    """Yield indices of start, middle and end of each step of a path, with a state of that time."""
    assert block.count is not None
    for place in range(3):
        memory = state.copy()
        memory[block.count] = (state[block.count] + ahead) * steps + 0.5 * place
        yield slice(place, None, 3), memory
    state[block.count] += ticks


@jit
def read(path: FloatArray, y: FloatArray, points: int, part: float) -> None:
    """Sample a path in each tick after `part` of it, 0 < part <= 1."""
    steps = points // 3
    step = min(int(part * steps), steps - 1)
    t = part * steps - step
    for k in range(y.size):
        at = k * points + 3 * step
        slope = -3.0 * path[at] + 4.0 * path[at + 1] - path[at + 2]
        bend = 2.0 * (path[at] - 2.0 * path[at + 1] + path[at + 2])
        y[k] = path[at] + t * (slope + t * bend)
