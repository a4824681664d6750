"""The baseline of a search is fitted from as many starting points as an identification."""

from __future__ import annotations

import pytest

from piezo_hysteresis.discovery.data.dataset import split
from piezo_hysteresis.discovery.selection.baseline import fitted_baselines
from piezo_hysteresis.identification.initial_conditions.revision import Choices
from piezo_hysteresis.models import named
from studies.worlds.simulated_world import draw, records_of


@pytest.mark.component
def test_a_baseline_that_describes_the_records_leaves_their_noise() -> None:
    """From four starting points it ended at three noise floors, with a memory named."""
    hidden = draw('null', 7, 301, 'poor')
    data = split(records_of(hidden))
    base, _ = fitted_baselines(data, named(hidden.world.baseline), Choices(zero='record'))
    assert base.joint.floors < 1.2
