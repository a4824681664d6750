"""What is missed in phase with the drive: met where it is known, less sure away from there."""

from __future__ import annotations

import numpy as np
import pytest

from piezo_hysteresis.errors import ModelError
from piezo_hysteresis.models import Condition, Discrepancy
from piezo_hysteresis.models.repeating import repeating, usual_powers

STROKE = 1e-4


def missed(frequency: float, amplitude: float, size: float, phase: float | None) -> Condition:
    phases = {} if phase is None else {3: phase}
    return Condition(frequency, amplitude, STROKE, size, None, {3: size}, {}, phases)


def test_what_is_known_is_met_and_what_is_far_is_open() -> None:
    places = np.array([[1.0, 1.0], [4.0, 1.0]])
    phasors = np.array([[1e-2 + 1e-2j, 1e-2 + 2e-2j]])
    wanted = np.array([[1.0, 1.0], [2.0, 1.0], [1e4, 1.0]])
    mean, square = repeating(places, phasors, wanted)
    assert mean[0, 0] == pytest.approx(phasors[0, 0], rel=0.05)
    assert abs(mean[0, 2]) < 0.3 * abs(mean[0, 0])
    assert square[0, 0] < 0.1 * square[0, 1] < 0.1 * square[0, 2]
    assert square[0, 2] == pytest.approx(np.mean(np.abs(phasors) ** 2), rel=0.6)


def test_phases_that_turn_are_less_sure_than_those_that_stay() -> None:
    places = np.array([[f, 1.0] for f in (1.0, 2.0, 4.0, 8.0)])
    wanted = np.array([[2.8, 1.0]])
    stays = 1e-2 * np.ones((1, 4), np.complex128)
    turns = 1e-2 * np.exp(2.4j * np.arange(4.0))[None, :]
    mean, square = repeating(places, stays, wanted)
    other, more = repeating(places, turns, wanted)
    assert abs(mean[0, 0] - 1e-2) < 1e-3
    assert square[0, 0] < 0.3 * more[0, 0]
    assert abs(other[0, 0]) < abs(mean[0, 0])


def test_a_discrepancy_repeats_itself_where_all_its_phases_are_known() -> None:
    at = np.array([0.5, 1.0])
    known = Discrepancy(True, (missed(5.0, 1.0, 2e-7, 0.7),))
    found = known.repeats(5.0, at)
    assert found is not None
    assert sorted(found) == list(range(1, 13))
    assert np.angle(found[3].mean[1]) == pytest.approx(0.7)
    assert abs(found[3].mean[1]) == pytest.approx(2e-3, rel=0.05)
    assert found[3].square[0] > found[3].square[1]
    assert found[1].mean[1] == 0.0
    assert known.repeats(0.0, at) is None
    assert known.octaves_from(10.0, 2.0) == pytest.approx(2.0)
    blind = Discrepancy(True, (missed(5.0, 1.0, 2e-7, 0.7), missed(9.0, 1.0, 2e-7, None)))
    assert blind.repeats(5.0, at) is None


def test_phases_are_written_and_read() -> None:
    known = Discrepancy(True, (missed(5.0, 1.0, 2e-7, -1.5),))
    assert Discrepancy.parse(known.to_dict()) == known
    with pytest.raises(ModelError, match='phases'):
        missed(5.0, 1.0, 2e-7, float('nan'))


def test_a_fundamental_that_a_fit_absorbed_is_expected_elsewhere() -> None:
    phasors = np.array([[1e-4], [1e-2], [3e-3]], np.complex128)
    places, wanted = np.array([[1.0, 1.0]]), np.array([[1.0, 1.0], [1.0, 0.25]])
    _, square = repeating(places, phasors, wanted)
    here, there = np.sqrt(square[0])
    assert here < 2e-3  # known where it was fitted
    assert 5e-3 < there < 2e-2  # as large as the higher harmonics at another amplitude


def test_usual_powers_are_those_of_the_higher_harmonics() -> None:
    phasors = np.outer(1.0 / np.arange(1.0, 13.0), np.exp(1j * np.arange(3)))
    power = np.mean(np.abs(phasors) ** 2, axis=1)
    phasors[0] = 0.0
    np.testing.assert_allclose(usual_powers(phasors), power, rtol=1e-12)
