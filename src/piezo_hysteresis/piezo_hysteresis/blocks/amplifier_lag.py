"""An amplifier of limited bandwidth."""

from math import exp, expm1

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


@jit
def sampled_kernel(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
) -> None:
    """Answer the lagging voltage at the end of each sample; state is the voltage [V]."""
    kept = exp(-dt / p[0]) if p[0] > 0.0 else 0.0
    voltage = state[0]
    for k in range(x.size):
        voltage = x[k] + (voltage - x[k]) * kept
        y[k] = voltage
    state[0] = voltage


@jit
def sensor_kernel(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
) -> None:
    """Answer the lagging displacement, straight between samples; state is (x, y) before [m]."""
    tau = p[0]
    last, reading = state[0], state[1]
    kept = exp(-dt / tau) if tau > 0.0 else 0.0
    slow = tau / dt * -expm1(-dt / tau) if tau > 0.0 else 0.0
    for k in range(x.size):
        # exact for an input that is straight between two samples
        reading = x[k] - slow * (x[k] - last) + kept * (reading - last)
        last = x[k]
        y[k] = reading
    state[0] = last
    state[1] = reading


def _time(name: str, what: str) -> Parameter:
    return Parameter(name, 's', 0.0, 0.0, 10.0, f'Time constant; 1/(2 pi {name}) is {what}.', 1e-3)


BLOCKS = (
    Block(
        name='amplifier_lag',
        slot=Slot.INPUT,
        parameters=(_time('lag_time', 'the bandwidth'),),
        kernel=kernel,
        state_size=1,
        description='Low pass of first order between the command and the actuator, sample means.',
        source='output resistance into the capacitance of the actuator',
    ),
    Block(
        name='amplifier_lag_sampled',
        slot=Slot.INPUT,
        parameters=(_time('sampled_lag_time', 'the bandwidth'),),
        kernel=sampled_kernel,
        state_size=1,
        description='The same low pass at the ends of the samples; exact for a static chain.',
        source='output resistance into the capacitance of the actuator',
    ),
    Block(
        name='sensor_lag',
        slot=Slot.SENSOR,
        parameters=(_time('sensor_lag_time', 'the bandwidth of the sensor'),),
        kernel=sensor_kernel,
        state_size=2,
        description='Low pass of first order between the displacement and the reading.',
        source='bandwidth of the sensor electronics',
    ),
)

_AMPLIFIER = 'The amplifier with the capacitance of the actuator is a low pass.'
_SENSOR = 'The electronics of the sensor are a low pass: the reading lags, the actuator does not.'

EFFECTS = tuple(
    Effect(
        name='amplifier_lag',
        variant=block.name,
        block=block,
        neutral={block.parameters[0].name: 0.0},
        start={block.parameters[0].name: 5e-4},
        alternatives=({block.parameters[0].name: 5e-3},),
        first=block.slot is Slot.SENSOR,
        physics=physics,
        experiment=(
            'Drives above 100 Hz, where a lag takes amplitude and a delay only phase; or probe '
            'the high voltage beside the command.'
        ),
        mistaken_for=('transport_delay', 'resonance', 'creep', 'rate_dependence'),
    )
    for block, physics in zip(BLOCKS, (_AMPLIFIER, _AMPLIFIER, _SENSOR), strict=True)
)
