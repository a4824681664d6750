"""The table of the tutorial is what its study measures."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from studies.per_frequency import METHODS, Row, measured, table

PAGE = Path(__file__).resolve().parents[2] / 'docs' / 'tutorials' / 'online.md'


def test_recorded_frequencies_are_apart_from_those_between() -> None:
    rows = [
        Row('1 Hz', True, (4e-6, 3e-6, 2e-6, 1e-6)),
        Row('3 Hz', False, (8e-6, 6e-6, 4e-6, 2e-6)),
        Row('7 + 19 Hz', False, (9e-6, 9e-6, 9e-6, 9e-6)),
    ]
    lines = table({'m': rows})
    assert lines[2] == '| recorded, median (worst) | m | 4 (4) | 3 (3) | 2 (2) | 1 (1) |'
    assert lines[3] == '| between, median (worst) | m | 8 (8) | 6 (6) | 4 (4) | 2 (2) |'
    assert lines[4] == '| 7 + 19 Hz | m | 9 | 9 | 9 | 9 |'


@pytest.mark.slow
def test_the_page_states_what_the_study_measures() -> None:
    stated = re.findall(r'^\| .*\| (?:Fujii 2018|rls_ud) \|.*$', PAGE.read_text('utf-8'), re.M)
    found = table({method: measured(method, 20.0, 6.0) for method in METHODS})[2:]
    for line, other in zip(stated, found, strict=True):
        assert line.split('|')[:3] == other.split('|')[:3]
        numbers = [[float(x) for x in re.findall(r'[\d.]+', row.split('|', 3)[3])]
                   for row in (line, other)]  # fmt: skip
        assert numbers[0] == pytest.approx(numbers[1], rel=0.05)
