"""Second-order structure of Zhou 2021, by mass, damping and stiffness."""

from collections.abc import Callable, Mapping
from math import pi, sqrt

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks._second_order import series_mode
from piezo_hysteresis.blocks.base import Block, InverseRole, Parameter, Slot
from piezo_hysteresis.jit import inline_jit


@inline_jit
def _law(p: FloatArray) -> tuple[float, float]:
    return sqrt(p[2] / p[0]), 0.5 * p[1] / sqrt(p[0] * p[2])


Restated = Callable[[Mapping[str, float], Mapping[str, float]], dict[str, float]]


def restated(block: Block) -> Restated | None:
    """Return how a linear block without a parameter for its frequency states a mode."""
    own = {each.name for each in block.parameters}
    return _restated if block.system is not None and {'mass', 'stiffness'} <= own else None


def _restated(values: Mapping[str, float], mode: Mapping[str, float]) -> dict[str, float]:
    """Return mass and damping for a mode, in addition to the other values in `mode`.

    The mode has a ``natural_frequency`` [Hz], a ``damping_ratio``, or both.
    """
    others = {k: v for k, v in mode.items() if k not in ('natural_frequency', 'damping_ratio')}
    stiffness, mass = values['stiffness'], values['mass']
    ratio = mode.get('damping_ratio', 0.5 * values['damping'] / sqrt(mass * stiffness))
    if 'natural_frequency' in mode:
        mass = stiffness / (2.0 * pi * mode['natural_frequency']) ** 2
    return {**others, 'mass': mass, 'damping': 2.0 * ratio * sqrt(mass * stiffness)}


BLOCK = Block(
    name='mass_spring',
    role=InverseRole.STRUCTURE,
    slot=Slot.STRUCTURE,
    parameters=(
        Parameter('mass', 'kg', 0.0514, 1e-9, 1e5, 'Moving mass m.', 0.05),
        Parameter('damping', 'N*s/m', 513.0, 1e-9, 1e9, 'Viscous damping b.', 500.0),
        Parameter('stiffness', 'N/m', 8.0e5, 1e-3, 1e12, 'Stiffness k.', 8e5),
    ),
    **series_mode(_law),
    description=(
        "m x'' + b x' + k x = k v by exact zero-order hold; voltage and displacement see the "
        'ratios m/k and b/k only, so the stiffness is held at the value of the data sheet.'
    ),
    source='Zhou 2021 (3), (4), (5); its table 2 with corrected units (m 0.0514 kg, k 8.0e5 N/m)',
)
