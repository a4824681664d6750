"""The description of a residual."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from piezo_hysteresis.discovery.verdict.build_verdict import growth, law_sentences
from piezo_hysteresis.identification.targets import whole
from piezo_hysteresis.records import Record


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


def test_sizes_without_a_law_get_no_sentence_about_one() -> None:
    view = whole(Record('r', 1e-3, np.sin(np.arange(2000.0)), np.zeros(2000)))
    views = [replace(view, frequency=each) for each in (1.0, 3.0, 10.0, 30.0)]
    clean = np.array([1e-6, 3e-6, 1e-5, 3e-5])
    assert 'increases with the frequency' in ' '.join(law_sentences(views, clean, 1e-9))
    assert law_sentences(views, clean[[2, 0, 3, 1]], 1e-9) == []
