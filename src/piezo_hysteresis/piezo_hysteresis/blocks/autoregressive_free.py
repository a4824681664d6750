"""Free second-order autoregression, as identified by the printed regressor of Fujii 2018."""

from collections.abc import Mapping

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Block, Parameter, Slot
from piezo_hysteresis.jit import jit


@jit
def kernel(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
) -> None:
    """Return ``y[k] = a1 y[k-1] + a2 y[k-2] + v[k]``; state is the last two y [m]."""
    a1, a2 = p[0], p[1]
    y1, y2 = state[0], state[1]
    for k in range(x.size):
        new = a1 * y1 + a2 * y2 + x[k]
        y2 = y1
        y1 = new
        y[k] = new
    state[0] = y1
    state[1] = y2


def check(values: Mapping[str, float]) -> str:
    """Return '' or the reason why the recursion does not decay."""
    a1, a2 = values['a1'], values['a2']
    radius = float(np.max(np.abs(np.roots([1.0, -a1, -a2]))))
    if radius < 1.0:
        return ''
    return (
        f'a1, a2 = {a1:.4g}, {a2:.4g} make the recursion unstable (largest pole {radius:.4g}); '
        'record longer, or use output_error'
    )


BLOCK = Block(
    name='autoregressive_free',
    slot=Slot.STRUCTURE,
    parameters=(
        Parameter(
            'a1', '1', 0.8, -3.0, 3.0, 'Weight of the displacement of the sample before.', 0.5
        ),
        Parameter('a2', '1', -0.3, -2.0, 1.0, 'Weight of the displacement two samples ago.', 0.5),
    ),
    kernel=kernel,
    state_size=2,
    unknown=(0, 1),
    description='Autoregression of second order with free coefficients.',
    source='Fujii 2018 (10)',
    check=check,
)
