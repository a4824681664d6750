"""Every excitation is judged by the evidence of its periods, at any rate, range and offset."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import lfilter

import piezo_hysteresis as ph
from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.identification.checks import require_usable
from piezo_hysteresis.identification.fit_data import fold
from piezo_hysteresis.identification.periods import main_frequency, period_of
from piezo_hysteresis.models import named
from piezo_hysteresis.records import Record

COUNT = 6000


def drive(kind: str, n: int = COUNT) -> np.ndarray:
    """Return a voltage between -1 and 1."""
    x = np.arange(n) / n
    rng = np.random.default_rng(7)
    cycle = {
        'sine': np.sin(2 * np.pi * 12 * x),
        'slow sine': np.sin(2 * np.pi * 2.4 * x + 0.3),
        'triangle': 4 * np.abs((6 * x + 0.1) % 1 - 0.5) - 1,
        'raster': np.minimum((5 * x % 1) / 0.9, (1 - 5 * x % 1) / 0.1) * 2 - 1,
        'ramp': 2 * x - 1,
        'staircase': 2 * np.floor(8 * x) / 7 - 1,
        'step': np.where(x < 0.1, -1.0, 1.0),
        'one triangle': 1 - 2 * np.abs(2 * x - 1),
        'multisine': np.sum([np.sin(2 * np.pi * (k * 4 * x + k**2 / 7)) for k in (1, 2, 5, 9)], 0),
        'noise': np.convolve(rng.normal(size=n), np.ones(40) / 6.0, 'same'),
        'chirp': np.sin(2 * np.pi * (1 + 20 * x) * x),
        'shrinking': (1 - 0.9 * x) * np.sin(2 * np.pi * 10 * x),
    }[kind]
    return np.asarray(cycle / float(np.max(np.abs(cycle))), np.float64)


#: Kind of drive with its period in samples, and its main frequency in cycles per record.
FAMILY = {
    'sine': (500, 12.0), 'slow sine': (2500, 2.4), 'triangle': (1000, 6.0), 'raster': (1200, 0.0),
    'ramp': (0, 0.0), 'staircase': (0, 0.0), 'step': (0, 0.0), 'one triangle': (0, 0.0),
    'multisine': (1500, 0.0), 'noise': (0, 0.0), 'chirp': (0, 0.0), 'shrinking': (0, 10.0),
}  # fmt: skip


@pytest.mark.parametrize('kind', FAMILY)
@settings(max_examples=6, deadline=None, derandomize=True)
@given(
    rate=st.sampled_from([100.0, 1e3, 1e4, 1e5]),
    volts=st.sampled_from([1.0, 100.0, 1e3]),
    offset=st.sampled_from([0.0, 1.0, -3.0]),
    stroke=st.sampled_from([1e-8, 1e-5, 1e-3]),
)
def test_periods_are_found_at_any_scale(
    kind: str, rate: float, volts: float, offset: float, stroke: float
) -> None:
    u = np.round(volts * (drive(kind) + offset), 6)
    noise = 1e-4 * np.random.default_rng(0).normal(size=u.size)
    record = Record(kind, 1 / rate, u, stroke * (drive(kind) + noise))
    period, cycles = FAMILY[kind]
    assert period_of(record) == period
    assert main_frequency(record) * COUNT / rate == pytest.approx(cycles, rel=0.02, abs=1e-9)
    assert all('flat' in warning or 'unit' in warning for warning in require_usable([record]))


@pytest.mark.parametrize('samples', [100, 6301, 100_000])
@pytest.mark.parametrize('rounding', [0.0, 1e-4])
def test_a_sample_of_a_slow_sine_is_no_period(samples: int, rounding: float) -> None:
    u = np.sin(2 * np.pi * np.arange(5 * samples) / (samples + 0.02))
    u = np.round(u / rounding) * rounding if rounding else u
    record = Record('slow', 1e-4, u, 1e-6 * u)
    assert abs(period_of(record) - samples) <= 1 or period_of(record) == 0
    assert main_frequency(record) == pytest.approx(1e4 / samples, rel=0.01)
    for target in fold(record):
        assert np.ptp(target.measured) == pytest.approx(2e-6, rel=1e-3)


@pytest.mark.parametrize('periods', [0.3, 0.94, 1.5])
def test_less_than_two_periods_are_no_period(periods: float) -> None:
    u = np.sin(2 * np.pi * periods * np.arange(COUNT) / COUNT)
    record = Record('part', 1e-3, u, 1e-6 * u)
    assert period_of(record) == 0
    assert main_frequency(record) == 0.0
    assert require_usable([record]) == []


def test_a_step_before_small_periods_is_not_lost() -> None:
    x = np.arange(COUNT)
    u = np.where(x < 1000, 0.0, 10.0) + 0.1 * np.sin(2 * np.pi * x / 100) * (x >= 1000)
    record = Record('held', 1e-3, u, 1e-6 * u + 1e-9 * np.random.default_rng(0).normal(size=COUNT))
    assert period_of(record) == 100
    assert fold(record) == []


def test_a_resonance_that_correlates_at_no_delay_belongs_to_its_drive() -> None:
    u = np.random.default_rng(3).normal(size=COUNT)
    y = lfilter([1.0], [1.0, -1.9, 0.996], u)
    assert require_usable([Record('ring', 1e-3, u, 1e-6 * y / np.ptp(y))]) == []
    with pytest.raises(IdentificationError, match='nothing in common'):
        require_usable([Record('other', 1e-3, u, 1e-6 * np.roll(y[::-1], 77) / np.ptp(y))])


@pytest.mark.component
@pytest.mark.parametrize('kind', FAMILY)
def test_an_unknown_start_costs_little_or_is_stated(kind: str) -> None:
    """Free run against a fit that knows the last extreme before the record."""
    rng = np.random.default_rng((54, list(FAMILY).index(kind)))
    rate, span = 10.0 ** rng.integers(2, 6), 10.0 ** rng.uniform(0.0, 3.0)
    stroke, middle = 10.0 ** rng.uniform(-8.0, -3.0), span * rng.uniform(-0.5, 0.5)
    u = np.round(middle + 0.5 * span * drive(kind), 6)
    model = named('prandtl_ishlinskii').hold(pi_range=float(np.max(np.abs(u))))
    weights = {f'w{k}': stroke / span * (0.04 if k else 0.6) for k in range(10)}
    packed = model.pack({**model.defaults(), **weights})
    last = u[0] + 0.3 * span * rng.uniform(-1.0, 1.0)
    history = np.concatenate([np.linspace(0.0, last, 200), np.linspace(last, u[0], 100)])
    moved = model.respond(np.concatenate([history, u]), packed, 1.0 / rate)[history.size :]
    moved += 3e-4 * stroke * rng.standard_normal(moved.size)
    record = Record(kind.replace(' ', '_'), 1.0 / rate, u, moved)
    alone = ph.identify(record, 'prandtl_ishlinskii')
    known = ph.identify(record, 'prandtl_ishlinskii', before=np.array([last]))
    assert np.isfinite(alone.records[0].free_run_rms)
    ratio = alone.records[0].free_run_rms / known.records[0].free_run_rms
    assert ratio < 1.5 or len(alone.warnings) > len(known.warnings)
