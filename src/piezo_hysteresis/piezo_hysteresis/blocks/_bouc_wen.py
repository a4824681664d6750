"""The Bouc-Wen hysteresis: parameters, steps over a monotone move, and the kernels of all blocks.

Blocks of the same hysteresis (Euler step, exact step, with exponent, ...) use the same names for
the same quantities, so that one can replace another with the same values. Kernels hold the numbers
of a law as scalars: as one tuple, their generated derivatives take up to twice as long.
"""

from collections.abc import Mapping
from math import ceil, expm1, log1p
from typing import Any

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Along, Kernel, Parameter
from piezo_hysteresis.jit import inline_jit, jit

LINEAR_GAIN = Parameter(
    'A1', 'm/V', 1.5e-4, -1e-2, 1e-2,
    'Linear gain from voltage to displacement before the hysteretic share h is subtracted.', 1e-4,
)  # fmt: skip
PARAMETERS = (
    LINEAR_GAIN,
    Parameter(
        'A', 'm/V', 4e-5, -1e-2, 1e-2,
        'Growth of the hysteretic share h with the travel of the voltage.', 5e-5,
    ),
    Parameter(
        'A0', 'm/V', 0.0, -1e-2, 1e-2,
        'Asymmetry: growth of h with the length of the travel, moves the loop off centre.', 1e-5,
    ),
    Parameter(
        'beta', '1/V', 1.0, 0.0, 1e4,
        'Decay of h with the length of the travel; 1/(beta + gamma) is the memory in volts.', 1.0,
    ),
    Parameter(
        'gamma', '1/V', 0.1, -1e4, 1e4,
        'Difference of the decay of h between loading and unloading, sets the shape of the tips.',
        1.0,
    ),
)  # fmt: skip


def check(values: Mapping[str, float]) -> str:
    """Return '' or the reason why h is unbounded for these values."""
    if values['beta'] == 0.0 and values['A0'] != 0.0:
        return 'A0 without decay (beta = 0) grows without bound; set beta above 0 or A0 to 0'
    return ''


# --- steps ---------------------------------------------------------------------------


@inline_jit
def euler_step(h: float, du: float, a: float, a0: float, beta: float, gamma: float) -> float:
    """Return h [m] after the voltage moved by `du` [V], by the papers' forward Euler step."""
    rise = abs(du)
    return h + (a * du + a0 * rise - gamma * abs(h) * du - beta * rise * h)


@inline_jit
def decay(h: float, a: float, kp: float, travel: float) -> float:
    """Return h after ``dh/dz = a - kp h`` over `travel`, stable for kp near 0 and of any sign."""
    z = kp * travel
    if abs(z) < 1e-8:
        return h * (1.0 - z) + a * travel * (1.0 - 0.5 * z)
    return h + (h - a / kp) * expm1(-z)


@jit
def exact_step(h: float, du: float, a: float, a0: float, beta: float, gamma: float) -> float:
    """Return h [m] after the voltage moved monotonically by `du` [V].

    Within a monotone move ``dh/dz = c - (beta + gamma sgn(h) s) h`` with ``z = |u - u0|``,
    ``s = sgn(du)`` and ``c = s A + A0``, so h relaxes exponentially; where it runs through zero
    the rate changes and the move is split there.
    """
    if du == 0.0:
        return h
    side = 1.0 if du > 0.0 else -1.0
    travel = abs(du)
    c = side * a + a0
    if h == 0.0 and c == 0.0:
        return h
    if h * c < 0.0:
        kp = beta - side * gamma if c > 0.0 else beta + side * gamma
        # both terms reduce h, which is zero after `needed`
        ratio = kp * h / c
        if ratio < 1.0:
            needed = -h / c if abs(ratio) < 1e-12 else log1p(-ratio) / kp
            if needed >= travel:
                return decay(h, c, kp, travel)
            travel -= needed
            h = 0.0
        else:
            return decay(h, c, kp, travel)
    positive = h > 0.0 or (h == 0.0 and c > 0.0)
    kp = beta + side * gamma if positive else beta - side * gamma
    return decay(h, c, kp, travel)


# --- steps with an exponent ----------------------------------------------------------

# Longest step in units of the memory 1/(n (beta + |gamma|)), and that of the fourth-order method.
_STRIDE, _LONG_STRIDE = 0.05, 0.2
_MOST_STRIDES = 1000
# Exponent from which the decay is smooth enough at h = 0 for the fourth-order method.
_SMOOTH = 1.2
_BEYOND = 1.1  # multiple of its height up to which h is integrated in long steps


@inline_jit
def exponent_factor(h: float, height: float, exponent: float) -> float:
    """Return ``|h/height|^(exponent - 1)``, the ratio of the decay of h to that for exponent 1."""
    if exponent == 1.0 or height == 0.0:
        return 1.0
    # below a billionth of the height the decay is zero, or infinite for exponents under 1
    return float(max(abs(h) / height, 1e-9) ** (exponent - 1.0))


@inline_jit
def full_height(a: float, a0: float, beta: float, gamma: float) -> float:
    """Return the saturation level of h [m], the same for every exponent."""
    rate = beta + gamma
    return (abs(a) + abs(a0)) / rate if rate > 0.0 else 0.0


@inline_jit
def slope(
    h: float, way: float, p: tuple[float, float, float, float], height: float, exponent: float
) -> float:
    """Return dh/d|u| while u moves up (`way` 1) or down (-1); `p` is (A, A0, beta, gamma)."""
    lost = exponent_factor(h, height, exponent) * (p[3] * abs(h) * way + p[2] * h)
    return p[0] * way + p[1] - lost


@inline_jit
def long_strides(
    h: float, du: float, p: tuple[float, float, float, float], height: float, exponent: float,
    strides: int,
) -> float:  # fmt: skip
    """Return h after `du` in steps of a Runge-Kutta method of fourth order."""
    way = 1.0 if du > 0.0 else -1.0
    d = abs(du) / strides
    for done in range(strides):
        k1 = slope(h, way, p, height, exponent)
        if abs(k1) * (strides - done) * d < 1e-12 * height:  # saturated: h is constant
            break
        k2 = slope(h + 0.5 * d * k1, way, p, height, exponent)
        k3 = slope(h + 0.5 * d * k2, way, p, height, exponent)
        k4 = slope(h + d * k3, way, p, height, exponent)
        h += d / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
    return h


@jit
def power_kernel(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
) -> None:
    """Return ``A1 u - h``; state is (last voltage [V], h [m]).

    Well above exponent 1 the decay is smooth and the method is of fourth order. Otherwise, and if
    fast decay would need many steps, the decay rate is frozen at the middle of short steps, each
    of which is exact: second order, always stable, and the exact step for exponent 1.
    """
    a1, a, a0, beta, gamma, exponent = p[0], p[1], p[2], p[3], p[4], p[5]
    height = full_height(a, a0, beta, gamma)
    rate = (beta + abs(gamma)) * exponent / _STRIDE
    last, h = state[0], state[1]
    for k in range(x.size):
        du = x[k] - last
        last = x[k]
        strides = max(1, ceil(min(abs(du) * rate * _STRIDE / _LONG_STRIDE, _MOST_STRIDES)))
        # beyond its height h decays too fast for long steps
        if exponent > _SMOOTH and strides < _MOST_STRIDES and abs(h) <= _BEYOND * height:
            h = long_strides(h, du, (a, a0, beta, gamma), height, exponent, strides)
            y[k] = a1 * last - h
            continue
        strides = 1
        if exponent != 1.0:
            strides = max(1, ceil(min(abs(du) * rate, _MOST_STRIDES)))
        d = du / strides
        for _ in range(strides):
            now = exponent_factor(h, height, exponent)
            middle = h
            if exponent < 1.0:  # the decay is steepest at h = 0 but finite there
                loss = gamma * abs(h) * d + beta * abs(d) * h
                middle = h + 0.5 * (a * d + a0 * abs(d) - now * loss)
                now = exponent_factor(middle, height, exponent)
            elif exponent > 1.0:
                middle = exact_step(h, 0.5 * d, a, a0, beta * now, gamma * now)
                now = exponent_factor(middle, height, exponent)
            before = h
            h = exact_step(h, d, a, a0, beta * now, gamma * now)
            if abs(h - before) * strides < 1e-12 * height:
                break
        y[k] = a1 * last - h
    state[0] = last
    state[1] = h


@jit
def power_euler_kernel(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
) -> None:
    """Return ``A1 u - h`` by the Euler step; state is (last voltage [V], h [m])."""
    a1, a, a0, beta, gamma, exponent = p[0], p[1], p[2], p[3], p[4], p[5]
    height = full_height(a, a0, beta, gamma)
    last, h = state[0], state[1]
    for k in range(x.size):
        du = x[k] - last
        last = x[k]
        rate = (beta + abs(gamma)) * abs(du)
        now = exponent_factor(h, height, exponent)
        if now * rate > 1.0 and exponent != 1.0:
            now = 1.0 / rate  # a coarse step may reduce h to zero, not further
        h = euler_step(h, du, a, a0, now * beta, now * gamma)
        y[k] = a1 * last - h
    state[0] = last
    state[1] = h


# --- kernels of a step, without and with a rate ---------------------------------------


def steady_kernel(step: Any) -> Kernel:
    """Return the kernel for ``step(h, du, A, A0, beta, gamma)``, which returns h after a move."""

    @jit
    def kernel(
        x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
    ) -> None:
        """Return ``A1 u - h``; state is (last voltage [V], h [m])."""
        a1, a, a0, beta, gamma = p[0], p[1], p[2], p[3], p[4]
        last, h = state[0], state[1]
        for k in range(x.size):
            h = step(h, x[k] - last, a, a0, beta, gamma)
            last = x[k]
            y[k] = a1 * last - h
        state[0] = last
        state[1] = h

    return kernel


@inline_jit
def filtered_rate(rate: float, du: float, dt: float, memory: float) -> float:
    """Return the rate of the voltage that acts on the domains [V/s]: low-pass filtered |du/dt|."""
    now = abs(du) / dt
    return now if memory == 0.0 else rate - (now - rate) * expm1(-dt / memory)


@inline_jit
def rate_factor(rate: float, corner: float, exponent: float) -> float:
    """Return ``(1 + rate/corner)^exponent``: 1 when slow, a power law when fast."""
    return 1.0 if exponent == 0.0 else float((1.0 + rate / corner) ** exponent)


# The state is (last voltage [V], h [m], filtered rate [V/s]); the rate of a tick is the difference
# from the previous voltage over the interval.


def decaying_kernel(step: Any) -> Along:
    """Return the kernel of a law whose decay depends on the rate, for its step."""

    @jit
    def along(
        x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float,
        frequency: float, points: int,
    ) -> None:  # fmt: skip
        """Return ``A1 u - h``, beta and gamma multiplied by ``(1 + rate/corner)^exponent``."""
        a1, a, a0, beta, gamma = p[0], p[1], p[2], p[3], p[4]
        last, h, rate = state[0], state[1], state[2]
        for tick in range(0, x.size, points):
            rate = filtered_rate(rate, x[tick + points - 1] - last, dt, p[7])
            factor = rate_factor(rate, p[5], p[6])
            for k in range(tick, tick + points):
                h = step(h, x[k] - last, a, a0, beta * factor, gamma * factor)
                last = x[k]
                y[k] = a1 * last - h
        state[0] = last
        state[1] = h
        state[2] = rate

    return along


def widening_kernel(memory: int) -> Along:
    """Return the kernel of a loop that widens, its time constant being the parameter `memory`.

    It widens with a power of the rate, the parameter before that, or, without one, its logarithm.
    """
    of_power = memory > 7

    @jit
    def along(
        x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float,
        frequency: float, points: int,
    ) -> None:  # fmt: skip
        """Return ``A1 u - w h``."""
        a1, a, a0, beta, gamma = p[0], p[1], p[2], p[3], p[4]
        last, h, rate = state[0], state[1], state[2]
        for tick in range(0, x.size, points):
            rate = filtered_rate(rate, x[tick + points - 1] - last, dt, p[memory])
            growth = (rate / p[6]) ** p[7] if of_power else log1p(rate / p[6])
            for k in range(tick, tick + points):
                h = exact_step(h, x[k] - last, a, a0, beta, gamma)
                last = x[k]
                y[k] = a1 * last - (1.0 + p[5] * growth) * h
        state[0] = last
        state[1] = h
        state[2] = rate

    return along


@jit
def modified_along(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float,
    points: int,
) -> None:  # fmt: skip
    """Return ``A1 u - h`` of Fang 2019.

    Exact except for the voltage in the bias term, which is that in the middle of the step.
    """
    a1, a, beta, gamma, epsilon, bias = p[0], p[1], p[2], p[3], p[4], p[5]
    last, h, rate = state[0], state[1], state[2]
    for tick in range(0, x.size, points):
        rate = filtered_rate(rate, x[tick + points - 1] - last, dt, p[8])
        eta = rate_factor(rate, p[6], p[7])
        for k in range(tick, tick + points):
            du = x[k] - last
            leaning = epsilon * (last + 0.5 * du - bias)
            last = x[k]
            h = exact_step(h, du * eta, a, leaning, beta, gamma)
            y[k] = a1 * last - h
    state[0] = last
    state[1] = h
    state[2] = rate
