"""An amplifier that runs out of current."""

from collections.abc import Callable

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Block, Kernel, Parameter, Slot
from piezo_hysteresis.blocks.effect import Effect, Residual
from piezo_hysteresis.jit import jit

NO_LIMIT = 1e12


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


@jit
def mean_kernel(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
) -> None:
    """Answer the mean of that voltage over each sample; state is the voltage at its end [V]."""
    most = p[0] * dt
    # what a sample that arrives in time loses of its mean; nothing at all without a limit
    lost = 0.5 / most if 0.0 < p[0] < NO_LIMIT else 0.0
    last = state[0]
    for k in range(x.size):
        gap = x[k] - last
        if abs(gap) <= most:
            y[k] = x[k] - lost * gap * abs(gap)
            last = x[k]
        else:
            step = most if gap > 0.0 else -most
            y[k] = last + 0.5 * step
            last += step
    state[0] = last


def _block(name: str, parameter: str, function: Kernel, what: str) -> Block:
    return Block(
        name=name,
        slot=Slot.INPUT,
        parameters=(
            Parameter(
                parameter, 'V/s', NO_LIMIT, 0.0, NO_LIMIT, 'Largest rate of the voltage.', 100.0
            ),
        ),
        kernel=function,
        state_size=1,
        description=what,
        source='amplifier with limited current',
    )


BLOCKS = (
    _block(
        'slew_limit',
        'slew_rate',
        kernel,
        'Limit of the rate of the voltage: the current limit into a capacitance.',
    ),
    _block(
        'slew_limit_mean',
        'mean_slew_rate',
        mean_kernel,
        'The same limit, sample means: right before a structure that moves meanwhile.',
    ),
)


def _guess(parameter: str) -> Callable[[Residual], dict[str, float]]:
    def guess(seen: Residual) -> dict[str, float]:
        """Return a limit a little below the largest rate that was commanded."""
        fastest = float(abs(seen.voltage[1:] - seen.voltage[:-1]).max(initial=0.0)) / seen.dt
        return {parameter: 0.8 * fastest} if fastest > 0.0 else {}

    return guess


def _effect(block: Block) -> Effect:
    rate = block.parameters[0].name
    return Effect(
        name='slew_limit',
        variant=block.name,
        block=block,
        neutral={rate: NO_LIMIT},
        start={rate: 100.0},
        alternatives=({rate: 30.0}, {rate: 200.0}),
        guess=_guess(rate),
        physics=(
            'The amplifier charges the capacitance of the actuator with a limited current; fast '
            'drives become triangles.'
        ),
        experiment=(
            'The same amplitude at rising frequency: nothing until amplitude times frequency '
            'passes a threshold, then the fundamental shrinks and lags.'
        ),
        mistaken_for=('amplifier_lag', 'saturation', 'rate_dependence'),
    )


EFFECTS = tuple(_effect(block) for block in BLOCKS)
