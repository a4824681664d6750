"""Bouc-Wen hysteresis with an exponent, which sets how abruptly h saturates."""

from math import ceil

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks._bouc_wen import PARAMETERS, check
from piezo_hysteresis.blocks.base import Block, InterSample, Parameter, Slot
from piezo_hysteresis.blocks.bouc_wen import euler_step
from piezo_hysteresis.blocks.bouc_wen_exact import exact_step
from piezo_hysteresis.blocks.effect import Coverage, Effect
from piezo_hysteresis.jit import inline_jit, jit

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
    decay = exponent_factor(h, height, exponent) * (p[3] * abs(h) * way + p[2] * h)
    return p[0] * way + p[1] - decay


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
def kernel(
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
def euler_kernel(
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


_PARAMETERS = (
    *PARAMETERS,
    Parameter(
        'exponent',
        '1',
        1.0,
        0.5,
        10.0,
        'Exponent n; large ones keep h linear until it saturates abruptly.',
    ),
)
_DESCRIPTION = (
    'Bouc-Wen hysteresis of exponent n; h is referred to its saturation, (A + |A0|)/(beta + '
    'gamma), so that beta and gamma keep their unit and the loop its height for every n.'
)

BLOCKS = (
    Block(
        name='bouc_wen_power',
        slot=Slot.HYSTERESIS,
        parameters=_PARAMETERS,
        kernel=kernel,
        state_size=2,
        between=InterSample.PATH,
        unknown=(1,),
        description=_DESCRIPTION,
        source='Tatebatake 2017 (1), Zhou 2021 (1): beta_paper = beta h_sat^(1-n), gamma_paper '
        'likewise',
        check=check,
    ),
    Block(
        name='bouc_wen_power_euler',
        slot=Slot.HYSTERESIS,
        parameters=_PARAMETERS,
        kernel=euler_kernel,
        state_size=2,
        between=InterSample.PATH,
        unknown=(1,),
        step_bound=True,
        description=f'{_DESCRIPTION} Forward Euler step.',
        source='Zhou 2021 (1), Fujii 2018 (3)',
        check=check,
    ),
)

EFFECTS = tuple(
    Effect(
        name='hysteresis_exponent',
        variant=block.name,
        block=block,
        replaces=(replaced,),
        neutral={'exponent': 1.0},
        start={'exponent': 1.5},
        alternatives=({'exponent': 0.8}, {'exponent': 3.0}),
        physics=(
            'The hysteretic share does not saturate exponentially: domains switch later and more '
            'abruptly (n > 1) or earlier (n < 1) than the exponent 1 of the model predicts.'
        ),
        experiment=(
            'An amplitude ladder at one frequency: the loop width over amplitude bends with n.'
        ),
        required_coverage=(Coverage.LADDER, Coverage.REVERSALS),
        mistaken_for=('nonlocal_memory', 'friction', 'stiffness'),
    )
    for block, replaced in zip(BLOCKS, ('bouc_wen_exact', 'bouc_wen'), strict=True)
)
