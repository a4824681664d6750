"""What is left is described as a colleague would say it."""

from __future__ import annotations

import pytest

from piezo_hysteresis.discovery.verdict.describe import growth


@pytest.mark.parametrize(
    ('power', 'words'),
    [
        (2.0, 'grows with the frequency, about as its power 2.0'),
        (-0.3, 'falls with the frequency, about as its power -0.3'),
        (0.05, 'hardly changes with the frequency'),
    ],
)
def test_growth_and_fall_are_told_apart(power: float, words: str) -> None:
    assert words in growth('frequency', power)


def test_sizes_that_follow_no_law_are_not_said_to_stay() -> None:
    assert growth('frequency', 0.05, 0.5) == 'With the frequency it changes by no simple law.'
