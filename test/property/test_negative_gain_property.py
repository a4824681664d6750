"""An actuator whose reading falls with the voltage is inverted like one whose reading rises."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from piezo_hysteresis.compensation.controllers import Controllers
from piezo_hysteresis.compensation.inverses.inverse_choice import inverse_for
from piezo_hysteresis.compensation.link import Limits
from piezo_hysteresis.compensation.offline_loop import ModelPlant, closed_loop, tracking_metrics
from piezo_hysteresis.models import Model, ModelFile, named
from piezo_hysteresis.waveforms import Sine

DT = 1e-3
LAWS = (
    ('classical', 'auto'), ('bouc_wen_mode', 'auto'), ('prandtl_ishlinskii+mode', 'auto'),
    ('bouc_wen_mode', 'zhou2021'), ('bouc_wen_mode', 'gain'), ('extended', 'fujii2018'),
    ('extended', 'tatebatake2017'), ('prandtl_ishlinskii+mode+creep', 'auto'),
    ('classical+mode+creep', 'numeric'),
)  # fmt: skip


def values_of(model: Model, sizes: Any) -> tuple[dict[str, float], dict[str, float]]:
    """Return parameters near the defaults, and those of the reversed reading."""
    rising = {
        each.name: value
        if each.name in model.held or each.unit == '1'
        else (value or 1e-6 * (each.unit == 'm')) * size
        for each, value, size in zip(
            model.parameters, model.pack(model.defaults()), sizes, strict=False
        )
    }
    falling = {
        each.name: -rising[each.name]
        if each.unit in ('m', 'm/V') or each.name == 'gamma'
        else rising[each.name]
        for each in model.parameters
        if each.name in rising
    }
    return rising, falling


@pytest.mark.parametrize(('name', 'law'), LAWS)
@given(sizes=st.lists(st.floats(0.9, 1.1), min_size=30, max_size=30), share=st.floats(0.1, 0.4))
@settings(max_examples=5)
def test_the_voltage_is_that_for_the_reversed_reading(
    name: str, law: str, sizes: list[float], share: float
) -> None:
    model = named(name)
    rising, falling = values_of(model, sizes)
    up, down = (inverse_for(model, each, DT, law=law) for each in (rising, falling))
    time = np.arange(2000, dtype=np.float64) * DT
    wanted = Sine(share * 80e-6, 11.0, 2.0, ramp=0.5).sample(time)
    motion = np.array([wanted.value, wanted.velocity, wanted.acceleration])
    expected = up.respond(*motion)
    assert np.ptp(expected) > 1e-3
    # the same but for the rounding of sums in another order
    np.testing.assert_allclose(down.respond(*-motion), expected, rtol=1e-9, atol=1e-12)
    driven = model.respond(expected, model.pack(falling), DT)
    np.testing.assert_allclose(
        driven, -model.respond(expected, model.pack(rising), DT), atol=1e-15
    )


@pytest.mark.parametrize('name', ['bouc_wen_mode', 'prandtl_ishlinskii+mode+creep'])
def test_a_reversed_sensor_is_tracked_with_the_defaults(name: str) -> None:
    model = named(name)
    rising, falling = values_of(model, [1.0] * 30)
    limits = Limits(-1.2, 1.2, 1e4)
    wanted = Sine(20e-6, 11.0, 3.0, ramp=0.5).sample(np.arange(3000, dtype=np.float64) * DT)
    errors = []
    for values in (rising, falling):
        chosen = Controllers(DT, limits, ModelFile(model, values))
        for links in ([chosen.straight()], [chosen.inverse()]):
            run = closed_loop(wanted, links, ModelPlant(model, values, DT), limits, DT)
            errors.append(tracking_metrics(run, 1.5).rms)
    assert errors[1] < 0.1 * errors[0]
    assert errors[3] < 0.1 * errors[2]
