"""Autoregressions of the papers, models of the dynamics of the structure."""

from collections.abc import Mapping

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Block, InverseRole, Parameter, Slot
from piezo_hysteresis.jit import jit


@jit
def kernel(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
) -> None:
    """Return ``y[k] = y[k-1] + c1 y[k-2] + c2 y[k-3] + v[k]``; state is the last three y [m]."""
    c1, c2 = p[0], p[1]
    y1, y2, y3 = state[0], state[1], state[2]
    for k in range(x.size):
        new = y1 + c1 * y2 + c2 * y3 + x[k]
        y3 = y2
        y2 = y1
        y1 = new
        y[k] = new
    state[0] = y1
    state[1] = y2
    state[2] = y3


def unstable(c1: float, c2: float, names: str) -> str:
    """Return '' or the reason why ``y[k] = y[k-1] + c1 y[k-2] + c2 y[k-3]`` does not decay."""
    radius = float(np.max(np.abs(np.roots([1.0, -1.0, -c1, -c2]))))
    if radius < 1.0:
        return ''
    return (
        f'{names} = {c1:.4g}, {c2:.4g} make the recursion unstable (largest pole {radius:.4g}); '
        'project them to poles inside the unit circle'
    )


def check(values: Mapping[str, float]) -> str:
    """Return '' or the reason why the recursion is unstable."""
    return unstable(values['c1'], values['c2'], 'c1, c2')


@jit
def free_kernel(
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


def check_free(values: Mapping[str, float]) -> str:
    """Return '' or the reason why the recursion does not decay."""
    a1, a2 = values['a1'], values['a2']
    radius = float(np.max(np.abs(np.roots([1.0, -a1, -a2]))))
    if radius < 1.0:
        return ''
    return (
        f'a1, a2 = {a1:.4g}, {a2:.4g} make the recursion unstable (largest pole {radius:.4g}); '
        'record longer, or use output_error'
    )


BLOCKS = (
    Block(
        name='autoregressive',
        role=InverseRole.RECURSION,
        slot=Slot.STRUCTURE,
        parameters=(
            Parameter(
                'c1', '1', 0.47, -3.0, 3.0, 'Weight of the displacement two samples ago.', 0.5
            ),
            Parameter(
                'c2', '1', -0.79, -2.0, 1.0, 'Weight of the displacement three samples ago.', 0.5
            ),
        ),
        kernel=kernel,
        state_size=3,
        unknown=(0, 1, 2),
        description='Autoregression of third order whose first coefficient is fixed to 1.',
        source='Fujii 2018 (3); Tatebatake 2017 (7) where they are called a1, a2',
        check=check,
    ),
    Block(
        name='autoregressive_free',
        slot=Slot.STRUCTURE,
        parameters=(
            Parameter(
                'a1', '1', 0.8, -3.0, 3.0, 'Weight of the displacement of the sample before.', 0.5
            ),
            Parameter(
                'a2', '1', -0.3, -2.0, 1.0, 'Weight of the displacement two samples ago.', 0.5
            ),
        ),
        kernel=free_kernel,
        state_size=2,
        unknown=(0, 1),
        description='Autoregression of second order with free coefficients.',
        source='Fujii 2018 (10)',
        check=check_free,
    ),
)
