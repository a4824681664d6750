"""Prandtl-Ishlinskii hysteresis: a weighted bank of play operators."""

from collections.abc import Sequence
from typing import Any

from piezo_hysteresis.blocks._plays import COUNT, bank_of
from piezo_hysteresis.blocks.base import Block, InterSample, InverseRole, Parameter, Slot

# Plays of the fine bank. Its thresholds are at the middles of as many equal parts of the range:
# the smallest one, half a part, determines the curve after each reversal.
FINE = 20


def _block(
    name: str,
    prefix: str,
    weight: str,
    half_widths: Sequence[float],
    kernels: dict[str, Any],
    role: InverseRole | None = None,
) -> Block:
    """Return a bank of plays; the default weights of all banks have the same sum."""
    count = len(half_widths)
    return Block(
        name=name,
        role=role,
        slot=Slot.HYSTERESIS,
        parameters=(
            Parameter(
                f'{prefix}_range',
                'V',
                1.0,
                1e-9,
                1e5,
                'Input amplitude to which the thresholds '
                f'{half_widths[0]:g} .. {half_widths[-1]:g} refer.',
                1.0,
                follows_range=True,
            ),
            Parameter(f'{weight}0', 'm/V', 1e-4, -1e-2, 1e-2, 'Weight without threshold.', 1e-4),
            *(
                Parameter(
                    f'{weight}{j}',
                    'm/V',
                    3.6e-5 / count,
                    -1e-2,
                    1e-2,
                    f'Weight of the play of half width {half_width:g} {prefix}_range.',
                    4.5e-5 / count,
                )
                for j, half_width in enumerate(half_widths, 1)
            ),
        ),
        **kernels,
        state_size=count,
        between=InterSample.PATH,
        description=(
            f'Bank of {count} play operators: rate-independent hysteresis with nonlocal memory.'
        ),
        source='reference model; Tatebatake 2017 and Fang 2019 name it as the alternative',
    )


BLOCKS = (
    _block(
        'prandtl_ishlinskii',
        'pi',
        'w',
        [j / (COUNT + 1) for j in range(1, COUNT + 1)],
        bank_of(1.0, 1, 1),
        InverseRole.PLAYS,
    ),
    _block(
        'prandtl_ishlinskii_fine',
        'fine_pi',
        'fine_w',
        [(j + 0.5) / FINE for j in range(FINE)],
        bank_of(0.5, 0, 1),
    ),
)
