"""Free runs stay finite and bounded for any bounded input and any parameters inside bounds."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, reject, settings
from hypothesis import strategies as st

from piezo_hysteresis import models
from piezo_hysteresis.blocks import BLOCKS
from piezo_hysteresis.blocks.base import Parameter
from piezo_hysteresis.errors import ModelError
from piezo_hysteresis.models import ModelFile

DT = 1e-3
SETTINGS = settings(
    max_examples=40, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck)
)
# The Euler step of h is stable where the voltage moves less than the memory in one sample;
# the identification says so, the bounds of beta cannot.
EULER = {'bouc_wen', 'bouc_wen_power_euler', 'bouc_wen_rate_euler'}


SHARE = st.floats(0.0, 1.0)


def stable_recursion(radius: Any, place: Any) -> Any:
    """Return coefficients whose poles are a pair within the unit circle and a real one."""
    radius *= 0.999
    real = radius * max(place, 1e-3)
    third = 1.0 - 2.0 * real
    return -(radius**2 + 2.0 * real * third), radius**2 * third


def drawn(q: Parameter, share: Any) -> Any:
    """Return a parameter: signed over nine decades about its scale, inside the bounds."""
    low = max(q.low, -20 * q.scale if q.low < 0 else q.low)
    high = min(q.high, 20 * q.scale)
    if low <= 0.0:
        return low + share * (high - low)
    return float(np.exp(np.log(low) + share * (np.log(max(high, low)) - np.log(low))))


@st.composite
def inputs(draw: Any, size: Any = 400) -> Any:
    """Ramps, holds and jumps between drawn corners, 1 V at most."""
    corners = draw(st.lists(st.floats(-1.0, 1.0), min_size=2, max_size=12))
    where = np.linspace(0, size - 1, len(corners))
    held = draw(st.booleans())
    at = np.arange(size)
    if held:
        return np.asarray(corners)[np.minimum(at * len(corners) // size, len(corners) - 1)]
    return np.interp(at, where, corners)


@pytest.mark.parametrize('name', BLOCKS)
@SETTINGS
@given(data=st.data())
def test_free_run_is_finite(name: Any, data: Any) -> None:
    block = BLOCKS[name]
    x = data.draw(inputs(100 if name == 'bouc_wen_oscillator' else 400))
    if block.slot not in ('input', 'hysteresis') and name != 'bouc_wen_oscillator':
        x = 1e-4 * x
    shares = data.draw(st.lists(SHARE, min_size=8, max_size=8))
    values = {q.name: drawn(q, shares[i % 8]) for i, q in enumerate(block.parameters)}
    if name in EULER:
        values['beta'] = min(values['beta'], 0.5)
        values |= {'rate_exponent': 0.0} if 'rate_exponent' in values else {}
    if 'gamma' in values:  # the class of Bouc-Wen laws that dissipate
        values['gamma'] = float(np.clip(values['gamma'], -values['beta'], values['beta']))
    for a, b in (('c1', 'c2'), ('c3', 'c4'), ('c5', 'c6')):
        if a in values:
            values[a], values[b] = stable_recursion(*(data.draw(SHARE) for _ in range(2)))
    for key in values:
        if key.startswith('inverse_A'):  # a loop that lags, so that the voltage rises with it
            values[key] = -abs(values[key])
        if key.startswith('inverse_gamma'):
            beta = key.replace('gamma', 'beta')
            values[beta] = max(values[beta], 1.0)
            values[key] = float(np.clip(values[key], -0.9 * values[beta], values[beta]))
    if name == 'bouc_wen_oscillator':  # a passive spring that does not give way for ever
        values['mass'] = max(values['mass'], 1e-3)
        values['stiffness'] = max(values['stiffness'], 500.0)
        values['z_exponent'] = min(values['z_exponent'], 3.0)
        values['interpolation'] = round(values['interpolation'])
        values['z_gamma'] = float(np.clip(values['z_gamma'], -values['z_beta'], values['z_beta']))
        values['z_alpha'] = abs(values['z_alpha'])
    try:
        p = block.pack(values)
    except ModelError:
        reject()  # the block itself calls the combination impossible
    state = block.initial_state(DT)
    y = block.respond(x, p, DT, state=state, frequency=17.0)
    later = block.respond(np.full(200, x[-1]), p, DT, state=state, frequency=17.0)
    assert np.isfinite(y).all()
    assert np.isfinite(later).all()
    assert np.isfinite(state).all()


@SETTINGS
@given(x=inputs(), beta=st.floats(0.01, 20.0), share=st.floats(-1.0, 1.0))
def test_bouc_wen_stays_within_its_saturation(x: Any, beta: Any, share: Any) -> None:
    """|h| <= A / (beta + gamma) for |gamma| <= beta: the bound the inverse relies on."""
    gamma = share * beta
    block = BLOCKS['bouc_wen_exact']
    p = block.pack({'A1': 0.0, 'A': 4e-5, 'A0': 0.0, 'beta': beta, 'gamma': gamma})
    h = -block.respond(x, p, DT, state=block.initial_state(DT))
    if beta + gamma > 0:
        assert np.abs(h).max() <= 4e-5 / (beta + gamma) * (1 + 1e-12)


@SETTINGS
@given(
    u=st.floats(-1.0, 1.0),
    start=st.floats(-0.9, 0.9),
    split=st.floats(0.0, 1.0),
    beta=st.floats(0.0, 20.0),
    gamma=st.floats(-20.0, 20.0),
    a0=st.floats(-2e-5, 2e-5),
)
def test_exact_step_does_not_care_where_it_is_cut(
    u: Any, start: Any, split: Any, beta: Any, gamma: Any, a0: Any
) -> None:
    """One monotone move in one step or in two: the same h."""
    block = BLOCKS['bouc_wen_exact']
    p = np.array([0.0, 4e-5, a0, beta, gamma])

    def final(path: list[Any]) -> Any:
        return block.respond(np.array(path), p, DT, state=block.initial_state(DT))[-1]

    whole = final([start, u])
    cut = final([start, start + split * (u - start), u])
    assert cut == pytest.approx(whole, rel=1e-9, abs=1e-15 + 1e-12 * abs(whole))


@SETTINGS
@given(x=inputs(), a=st.floats(-5e3, 3e3), beta=st.floats(1e2, 1e5), share=st.floats(-0.9, 1.0))
def test_inverse_law_is_solved_exactly(x: Any, a: Any, beta: Any, share: Any) -> None:
    """Putting the answer into the printed law of Xiao 2014 returns the voltage."""
    block = BLOCKS['inverse_bouc_wen']
    gamma = share * beta
    values = {'inverse_gain': 7e3, 'inverse_A': a, 'inverse_beta': beta, 'inverse_gamma': gamma}
    try:
        p = block.pack(values)
    except ModelError:
        reject()
    y = block.respond(x, p, DT, state=block.initial_state(DT))
    law = BLOCKS['bouc_wen_exact']
    voltage = law.respond(y, np.array([7e3, a, 0.0, beta, gamma]), DT, state=law.initial_state(DT))
    np.testing.assert_allclose(voltage, x, atol=1e-9)


@SETTINGS
@given(data=st.data())
def test_yaml_round_trip_is_exact(data: Any, tmp_path_factory: pytest.TempPathFactory) -> None:
    model = models.named(data.draw(st.sampled_from(models.NAMES)))
    values = {
        q.name: q.default if q.held else drawn(q, data.draw(st.floats(0.0, 1.0)))
        for q in model.parameters
    }
    deviations = {
        q.name: data.draw(st.floats(1e-30, 1e3)) for q in model.parameters[:3] if not q.held
    }
    try:
        written = ModelFile(model, values, deviations)
    except ModelError:
        reject()
    path = tmp_path_factory.mktemp('model') / 'model.yaml'
    written.save(path)
    read = ModelFile.load(path)
    assert read.values == written.values
    assert read.deviations == written.deviations
    assert read.to_dict() == written.to_dict()
    assert dict(read.model.held) == dict(model.held)
    again = ModelFile.from_ros_parameters(written.to_ros_parameters())
    assert again.values == written.values
    assert again.model.held == model.held
