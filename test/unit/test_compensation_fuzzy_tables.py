"""Rule tables of the fuzzy PID from a file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from piezo_hysteresis.compensation.feedback.pid import (
    INTEGRAL_RULES,
    LEVELS,
    PROPORTIONAL_RULES,
    FuzzyPid,
    FuzzyRules,
    PidGains,
    infer,
    read_tables,
)
from piezo_hysteresis.compensation.link import Measured, ReferencePoint
from piezo_hysteresis.errors import CompensationError

TABLES = Path(__file__).resolve().parents[2] / 'config' / 'fuzzy' / 'symmetric.yaml'


def test_the_tables_of_the_file_are_those_that_it_has_by_itself() -> None:
    read = read_tables(TABLES)
    np.testing.assert_array_equal(read['proportional_rules'], PROPORTIONAL_RULES)
    np.testing.assert_array_equal(read['integral_rules'], INTEGRAL_RULES)


def test_tables_of_a_user_are_obeyed(tmp_path: Path) -> None:
    rows = {level: [2] * 7 for level in LEVELS}
    (tmp_path / 'mine.yaml').write_text(
        yaml.safe_dump({'proportional': {**rows, 'PB': ['PB'] * 7}, 'integral': rows})
    )
    read = read_tables(tmp_path / 'mine.yaml')
    assert infer(read['proportional_rules'], 1.0, 0.0) == 1.0
    assert infer(read['integral_rules'], 0.3, -0.7) == pytest.approx(2 / 3)
    scales = (5e-6, 1e-3, 5e2, 1e6)
    links = [
        FuzzyPid(PidGains(1e3, 2e6), rules, 1e-3)
        for rules in (FuzzyRules(*scales, **read), FuzzyRules(*scales))
    ]
    wanted = 20e-6 * np.sin(2 * np.pi * 5 * np.arange(200) * 1e-3)
    one, other = [
        [
            link.step(
                ReferencePoint(k, float(d), 0.0, 0.0, 5.0, 0.0), 0.0, Measured(k - 1, 0.0, 0.0)
            )
            for k, d in enumerate(wanted)
        ]
        for link in links
    ]
    assert np.max(np.abs(np.subtract(one, other))) > 1e-6


@pytest.mark.parametrize(
    ('change', 'says'),
    [
        (lambda c: c.pop('integral'), 'mapping of proportional and integral'),
        (lambda c: c['integral'].pop('ZO'), 'one row for each error NB'),
        (lambda c: c['integral'].update(ZO=[1, 2]), 'integral ZO lists 7 levels'),
        (lambda c: c['integral']['ZO'].__setitem__(0, 'XX'), "'XX' is no level"),
        (lambda c: c['integral']['ZO'].__setitem__(0, 4), '4 is no level'),
        (lambda c: c['integral']['ZO'].__setitem__(0, True), 'True is no level'),
    ],
)
def test_errors_in_tables_are_reported(
    change: Callable[..., Any], says: str, tmp_path: Path
) -> None:
    content = yaml.safe_load(TABLES.read_text())
    change(content)
    (tmp_path / 'mine.yaml').write_text(yaml.safe_dump(content))
    with pytest.raises(CompensationError, match=says):
        read_tables(tmp_path / 'mine.yaml')
    with pytest.raises(CompensationError, match='cannot be read: the path does not exist'):
        read_tables(tmp_path / 'none.yaml')
