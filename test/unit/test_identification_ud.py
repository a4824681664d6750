"""Well-posed recursions: right, finite with the actuator parked, invertible."""

from typing import Any

import numpy as np
import pytest

from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.identification.rls_ud import (
    FILTERED,
    GAIN,
    ROWS,
    D,
    OnlineBank,
    OnlineUd,
    UdSettings,
    bierman,
    invertible_bank,
    update_many,
)
from piezo_hysteresis.models import named

DT = 1e-3
TRUTH = {'A1': 180e-6, 'A': 60e-6, 'beta': 2.5, 'gamma': 1.0, 'offset': 6e-6}
MODE = {'natural_frequency': 68.0, 'damping_ratio': 0.015}
NOISE = 20e-9


def sine(frequency: float, seconds: float, amplitude: float = 1.0) -> np.ndarray:
    wave = np.sin(2 * np.pi * frequency * DT * np.arange(round(seconds / DT)))
    return np.asarray(amplitude * wave)


# one sine alone fits two shapes of loop nearly equally well
SWEEP = np.concatenate([sine(f, 8.0, a) for f, a in ((5, 1.0), (11, 0.5), (23, 1.0))])


def measured(u: np.ndarray, seed: int = 0) -> np.ndarray:
    model = named('bouc_wen_mode')
    y = model.respond(u, model.pack({**TRUTH, **MODE}), DT)
    return y + np.random.default_rng(seed).normal(0, NOISE, u.size)


def play_bank(u: np.ndarray) -> np.ndarray:
    """Weights 100, 10, 9, ... 2 um/V and 3 um, no mode."""
    weights = {f'w{j}': (11 - j) * 1e-6 for j in range(1, 10)}
    model = named('prandtl_ishlinskii')
    return model.respond(u, model.pack({'w0': 1e-4, 'offset': 3e-6, **weights}), DT)


def test_bierman_equals_the_textbook_covariance() -> None:
    rng = np.random.default_rng(0)
    n, forgetting = 5, 0.98
    p = np.eye(n) * 100.0
    factor, rows = np.eye(n), np.zeros((ROWS, n))
    rows[D] = 100.0
    for _ in range(200):
        x = rng.normal(size=n)
        rows[FILTERED] = x
        divisor = bierman(factor, rows, forgetting)
        gain = p @ x / (forgetting + x @ p @ x)
        p = (p - np.outer(gain, x @ p)) / forgetting
        rows[D] /= forgetting
        np.testing.assert_allclose(rows[GAIN] / divisor, gain, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose((factor * rows[D]) @ factor.T, p, rtol=1e-9, atol=1e-12)


def test_bouc_wen_is_recovered_online() -> None:
    online = OnlineUd(UdSettings(natural_frequency=68.0, damping_ratio=0.015))
    u = SWEEP
    errors = online.update_many(u, measured(u))
    estimate = online.estimate()
    values = estimate.parameters()
    for name, true in TRUTH.items():
        assert values[name] == pytest.approx(true, rel=1e-2), name
    assert np.std(errors[-2000:]) < 1.2 * NOISE
    assert estimate.model == 'bouc_wen_mode'
    free = online.free_run(u)
    assert np.std((free - measured(u))[1000:]) < 2 * NOISE


@pytest.mark.parametrize('kind', [OnlineUd, OnlineBank])
def test_parked_for_minutes_then_back_within_the_noise(kind: type[OnlineUd]) -> None:
    cycles = sine(10.0, 20.0)
    u = np.concatenate([cycles, np.zeros(300_000), cycles])
    y = play_bank(u) if kind is OnlineBank else measured(u)
    online = kind(UdSettings(forgetting=0.998, **({} if kind is OnlineBank else MODE)))
    errors = online.update_many(u, y)
    assert np.all(np.isfinite(errors))
    before = np.std(errors[18_000:20_000])
    again = np.std(errors[320_000:322_000])
    assert again < 2 * max(float(before), NOISE)


def test_parked_estimates_are_held() -> None:
    u = sine(10.0, 5.0)
    online = OnlineUd()
    online.update_many(u, measured(u))
    online.update_many(np.zeros(2000), np.zeros(2000))
    held = online.estimate()
    assert any('rests' in note for note in held.notes)
    rest = np.random.default_rng(0).normal(0, 1e-6, 50_000)
    online.update_many(np.zeros(50_000), rest)
    np.testing.assert_array_equal(online.estimate().values, held.values)


def test_play_bank_finds_its_weights() -> None:
    u = np.concatenate([sine(3.0, 5.0, a) for a in (1.0, 0.77, 0.5, 0.23)])
    online = OnlineBank(UdSettings(forgetting=1.0))
    online.update_many(u, play_bank(u))
    values = online.estimate().parameters()
    assert values['w0'] == pytest.approx(1e-4, rel=1e-3)
    weights = [values[f'w{j}'] for j in range(1, 10)]
    np.testing.assert_allclose(weights, [(11 - j) * 1e-6 for j in range(1, 10)], atol=3e-8)
    assert values['offset'] == pytest.approx(3e-6, rel=1e-3)


@pytest.mark.parametrize('kind', [OnlineUd, OnlineBank])
def test_one_by_one_gives_the_same_bits_as_many(kind: type[OnlineUd]) -> None:
    u = sine(10.0, 2.0)
    y = measured(u)
    many, single = kind(), kind()
    errors = many.update_many(u, y)
    one_by_one = [single.update(a, b) for a, b in zip(u.tolist(), y.tolist(), strict=True)]
    np.testing.assert_array_equal(errors, one_by_one)
    np.testing.assert_array_equal(many.estimate().values, single.estimate().values)


def test_data_that_cannot_be_written_compile_nothing() -> None:
    u = sine(10.0, 1.0)
    expected = OnlineUd().update_many(u, 1e-4 * u)
    known = len(getattr(update_many, 'signatures', ()))
    u.flags.writeable = False
    np.testing.assert_array_equal(OnlineUd().update_many(u, 1e-4 * u), expected)
    assert len(getattr(update_many, 'signatures', ())) == known


def test_every_estimate_can_be_inverted() -> None:
    """Noise in place of a displacement must not give a model that falls while u rises."""
    rng = np.random.default_rng(0)
    u = sine(10.0, 10.0)
    for kind in (OnlineUd, OnlineBank):
        online = kind(UdSettings(forgetting=0.99))
        online.update_many(u, 1e-4 * u + rng.normal(0, 1e-4, u.size))
        saw = np.concatenate([np.linspace(0, 1, 400), np.linspace(1, -1, 800)])
        y = online.free_run(np.concatenate([saw, saw]))
        gain = np.sign(y[399] - y[1199])
        slopes = np.diff(y[:1200]) * gain * np.sign(np.diff(saw))
        assert np.all(slopes[np.diff(saw) != 0] > 0)


def test_invertible_banks_are_not_changed() -> None:
    theta = np.array([1.0, 0.2, -0.1, 0.0, 0.3])
    np.testing.assert_allclose(invertible_bank(theta), theta, atol=1e-15)
    steep = invertible_bank(np.array([-0.4, 1.0, 0.4, 0.3]))
    assert steep[0] > 0
    assert steep[:3].sum() == pytest.approx(1.0)


def test_inverted_polarity_is_a_model_too() -> None:
    u = SWEEP
    y = -measured(u)
    online = OnlineUd(UdSettings(natural_frequency=68.0, damping_ratio=0.015))
    errors = online.update_many(u, y)
    assert np.std(errors[-2000:]) < 3 * NOISE
    assert np.std((online.free_run(u) - y)[2000:]) < 3 * NOISE


def test_a_lost_sample_is_skipped() -> None:
    u = sine(10.0, 5.0)
    y = measured(u)
    y[3000:3010] = np.nan
    online = OnlineUd(UdSettings(natural_frequency=68.0, damping_ratio=0.015))
    errors = online.update_many(u, y)
    assert np.all(np.isnan(errors[3000:3010]))
    assert np.all(np.isfinite(errors[3010:]))


@pytest.mark.parametrize(
    'wrong', [{'voltage_range': 0.0}, {'forgetting': 0.0}, {'natural_frequency': 600.0}]
)
def test_wrong_settings_are_named(wrong: dict[str, Any]) -> None:
    with pytest.raises(IdentificationError):
        UdSettings(**wrong)
