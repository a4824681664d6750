"""Numerical inverses, sample by sample: of one block, and of a structure."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks._bouc_wen import exact_step
from piezo_hysteresis.blocks.base import Block
from piezo_hysteresis.compensation.inverses.inverse_link import InverseLink, Motion, take
from piezo_hysteresis.errors import CompensationError
from piezo_hysteresis.jit import inline_jit, jit, scratch
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
FIRST_SLOPE, SCALE, _BLOCK = range(3)

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
    states = start.size - _STATE
    if joined:
        commit = _joined(states)
    else:
        commit = _held(kernel_of(block, dt), states, len(block.parameters))
    trial = _trying(commit, start.size)
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
        run_path(np.array([0.0, 0.5 * x, x]), answer, state, *_step(p[_BLOCK:], n))
        return float(answer[2])
    return float(block.respond(np.array([x]), p[_BLOCK:], dt, state=state)[0])


def _step(numbers: FloatArray, n: int) -> tuple[FloatArray, ...]:
    """Return the step of a linear block from its packed values, see `state_space.Step`."""
    phi, gamma, rows, gains = np.split(numbers, np.cumsum([n * n, 3 * n, 3 * n]))
    return (phi.reshape(n, n), gamma.reshape(n, 3), rows.reshape(3, n), gains.reshape(3, 3))


@functools.cache
def _held(kernel: Callable[..., None], size: int, values: int) -> Answer:
    """Return the answer of a block with a held input, which updates its memory."""
    last, memory_end = _BLOCK + values, _STATE + size

    @inline_jit
    def commit(x: float, memory: FloatArray, p: FloatArray, dt: float) -> float:
        given, answer = scratch(1), scratch(1)
        given[0] = x
        kernel(given, answer, memory[_STATE:memory_end], p[_BLOCK:last], dt, 0.0)
        memory[LAST] = x
        return float(answer[0])

    return commit


@functools.cache
def _trying(commit: Answer, size: int) -> Answer:
    """Return the answer of a block without an update of its memory."""

    @inline_jit
    def trial(x: float, memory: FloatArray, p: FloatArray, dt: float) -> float:
        copied = scratch(size)
        for i in range(size):
            copied[i] = memory[i]
        return commit(x, copied, p, dt)

    return trial


@functools.cache
def _joined(n: int) -> Answer:
    """Return the answer of a linear block of n states with linearly interpolated input."""

    @inline_jit
    def commit(x: float, memory: FloatArray, p: FloatArray, dt: float) -> float:
        phi, gamma, rows, gains = (
            scratch((n, n)), scratch((n, 3)), scratch((3, n)), scratch((3, 3)),
        )  # fmt: skip
        place = _BLOCK
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
        line, answer, last = scratch(3), scratch(3), memory[LAST]
        line[0], line[1], line[2] = last, 0.5 * (last + x), x
        run_path(line, answer, memory[_STATE : _STATE + n], phi, gamma, rows, gains)
        memory[LAST] = x
        return float(answer[2])

    return commit


@functools.cache
def _shaping(trial: Answer) -> Callable[..., tuple[float, float]]:
    @inline_jit
    def shape(x: float, memory: FloatArray, p: FloatArray, dt: float) -> tuple[float, float]:
        step = p[SCALE]
        above, below = trial(x + step, memory, p, dt), trial(x - step, memory, p, dt)
        here = trial(x, memory, p, dt)
        return (above - below) / (2.0 * step), (above - 2.0 * here + below) / step**2

    return shape


@functools.cache
def _solving(trial: Answer) -> Answer:
    between = _bracketing(trial)

    @inline_jit
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

    @inline_jit
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


# Indices in the state; the number of corners is first.
CORNERS, _SEEN, _D, _V, _A, _SMOOTH, _W1, _W2 = range(8)
STATE_SIZE = 8

# Relative deviation from the integrated acceleration up to which a change of velocity is smooth.
_TOLERANCE = 0.25


@inline_jit
def carry_ahead(at: Motion, state: FloatArray, lead: float, dt: float) -> Motion:
    """Extrapolate the reference by `lead` seconds.

    The polynomial of fifth degree through the last two ticks is extrapolated; after a corner,
    which is counted, only the derivatives at the tick are used. Displacement and derivatives must
    be consistent: the polynomial amplifies an error of a derivative of a thousandth.
    """
    d, v, a = at
    jerk = snap = crackle = 0.0
    if state[_SEEN] > 0.0:
        d0, v0, a0 = state[_D], state[_V], state[_A]
        miss = abs(v - v0 - 0.5 * dt * (a + a0))
        if miss > _TOLERANCE * dt * max(abs(a), abs(a0)) + 1e-9 * (abs(v) + abs(v0)):
            # The first ticks of a reference from rest are not a corner.
            if state[_SEEN] > 2.0:
                state[CORNERS] += 1.0
            state[_SEEN] = state[_SMOOTH] = 0.0
        else:
            r0 = d0 - d + v * dt - 0.5 * a * dt * dt
            r1 = (v0 - v + a * dt) * dt
            r2 = (a0 - a) * dt * dt
            jerk = -(60.0 * r0 + 24.0 * r1 + 3.0 * r2) / dt**3
            snap = -(360.0 * r0 + 168.0 * r1 + 24.0 * r2) / dt**4
            crackle = -(720.0 * r0 + 360.0 * r1 + 60.0 * r2) / dt**5
    state[_D], state[_V], state[_A] = d, v, a
    state[_SEEN] += 1.0
    t = lead
    here = d + t * (v + t * (a / 2.0 + t * (jerk / 6.0 + t * (snap / 24.0))))
    return Motion(
        here + t**5 * crackle / 120.0,
        v + t * (a + t * (jerk / 2.0 + t * (snap / 6.0 + t * crackle / 24.0))),
        a + t * (jerk + t * (snap / 2.0 + t * crackle / 6.0)),
    )


@inline_jit
def lift_droop(w: float, state: FloatArray) -> float:
    """Compensate the droop of the hold, ``(w dt)^2 / 24``, if the target has been smooth."""
    lifted = w
    if state[_SMOOTH] >= 3.0:
        lifted = w - (w - 2.0 * state[_W1] + state[_W2]) / 24.0
    state[_W2], state[_W1] = state[_W1], w
    state[_SMOOTH] += 1.0
    return lifted


@inline_jit
def invert_structure(
    at: Motion, state: FloatArray, k1: float, k2: float, lead: float, dt: float
) -> float:
    """Return the quasi-static displacement [m] that moves the structure along the reference.

    The reference is extrapolated by `lead` seconds; with a lead, the droop of the hold is
    compensated, too.
    """
    ahead = carry_ahead(at, state, lead, dt)
    target = ahead.displacement + k1 * ahead.velocity + k2 * ahead.acceleration
    return lift_droop(target, state) if lead > 0.0 else target


@jit
def mode_coefficients(natural_frequency: float, damping_ratio: float) -> tuple[float, float]:
    """Return k1 [s] and k2 [s^2] of ``w = d + k1 d' + k2 d''`` for one mode of unit DC gain."""
    omega = 2.0 * math.pi * natural_frequency
    return 2.0 * damping_ratio / omega, 1.0 / (omega * omega)


_NAMES = ('mass', 'damping', 'stiffness', 'z_alpha', 'z_beta', 'z_gamma', 'z_exponent')
_CLAMPED, _STROKE, _X, _Z, _OWN = range(5)


@inline_jit
def invert_oscillator(
    at: Motion, memory: FloatArray, p: FloatArray, dt: float, low: float, high: float
) -> float:
    """Return the force that moves the oscillator along the reference.

    The decay of z is frozen over a step for exponents other than 1.
    """
    own = _OWN + STATE_SIZE
    x = invert_structure(at, memory[_OWN:own], 0.0, 0.0, p[7], dt)
    force = invert_structure(at, memory[own:], p[1] / p[2], p[0] / p[2], p[7], dt)
    scale = abs(p[4]) + abs(p[5])
    height = abs(p[3]) / scale if scale > 0.0 else 0.0
    z, bend = memory[_Z], 1.0
    if p[6] != 1.0 and height > 0.0:
        bend = max(abs(z) / height, 1e-9) ** (p[6] - 1.0)
    z = exact_step(z, x - memory[_X], p[3], 0.0, p[4] * bend, p[5] * bend)
    memory[_X], memory[_Z] = x, z
    total = p[2] * force + z
    if total > high or total < low:
        total = min(max(total, low), high)
        memory[_STROKE] += 1.0
    return float(total)


class OscillatorInverse(InverseLink):
    """Feedforward for ``m x'' + c x' + k x + z = F`` with z a Bouc-Wen force of x.

    The input of the hysteresis is the displacement, so the inverse evaluates the model directly
    and solves no equation.
    """

    memory_size = _OWN + 2 * STATE_SIZE
    run = staticmethod(invert_oscillator)

    def _packed(self, parameters: Mapping[str, float], before: FloatArray | None) -> FloatArray:
        packed = take({'z_exponent': 1.0, **parameters}, _NAMES, 'the inverse of the oscillator')
        if not (packed[0] > 0 and packed[2] > 0 and packed[2] + packed[3] > 0):
            raise CompensationError('mass, stiffness and stiffness + z_alpha must be positive')
        held = parameters.get('interpolation', 2.0) == 0.0
        return np.array([*packed, 0.5 * self.dt if held else 0.0])
