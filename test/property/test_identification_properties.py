"""Recursions survive anything finite; factors, shifts and folding hold for any data."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from piezo_hysteresis.identification.fit_data import fold
from piezo_hysteresis.identification.free_run import shifted
from piezo_hysteresis.identification.rls import OnlineRls, RlsSettings
from piezo_hysteresis.identification.rls_ud import OnlineBank, OnlineUd, UdSettings
from piezo_hysteresis.numerics.qr import triangle
from piezo_hysteresis.records import Record

volts = st.floats(-1.0, 1.0, width=32)
noise = st.integers(0, 2**32 - 1)
quick = settings(max_examples=40, deadline=None)


@quick
@given(
    knots=arrays(np.float64, 12, elements=volts),
    seed=noise,
    kind=st.sampled_from([OnlineUd, OnlineBank]),
    forgetting=st.sampled_from([0.9, 0.98, 0.999, 1.0]),
)
def test_well_posed_recursions_stay_finite_and_usable(
    knots: np.ndarray, seed: int, kind: type[OnlineUd], forgetting: float
) -> None:
    """Ramps and rests between any levels, a displacement that has little to do with them."""
    u = np.interp(np.arange(2400), np.arange(12) * 200, knots)
    y = 1e-4 * np.random.default_rng(seed).normal(size=u.size)
    online = kind(UdSettings(forgetting=forgetting, natural_frequency=70.0))
    assert np.all(np.isfinite(online.update_many(u, y)))
    estimate = online.estimate()
    assert np.all(np.isfinite(estimate.values))
    assert np.all(estimate.standard_deviations >= 0)
    online.model().pack(estimate.parameters())


@quick
@given(
    knots=arrays(np.float64, 12, elements=volts),
    seed=noise,
    forgetting=st.sampled_from([0.98, 0.999, 1.0]),
    unit=st.sampled_from(['mm', 'um']),
)
def test_the_papers_recursion_stays_finite(
    knots: np.ndarray, seed: int, forgetting: float, unit: str
) -> None:
    u = np.interp(np.arange(2400), np.arange(12) * 200, knots)
    y = 1e-4 * u + 1e-6 * np.random.default_rng(seed).normal(size=u.size)
    rls = OnlineRls(RlsSettings(forgetting=forgetting, unit=unit, offset=True))
    assert np.all(np.isfinite(rls.update_many(u, y)))


@quick
@given(arrays(np.float64, (4, 23), elements=st.floats(-1e3, 1e3)))
def test_the_triangle_keeps_the_inner_products(rows: np.ndarray) -> None:
    r = triangle(rows.copy())
    scale = max(float(np.max(np.abs(rows))) ** 2, 1e-300)
    np.testing.assert_allclose(r.T @ r, rows @ rows.T, atol=1e-11 * scale)


@quick
@given(cubic=arrays(np.float64, 4, elements=st.floats(-2, 2)), samples=st.floats(-1.0, 1.0))
def test_shifts_are_exact_for_cubics(cubic: np.ndarray, samples: float) -> None:
    k = np.arange(20.0)
    inner = slice(3, -3)
    np.testing.assert_allclose(
        shifted(np.polyval(cubic, k), samples)[inner],
        np.polyval(cubic, k + samples)[inner],
        rtol=1e-9,
        atol=1e-9,
    )


@quick
@given(period=st.integers(20, 120), count=st.integers(4, 12), seed=noise)
def test_folding_keeps_every_sample_of_a_steady_record(period: int, count: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    u = np.tile(rng.normal(size=period), count)
    y = 1e-5 * u + 1e-8 * rng.normal(size=u.size)
    parts = fold(Record('r', 1e-3, u, y))
    assert parts[0].period == period
    mean = y[-parts[0].repeats * period :].reshape(-1, period).mean(axis=0)
    np.testing.assert_allclose(parts[0].measured, mean)
    assert parts[0].noise == pytest.approx(1e-8, rel=0.5)
    drive = parts[0].pick(parts[0].voltage)
    np.testing.assert_array_equal(drive, u[-period:])
