"""Settings of the attenuation of several axes, apart from it: tables of nodes import no model."""

from __future__ import annotations

from dataclasses import dataclass

from piezo_hysteresis.common.parameter_table import judge, setting
from piezo_hysteresis.errors import CompensationError


@dataclass(frozen=True)
class MatrixSettings:
    """Settings of `MatrixAttenuation`, and parameters of the node that runs it."""

    orders: tuple[int, ...] = setting(
        (0, 1, 2, 3, 4, 5, 6, 7, 8, 9),
        'Harmonic orders of the reference of each axis to attenuate in all axes; 0 is the mean.',
        '1',
        low=0,
        high=99,
    )
    step: float = setting(
        0.3,
        'Fraction of the error of a line that one period removes; all lines together learn no '
        'faster than a quarter of the decay of the slowest mode.',
        '1',
        above=0.0,
        high=1.0,
    )
    largest_correction: float = setting(
        0.0,
        'Bound on the correction amplitude of one order; 0 takes 5/24 of the voltage range.',
        'V',
        low=0.0,
        high=2000.0,
    )

    def __post_init__(self) -> None:
        reason = judge(self)
        if not reason and len(set(self.orders)) != len(self.orders):
            reason = f'orders must be different, got {list(self.orders)}'
        if reason:
            raise CompensationError(f'attenuation: {reason}')
