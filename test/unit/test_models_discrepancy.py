"""What a model is known to miss, and how its values hang together: made, written, read."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from piezo_hysteresis.errors import ModelError
from piezo_hysteresis.models import Condition, Correlation, Discrepancy, ModelFile, named

MATRIX = np.array([[1.0, 0.5, -0.25], [0.5, 1.0, 0.125], [-0.25, 0.125, 1.0]])
KNOWN = Discrepancy(
    True,
    (
        Condition(1.0, 1.0, 1e-4, 5e-7, 3e-7, {0: 1e-7, 1: 3e-7}),
        Condition(8.0, 1.0, 1e-4, 1e-6, None, {1: 8e-7, 3: 6e-7}),
        Condition(0.0, 0.5, 5e-5, 2e-7, None, {}, {0.1: 1e-7, 0.2: 1.5e-7}),
    ),
)


def model_file(**more: Any) -> ModelFile:
    model = named('classical')
    deviations = {'A1': 1e-9, 'A': 2e-9, 'beta': 0.5}
    return ModelFile(model, model.defaults(), deviations, **more)


# --- correlation --------------------------------------------------------------------------------


def test_the_covariance_is_that_of_deviations_and_correlation() -> None:
    names, matrix = model_file(correlation=Correlation(('A1', 'A', 'beta'), MATRIX)).covariance()
    assert names == ('A1', 'A', 'beta')
    spread = np.array([1e-9, 2e-9, 0.5])
    np.testing.assert_allclose(matrix, MATRIX * np.outer(spread, spread))


def test_without_a_correlation_the_covariance_is_diagonal() -> None:
    _, matrix = model_file().covariance()
    np.testing.assert_array_equal(matrix, np.diag(np.square([1e-9, 2e-9, 0.5])))


def test_the_order_of_the_names_is_theirs() -> None:
    correlation = Correlation(('beta', 'A1'), np.array([[1.0, 0.7], [0.7, 1.0]]))
    names, matrix = model_file(correlation=correlation).covariance()
    assert names == ('A1', 'A', 'beta')
    assert matrix[0, 2] == pytest.approx(0.7 * 1e-9 * 0.5)
    assert matrix[0, 1] == 0.0


def test_rounding_leaves_no_negative_variance() -> None:
    """Two values that can hardly be distinguished, written with nine digits."""
    tight = np.array(
        [[1.0, 1.0 - 1e-12, 0.3], [1.0 - 1e-12, 1.0, 0.3 + 1e-7], [0.3, 0.3 + 1e-7, 1.0]]
    )
    read = Correlation.parse(Correlation(('a', 'b', 'c'), tight).to_dict())
    assert np.linalg.eigvalsh(read.matrix).min() > -1e-12
    np.testing.assert_allclose(read.matrix, tight, atol=1e-6)
    np.testing.assert_array_equal(np.diag(read.matrix), np.ones(3))


def test_only_what_has_a_deviation_is_kept() -> None:
    correlation = Correlation.among(('A1', 'late', 'beta'), MATRIX, ('A1', 'beta'))
    assert correlation is not None
    assert correlation.names == ('A1', 'beta')
    assert correlation.matrix[0, 1] == -0.25
    assert Correlation.among(('A1',), np.array([[np.nan]]), ('A1',)) is None
    assert Correlation.among(('A1',), np.eye(1), ()) is None


# --- discrepancy --------------------------------------------------------------------------------


def test_sizes_are_those_of_the_conditions() -> None:
    assert KNOWN.conditions[0].missed == pytest.approx(4e-7)
    assert KNOWN.conditions[0].share == pytest.approx(4e-3)
    assert KNOWN.rms == pytest.approx(np.sqrt((25 + 100 + 4) / 3) * 1e-7)
    assert KNOWN.share == pytest.approx(np.sqrt((4e-3**2 + 1e-2**2 + 4e-3**2) / 3))
    assert KNOWN.by_frequency() == pytest.approx({0.0: 2e-7, 1.0: 5e-7, 8.0: 1e-6})
    assert KNOWN.by_amplitude() == pytest.approx({0.5: 2e-7, 1.0: np.sqrt(62.5) * 1e-7})
    assert KNOWN.by_harmonic() == pytest.approx(
        {0: 1e-7 / np.sqrt(2), 1: np.sqrt((9 + 64) / 2) * 1e-7, 3: 6e-7 / np.sqrt(2)}
    )


def test_known_conditions_are_expected_as_they_were() -> None:
    assert KNOWN.expected(1.0, 1.0, 1e-4, 3e-7) == pytest.approx(5e-7, rel=1e-3)
    assert KNOWN.expected(8.0, 1.0, 1e-4, 0.0) == pytest.approx(1e-6, rel=1e-3)


def test_between_known_conditions_lies_what_is_between() -> None:
    halfway = KNOWN.expected(2.83, 1.0, 1e-4, 0.0)
    assert 4e-7 < halfway < 1e-6
    assert KNOWN.expected(1.2, 1.0, 1e-4, 0.0) < halfway < KNOWN.expected(7.0, 1.0, 1e-4, 0.0)


def test_an_error_grows_with_the_stroke_and_the_noise() -> None:
    assert KNOWN.expected(8.0, 1.0, 2e-4, 0.0) == pytest.approx(2e-6, rel=1e-3)
    assert KNOWN.expected(8.0, 1.0, 1e-4, 1e-6) == pytest.approx(np.sqrt(2) * 1e-6, rel=1e-3)
    every = KNOWN.expected(0.0, 1e3, 1e-4, 0.0)
    assert every == pytest.approx(1e-4 * KNOWN.share, rel=0.1)


@pytest.mark.parametrize(
    'wrong', [{'rms': -1.0}, {'stroke': 0.0}, {'noise': float('nan')}, {'harmonics': {1: -1.0}}]
)
def test_a_discrepancy_holds_sizes(wrong: dict[str, Any]) -> None:
    with pytest.raises(ModelError, match='sizes'):
        Condition(**{'frequency': 1.0, 'amplitude': 1.0, 'stroke': 1.0, 'rms': 0.1, **wrong})
    with pytest.raises(ModelError, match='at least one row'):
        Discrepancy(True, ())


# --- files --------------------------------------------------------------------------------------


def test_both_are_written_in_few_lines_and_read_back(tmp_path: Path) -> None:
    saved = model_file(correlation=Correlation(('A1', 'A', 'beta'), MATRIX), discrepancy=KNOWN)
    saved.save(tmp_path / 'model.yaml')
    read = ModelFile.load(tmp_path / 'model.yaml')
    assert read.discrepancy == KNOWN
    assert read.correlation is not None
    np.testing.assert_array_equal(read.correlation.matrix, MATRIX)
    text = (tmp_path / 'model.yaml').read_text()
    assert '  beta: [-0.25, 0.125]\n' in text
    assert text.count('\n  - {frequency:') == 3
    assert 'judged_on: held-out' in text
    json.dumps(saved.to_dict())  # plain types
    assert yaml.safe_load(text) == saved.to_dict()


@pytest.mark.parametrize(
    ('change', 'says'),
    [
        (lambda c: c['correlation'].update(A=[]), 'correlation A must list 1 numbers'),
        (lambda c: c['correlation'].update(A=[2.0]), 'within -1 .. 1'),
        (lambda c: c['correlation'].update(A=['x']), 'correlation A must be a number'),
        (lambda c: c['correlation'].update(gamma=[0.0, 0.0, 0.0]), 'gamma without a standard'),
        (lambda c: c.update(correlation=[1]), 'correlation must be a mapping'),
        (lambda c: c['discrepancy'].update(judged_on='hearsay'), 'held-out or fitted'),
        (lambda c: c['discrepancy'].update(conditions=[]), 'at least one row'),
        (lambda c: c['discrepancy'].update(conditions=3), 'must be a list'),
        (lambda c: c['discrepancy'].update(size=3), 'unknown size'),
        (lambda c: c['discrepancy']['conditions'][0].pop('rms'), 'rms must be a number'),
        (lambda c: c['discrepancy']['conditions'][0].update(rms='big'), 'rms must be a number'),
        (lambda c: c['discrepancy']['conditions'][0].update(colour=3), 'unknown colour'),
        (lambda c: c['discrepancy']['conditions'][0].update(bands={'x': 1}), 'bands must be'),
    ],
)
def test_errors_in_a_file_are_reported(
    change: Callable[..., Any], says: str, tmp_path: Path
) -> None:
    saved = model_file(correlation=Correlation(('A1', 'A', 'beta'), MATRIX), discrepancy=KNOWN)
    content = yaml.safe_load(saved.text())
    change(content)
    (tmp_path / 'model.yaml').write_text(yaml.safe_dump(content, sort_keys=False))
    with pytest.raises(ModelError, match=says):
        ModelFile.load(tmp_path / 'model.yaml')
