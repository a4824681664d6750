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
    """Answer what lags behind an input that is held, at the end of each sample; state is that."""
    kept = exp(-dt / p[0]) if p[0] > 0.0 else 0.0
    voltage = state[0]
    for k in range(x.size):
        voltage = x[k] + (voltage - x[k]) * kept
        y[k] = voltage
    state[0] = voltage


@jit
def ramps(a: float) -> tuple[float, float]:
    """Return how far a low pass of ``dt/tau = a`` has come after a ramp and a parabola to 1."""
    if a < 1e-2:
        return a * (0.5 - a / 6.0 + a * a / 24.0), a * (1.0 / 3.0 - a / 12.0 + a * a / 60.0)
    rest = -expm1(-a)
    return 1.0 - rest / a, 1.0 - 2.0 / a + 2.0 * rest / (a * a)


@jit
def sensor_kernel(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
) -> None:
    """Answer the lagging displacement; state is (x before last, last x, y) [m].

    Exact for a displacement that is a parabola through three samples.
    """
    if p[0] == 0.0:
        for k in range(x.size):
            y[k] = x[k]
            state[0] = state[1]
            state[1] = x[k]
            state[2] = x[k]
        return
    a = dt / p[0]
    ramp, parabola = ramps(a)
    rest = -expm1(-a)
    older, last, reading = state[0], state[1], state[2]
    for k in range(x.size):
        slope, bend = x[k] - last, x[k] - 2.0 * last + older
        reading += rest * (last - reading) + slope * ramp + 0.5 * bend * (parabola - ramp)
        older = last
        last = x[k]
        y[k] = reading
    state[0] = older
    state[1] = last
    state[2] = reading


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
        state_size=3,
        description='Low pass of first order between the displacement and the reading.',
        source='bandwidth of the sensor electronics',
    ),
    Block(
        name='sensor_lag_sampled',
        slot=Slot.SENSOR,
        parameters=(_time('sampled_sensor_lag_time', 'the bandwidth of the sensor'),),
        kernel=sampled_kernel,
        state_size=1,
        description='The same for a displacement that steps with the held voltage: static chains.',
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
    for block, physics in zip(BLOCKS, (_AMPLIFIER, _AMPLIFIER, _SENSOR, _SENSOR), strict=True)
)
