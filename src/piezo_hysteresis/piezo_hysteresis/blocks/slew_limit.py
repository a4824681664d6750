"""Slew-rate limit of the amplifier."""

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Block, InterSample, Parameter, Slot
from piezo_hysteresis.blocks.effect import Effect, Residual
from piezo_hysteresis.jit import jit

NO_LIMIT = 1e12


@jit
def kernel(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
) -> None:
    """Return the rate-limited voltage at the end of each tick.

    State is that voltage [V].
    """
    most = p[0] * dt
    last = state[0]
    for k in range(x.size):
        # in this form, a step within the limit has no rounding error
        if abs(x[k] - last) <= most:
            last = x[k]
        else:
            last += most if x[k] > last else -most
        y[k] = last
    state[0] = last


@jit
def along(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float,
    points: int,
) -> None:  # fmt: skip
    """Return the output along a path, three points per step; state is the last voltage [V].

    If the limit ceases within the first half of a step, the start value is such that Simpson's
    rule gives the mean of the ramp and the signal after it.
    """
    limited = p[0] < NO_LIMIT
    step = 3.0 * dt / points
    most = 0.5 * p[0] * step
    last = state[0]
    for k in range(0, x.size, 3):
        gap = x[k] - last
        away = x[k + 1] - last
        reached = abs(away) <= most
        y[k] = last
        if reached:
            y[k + 1] = x[k + 1]
            left = gap
            if limited and gap != 0.0:
                # ramp with the rate p[0] until the difference is zero
                left = max(0.0, 1.0 - 1.5 * abs(gap) / most) * gap
            y[k] = last + left
        else:
            y[k + 1] = last + (most if away > 0.0 else -most)
        rest = x[k + 2] - y[k + 1]
        last = x[k + 2] if abs(rest) <= most else y[k + 1] + (most if rest > 0.0 else -most)
        y[k + 2] = last
    state[0] = last


BLOCK = Block(
    name='slew_limit',
    slot=Slot.INPUT,
    parameters=(
        Parameter(
            'slew_rate', 'V/s', NO_LIMIT, 0.0, NO_LIMIT, 'Largest rate of the voltage.', 100.0
        ),
    ),
    kernel=kernel,
    state_size=1,
    description='Limit of the rate of the voltage: the current limit into a capacitance.',
    source='amplifier with limited current',
    between=InterSample.INNER,
    path_kernel=along,
)


def guess(seen: Residual) -> dict[str, float]:
    """Return a limit slightly below the largest commanded rate."""
    fastest = float(abs(seen.voltage[1:] - seen.voltage[:-1]).max(initial=0.0)) / seen.dt
    return {'slew_rate': 0.8 * fastest} if fastest > 0.0 else {}


EFFECTS = (
    Effect(
        name='slew_limit',
        block=BLOCK,
        neutral={'slew_rate': NO_LIMIT},
        starts=({'slew_rate': 100.0}, {'slew_rate': 30.0}, {'slew_rate': 200.0}),
        guess=guess,
        physics=(
            'The amplifier charges the capacitance of the actuator with a limited current; fast '
            'drives become triangles.'
        ),
        experiment=(
            'The same amplitude at rising frequency: no change until amplitude times '
            'frequency exceeds a threshold, then the fundamental decreases and lags.'
        ),
        mistaken_for=('amplifier_lag', 'saturation', 'rate_dependence'),
    ),
)
