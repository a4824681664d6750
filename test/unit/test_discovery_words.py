"""The description of a residual."""

from __future__ import annotations

import pytest

from piezo_hysteresis.discovery.verdict.describe import growth


@pytest.mark.parametrize(
    ('power', 'words'),
    [
        (2.0, 'increases with the frequency, about with power 2.0'),
        (-0.3, 'decreases with the frequency, about with power -0.3'),
        (0.05, 'hardly depends on the frequency'),
    ],
)
def test_growth_and_decrease_are_distinguished(power: float, words: str) -> None:
    assert words in growth('frequency', power)


def test_sizes_without_a_law_are_not_described_as_constant() -> None:
    assert growth('frequency', 0.05, 0.5) == 'Its change with the frequency follows no power law.'
