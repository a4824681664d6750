"""Bouc-Wen hysteresis by its exact step: the same model at every sampling rate."""

from math import expm1, log1p

from piezo_hysteresis.blocks._bouc_wen import PARAMETERS, check, run_of
from piezo_hysteresis.blocks.base import Block, InterSample, InverseRole, Slot
from piezo_hysteresis.blocks.effect import Effect
from piezo_hysteresis.jit import inline_jit, jit


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


kernel = run_of(exact_step)

BLOCK = Block(
    name='bouc_wen_exact',
    part=InverseRole.EXACT,
    slot=Slot.HYSTERESIS,
    parameters=PARAMETERS,
    kernel=kernel,
    state_size=2,
    between=InterSample.PATH,
    unknown=(1,),
    description='Bouc-Wen hysteresis, exact for a voltage that is monotone between two samples.',
    source='Fujii 2018 (1), Tatebatake 2017 (2), (3), (17), Zhou 2021 (2), (6), Xiao 2014 (1), '
    'Fang 2019 (classical model); exact step for exponent 1',
    check=check,
)

EFFECTS = (
    Effect(
        name='hysteresis',
        variant='input',
        where='of the input',
        block=BLOCK,
        replaces=('gain',),
        inexactness=0.07,  # one loop represents those of many domains
        holds={'A0': 0.0},
        neutral={'A': 0.0},
        start={'A': 4e-5, 'beta': 2.0, 'gamma': 0.2},
        alternatives=({'A': -4e-5}, {'beta': 10.0, 'gamma': 1.0}),
        physics=(
            'Domains of the ceramic switch with losses: the displacement lags behind the '
            'voltage by a share that depends on its history and not on its rate.'
        ),
        experiment=(
            'A slow triangle: at a tenth of the frequency the loop has the same width; that '
            'of a lag or delay is smaller.'
        ),
        mistaken_for=('friction', 'amplifier_lag', 'transport_delay', 'creep'),
    ),
)
