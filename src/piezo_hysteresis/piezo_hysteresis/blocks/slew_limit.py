"""An amplifier that runs out of current."""

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Block, Parameter, Slot
from piezo_hysteresis.blocks.effect import Effect, Residual
from piezo_hysteresis.jit import jit


@jit
def kernel(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
) -> None:
    """Answer the voltage that follows no faster than the limit; state is the last voltage [V]."""
    most = p[0] * dt
    last = state[0]
    for k in range(x.size):
        # so written, a step within the limit arrives without rounding
        if abs(x[k] - last) <= most:
            last = x[k]
        else:
            last += most if x[k] > last else -most
        y[k] = last
    state[0] = last


BLOCK = Block(
    name='slew_limit',
    slot=Slot.INPUT,
    parameters=(
        Parameter('slew_rate', 'V/s', 1e12, 0.0, 1e12, 'Largest rate of the voltage.', 100.0),
    ),
    kernel=kernel,
    state_size=1,
    description='Limit of the rate of the voltage: the current limit into a capacitance.',
    source='amplifier with limited current',
)


def guess(seen: Residual) -> dict[str, float]:
    """Return a limit a little below the largest rate that was commanded."""
    fastest = float(abs(seen.voltage[1:] - seen.voltage[:-1]).max(initial=0.0)) / seen.dt
    return {'slew_rate': 0.8 * fastest} if fastest > 0.0 else {}


EFFECTS = (
    Effect(
        name='slew_limit',
        variant='slew_limit',
        block=BLOCK,
        neutral={'slew_rate': 1e12},
        start={'slew_rate': 100.0},
        alternatives=({'slew_rate': 30.0}, {'slew_rate': 200.0}),
        guess=guess,
        physics=(
            'The amplifier charges the capacitance of the actuator with a limited current; fast '
            'drives become triangles.'
        ),
        experiment=(
            'The same amplitude at rising frequency: nothing until amplitude times frequency '
            'passes a threshold, then the fundamental shrinks and lags.'
        ),
        mistaken_for=('amplifier_lag', 'saturation', 'rate_dependence'),
    ),
)
