"""Modified Bouc-Wen law of Fang 2019 with bias and frequency terms, as interpreted here."""

from collections.abc import Mapping

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks._bouc_wen import PARAMETERS
from piezo_hysteresis.blocks.base import Block, InterSample, InverseRole, Parameter, Slot
from piezo_hysteresis.blocks.bouc_wen_exact import exact_step
from piezo_hysteresis.blocks.bouc_wen_rate import RATE_PARAMETERS, filtered_rate, rate_factor
from piezo_hysteresis.jit import jit


@jit
def along(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float,
    points: int,
) -> None:  # fmt: skip
    """Return ``A1 u - h``; state is (last voltage [V], h [m], filtered rate [V/s]).

    Exact except for the voltage in the bias term, which is that in the middle of the step; the
    rate is that of the tick.
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


def check(values: Mapping[str, float]) -> str:
    """Return '' or the reason why h is unbounded for these values."""
    if values['beta'] == 0.0 and values['epsilon'] != 0.0:
        return 'epsilon without decay (beta = 0) grows without bound; set beta > 0 or epsilon = 0'
    return ''


BLOCK = Block(
    name='bouc_wen_modified',
    slot=Slot.HYSTERESIS,
    parameters=(
        *(each for each in PARAMETERS if each.name != 'A0'),
        Parameter(
            'epsilon',
            'm/V^2',
            0.0,
            -1e-2,
            1e-2,
            'Growth of h with the length of the travel in proportion to the voltage above the '
            'bias: bends the loop.',
            1e-5,
        ),
        Parameter(
            'bias',
            'V',
            0.0,
            -1e4,
            1e4,
            'Voltage about which the bend is symmetrical (lambda in Fang 2019).',
            0.1,
        ),
        *RATE_PARAMETERS,
    ),
    state_size=3,
    between=InterSample.PATH,
    unknown=(1, 2),
    path_kernel=along,
    description=(
        'Bouc-Wen hysteresis with a bias term and a factor eta = (1 + |du/dt|/rate_corner)^'
        'rate_exponent on the whole growth of h.'
    ),
    source=(
        'Fang 2019 (9), which did not survive printing; our reading: x = k1 u + k2 + k3 h, dh = '
        'eta (alpha du - beta |du| h + gamma du |h| + epsilon (u - lambda) |du|), with A = -k3 '
        'alpha and gamma = -gamma_paper; k2 is the offset'
    ),
    check=check,
    part=InverseRole.MODIFIED,
)
