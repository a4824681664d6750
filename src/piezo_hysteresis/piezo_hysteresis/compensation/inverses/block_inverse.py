"""Numerical inverse of one block with feedthrough, sample by sample, as compiled kernels."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Block
from piezo_hysteresis.jit import leaf, scratch
from piezo_hysteresis.models.simulation.compiled import kernel_of
from piezo_hysteresis.models.simulation.state_space import run_path, step_of

# Share of the initial slope below which a slope is treated as zero.
_LEAST_SLOPE = 0.1
_BRACKETS = 40
_HALVINGS = 100
# Relative tolerance of a root.
_CLOSE = 1e-14

# Indices in the memory of a block, before its state: count of slopes that were too small, last
# input.
CLAMPED, LAST, _STATE = range(3)
# Indices before its parameters: slope at rest, and the input step for slopes.
FIRST_SLOPE, SCALE, _OWN = range(3)

#: ``answer(x, memory, p, dt)``: the output for an input.
Answer = Callable[[float, FloatArray, FloatArray, float], float]


class BlockInverse(NamedTuple):
    """Kernels that solve one block for its input, with memory and parameters as arguments."""

    solve: Answer  # returns the input nearest to the last one whose output is the target
    commit: Answer  # returns the output for an input and updates the memory
    shape: Callable[[float, FloatArray, FloatArray, float], tuple[float, float]]
    start: FloatArray  # memory at rest


def block_inverse(block: Block, dt: float, joined: bool) -> BlockInverse:  # dt [s]
    """Return the inverse of a block with feedthrough."""
    start = np.concatenate([np.zeros(_STATE), block.initial_state(dt)])
    if joined:
        trial, commit = _joined(start.size - _STATE)
    else:
        trial, commit = _held(kernel_of(block, dt), start.size - _STATE, len(block.parameters))
    return BlockInverse(_solving(trial), commit, _shaping(trial), start)


def packed_block(
    block: Block, own: FloatArray, dt: float, scale: float, joined: bool
) -> FloatArray:
    """Return the parameters of the kernels; the slope at rest is the first."""
    numbers = own
    if joined:
        assert block.system is not None
        numbers = np.concatenate([np.ravel(each) for each in step_of(block.system(own), dt)])
    p = np.concatenate([(0.0, scale), numbers])
    above, below = (from_rest(block, p, x, dt, joined) for x in (scale, -scale))
    p[FIRST_SLOPE] = (above - below) / (2.0 * scale)
    return p


def from_rest(block: Block, p: FloatArray, x: float, dt: float, joined: bool) -> float:
    """Return the output of a block at rest for its first input `x`; `p` from `packed_block`."""
    state = block.initial_state(dt)
    if joined:
        n, answer = state.size, np.zeros(3)
        run_path(np.array([0.0, 0.5 * x, x]), answer, state, *_step(p[_OWN:], n))
        return float(answer[2])
    return float(block.respond(np.array([x]), p[_OWN:], dt, state=state)[0])


def _step(numbers: FloatArray, n: int) -> tuple[FloatArray, ...]:
    """Return the step of a linear block from its packed values, see `state_space.Step`."""
    phi, gamma, rows, gains = np.split(numbers, np.cumsum([n * n, 3 * n, 3 * n]))
    return (phi.reshape(n, n), gamma.reshape(n, 3), rows.reshape(3, n), gains.reshape(3, 3))


@functools.cache
def _held(kernel: Callable[..., None], size: int, values: int) -> tuple[Answer, Answer]:
    """Return trial and commit of a block with a held input."""
    last, memory_end = _OWN + values, _STATE + size

    @leaf
    def trial(x: float, memory: FloatArray, p: FloatArray, dt: float) -> float:
        given, answer, state = scratch(1), scratch(1), scratch(size)
        given[0] = x
        for i in range(size):
            state[i] = memory[_STATE + i]
        kernel(given, answer, state, p[_OWN:last], dt, 0.0)
        return float(answer[0])

    @leaf
    def commit(x: float, memory: FloatArray, p: FloatArray, dt: float) -> float:
        given, answer = scratch(1), scratch(1)
        given[0] = x
        kernel(given, answer, memory[_STATE:memory_end], p[_OWN:last], dt, 0.0)
        memory[LAST] = x
        return float(answer[0])

    return trial, commit


@functools.cache
def _joined(n: int) -> tuple[Answer, Answer]:
    """Return trial and commit of a linear block of n states with linearly interpolated input."""

    @leaf
    def along(x: float, last: float, state: FloatArray, p: FloatArray) -> float:
        phi, gamma, rows, gains = (
            scratch((n, n)), scratch((n, 3)), scratch((3, n)), scratch((3, 3)),
        )  # fmt: skip
        place = _OWN
        for i in range(n):
            for j in range(n):
                phi[i, j] = p[place + i * n + j]
        place += n * n
        for i in range(n):
            for j in range(3):
                gamma[i, j] = p[place + 3 * i + j]
        place += 3 * n
        for i in range(3):
            for j in range(n):
                rows[i, j] = p[place + i * n + j]
        place += 3 * n
        for i in range(3):
            for j in range(3):
                gains[i, j] = p[place + 3 * i + j]
        line, answer = scratch(3), scratch(3)
        line[0], line[1], line[2] = last, 0.5 * (last + x), x
        run_path(line, answer, state, phi, gamma, rows, gains)
        return float(answer[2])

    @leaf
    def trial(x: float, memory: FloatArray, p: FloatArray, dt: float) -> float:
        state = scratch(n)
        for i in range(n):
            state[i] = memory[_STATE + i]
        return along(x, memory[LAST], state, p)

    @leaf
    def commit(x: float, memory: FloatArray, p: FloatArray, dt: float) -> float:
        answer = along(x, memory[LAST], memory[_STATE : _STATE + n], p)
        memory[LAST] = x
        return answer

    return trial, commit


@functools.cache
def _shaping(trial: Answer) -> Callable[..., tuple[float, float]]:
    @leaf
    def shape(x: float, memory: FloatArray, p: FloatArray, dt: float) -> tuple[float, float]:
        step = p[SCALE]
        above, below = trial(x + step, memory, p, dt), trial(x - step, memory, p, dt)
        here = trial(x, memory, p, dt)
        return (above - below) / (2.0 * step), (above - 2.0 * here + below) / step**2

    return shape


@functools.cache
def _solving(trial: Answer) -> Answer:
    between = _bracketing(trial)

    @leaf
    def solve(target: float, memory: FloatArray, p: FloatArray, dt: float) -> float:
        start = memory[LAST]
        missing = target - trial(start, memory, p, dt)
        if missing == 0.0:
            return float(start)
        furthest = missing / (_LEAST_SLOPE * p[FIRST_SLOPE])
        near, far = start, start + missing / p[FIRST_SLOPE]
        for _ in range(_BRACKETS):
            over = (trial(far, memory, p, dt) - target) * missing
            if over == 0.0:
                return float(far)
            if over > 0.0:
                return between(near, far, target, memory, p, dt)
            if abs(far - start) >= abs(furthest):
                break
            near = far
            far = start + 1.5 * (far - start)
            if abs(far - start) > abs(furthest):
                far = start + furthest
        memory[CLAMPED] += 1.0
        return float(start + furthest)

    return solve


def _bracketing(trial: Answer) -> Callable[..., float]:
    """Return the root search between two inputs by Ridders' method."""

    @leaf
    def between(
        near: float, far: float, target: float, memory: FloatArray, p: FloatArray, dt: float
    ) -> float:
        low, high = near, far
        f_low, f_high = trial(low, memory, p, dt) - target, trial(high, memory, p, dt) - target
        if f_low == 0.0:
            return low
        best = high
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            f_middle = trial(middle, memory, p, dt) - target
            if f_middle == 0.0:
                return middle
            root = (f_middle * f_middle - f_low * f_high) ** 0.5
            side = 1.0 if f_low > f_high else -1.0
            found = middle + (middle - low) * side * f_middle / root if root > 0.0 else middle
            f_found = trial(found, memory, p, dt) - target
            if f_found == 0.0 or abs(found - best) <= _CLOSE * abs(found):
                return found
            best = found
            if f_middle * f_found < 0.0:
                low, f_low, high, f_high = middle, f_middle, found, f_found
            elif f_low * f_found < 0.0:
                high, f_high = found, f_found
            else:
                low, f_low = found, f_found
            if low == high:
                return found
        return best

    return between
