"""One lightly damped mode of the mechanical structure."""

from math import pi

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks._second_order import series_mode
from piezo_hysteresis.blocks.base import Block, InverseRole, Parameter, Slot
from piezo_hysteresis.jit import inline_jit


@inline_jit
def _law(p: FloatArray) -> tuple[float, float]:
    return 2.0 * pi * p[0], p[1]


SERIES = series_mode(_law)

BLOCK = Block(
    name='mode',
    role=InverseRole.STRUCTURE,
    slot=Slot.STRUCTURE,
    parameters=(
        Parameter(
            'natural_frequency',
            'Hz',
            100.0,
            1e-2,
            1e6,
            'Undamped natural frequency of the first mode.',
            100.0,
        ),
        Parameter('damping_ratio', '1', 0.02, 1e-5, 50.0, 'Damping over critical damping.', 0.02),
    ),
    **SERIES,
    description='One mode of unit DC gain by exact zero-order hold.',
    source='Zhou 2021 (3) with unit DC gain',
)
