"""The picture of every effect agrees with its page."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from piezo_hysteresis import models

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / 'tools'))
import draw_effects  # noqa: E402


@pytest.fixture(scope='module')
def changes() -> dict[Any, Any]:
    """Return by effect what it changes at each drive [m]."""
    return {name: draw_effects.draw(name)[1] for name in models.EFFECT_NAMES}


def harmonic(changes: Any, name: Any, order: int) -> np.ndarray:
    """Return an amplitude of each drive, slow to fast [m]."""
    sizes = changes[name].items()
    return np.array([draw_effects.amplitude(change, order * f) for f, change in sizes])


@pytest.mark.component
@pytest.mark.parametrize('name', models.EFFECT_NAMES)
def test_every_page_shows_a_picture_of_a_change(changes: dict[Any, Any], name: Any) -> None:
    page = (ROOT / 'docs/effects' / f'{name}.md').read_text()
    assert f'](../pictures/effects/{name}.png)' in page
    assert (ROOT / 'docs/pictures/effects' / f'{name}.png').stat().st_size > 10_000
    assert max(np.abs(change).max() for change in changes[name].values()) > 1e-8


@pytest.mark.parametrize('name', ['transport_delay', 'amplifier_lag', 'rate_dependence'])
def test_what_is_dynamic_grows_with_frequency(changes: dict[Any, Any], name: str) -> None:
    first = harmonic(changes, name, 1)
    assert np.all(np.diff(first) > 0)


@pytest.mark.parametrize('name', ['saturation', 'stiffness', 'nonlocal_memory', 'friction'])
def test_what_is_static_is_the_same_at_every_frequency(changes: dict[Any, Any], name: str) -> None:
    third = harmonic(changes, name, 3)
    assert third.min() > 1e-7
    np.testing.assert_allclose(third, third.mean(), rtol=0.1)


def test_odd_effects_have_no_even_harmonics_and_electrostriction_has(
    changes: dict[Any, Any],
) -> None:
    for name in ('saturation', 'stiffness', 'odd_harmonic'):
        assert harmonic(changes, name, 2).max() < 0.02 * harmonic(changes, name, 3).max()
    even = harmonic(changes, 'electrostriction', 2)
    np.testing.assert_allclose(even, harmonic(changes, 'electrostriction', 0), rtol=0.05)


def test_creep_shows_at_low_frequency_drift_in_the_mean_and_hum_on_no_harmonic(
    changes: dict[Any, Any],
) -> None:
    creep = harmonic(changes, 'creep', 1)
    assert np.all(np.diff(creep) < 0)
    slow = changes['drift'][draw_effects.DRIVES[0]]
    assert slow[-1] == pytest.approx(2 * slow[len(slow) // 2], rel=1e-2)
    hum = changes['mains_hum'][draw_effects.DRIVES[0]]
    assert draw_effects.rest(hum, draw_effects.DRIVES[0]) == pytest.approx(
        np.abs(hum).max(), rel=0.02
    )
