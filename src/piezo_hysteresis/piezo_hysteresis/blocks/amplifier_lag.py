"""An amplifier of limited bandwidth."""

from math import expm1

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Block, Parameter, Slot
from piezo_hysteresis.blocks.effect import Effect
from piezo_hysteresis.jit import jit


@jit
def kernel(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
) -> None:
    """Answer the mean over each sample of the lagging voltage; state is the voltage [V].

    The mean, and not the value at the end, lags by the time constant however long it is against
    the sample, and becomes the input itself for the time constant 0.
    """
    tau = p[0]
    if tau == 0.0:
        for k in range(x.size):
            y[k] = x[k]
            state[0] = x[k]
        return
    rest = -expm1(-dt / tau)
    share = rest * tau / dt
    voltage = state[0]
    for k in range(x.size):
        gap = voltage - x[k]
        y[k] = x[k] + gap * share
        voltage -= gap * rest
    state[0] = voltage


BLOCK = Block(
    name='amplifier_lag',
    slot=Slot.INPUT,
    parameters=(
        Parameter(
            'lag_time',
            's',
            0.0,
            0.0,
            10.0,
            'Time constant; 1/(2 pi lag_time) is the bandwidth.',
            1e-3,
        ),
    ),
    kernel=kernel,
    state_size=1,
    description='Low pass of first order between the command and the actuator.',
    source='output resistance into the capacitance of the actuator',
)

EFFECTS = (
    Effect(
        name='amplifier_lag',
        variant='amplifier_lag',
        block=BLOCK,
        neutral={'lag_time': 0.0},
        start={'lag_time': 5e-4},
        alternatives=({'lag_time': 5e-3},),
        physics='The amplifier with the capacitance of the actuator is a low pass.',
        experiment=(
            'Drives above 100 Hz, where a lag takes amplitude and a delay only phase; or probe '
            'the high voltage beside the command.'
        ),
        mistaken_for=('transport_delay', 'resonance', 'creep', 'rate_dependence'),
    ),
)
