"""The papers' RLS: equal to the equations, bit-equal both ways, bounded over long runs."""

from collections.abc import Callable

import numpy as np
import pytest

from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.identification.rls import OnlineRls, RlsSettings

DT = 1e-3


def plant(u: np.ndarray, seed: int = 0) -> np.ndarray:
    """Bouc-Wen in front of a lightly damped mode, with an offset and noise [m]."""
    h = x0 = x1 = 0.0
    y = np.empty_like(u)
    previous = 0.0
    pole = 0.97 * np.exp(2j * np.pi * 68 * DT)
    a1, a2 = 2 * pole.real, -(abs(pole) ** 2)
    for k, value in enumerate(u):
        du = value - previous
        h += 60e-6 * du - 2.5 * abs(du) * h - 1.0 * abs(h) * du
        y[k] = x0
        x0, x1 = a1 * x0 + a2 * x1 + (1 - a1 - a2) * (180e-6 * value - h), x0
        previous = value
    return y + 6e-6 + np.random.default_rng(seed).normal(0, 20e-9, u.size)


def sine(frequency: float, seconds: float) -> np.ndarray:
    return np.asarray(np.sin(2 * np.pi * frequency * DT * np.arange(round(seconds / DT))))


def by_the_book(u: np.ndarray, y: np.ndarray, s: RlsSettings) -> np.ndarray:
    """Fujii 2018 (8)-(12), Tatebatake 2017 (8)-(11), literally; y in the working unit."""
    n = 7 + s.offset + (4 if s.harmonic else 0)
    theta, p = np.zeros(n), np.eye(n)
    theta[[2, 3, 5, 6]] = 0.01, 0.005, 0.001, 0.001
    past, past3 = [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]
    h = before = 0.0
    sums = np.zeros(4)
    for k in range(u.size):
        du = u[k] - before
        sums += du, abs(du), abs(du) * h, abs(h) * du
        lags = {
            'V0': past[:2],
            'V1': [past[1] - past3[1], past[2] - past3[2]],
            'V2': [past[1], past[0]],
            'basic': [0.0, 0.0],
        }[s.variant]
        sign = 1 if s.variant == 'V2' else -1
        x = [*lags, u[k], sign * sums[0], sign * sums[1], sums[2], sums[3]]
        x += [1.0] if s.offset else []
        angle = 2 * np.pi * s.harmonic * s.frequency * k * s.dt
        x += [past3[1], past3[2], np.sin(angle), np.cos(angle)] if s.harmonic else []
        column = np.array(x)
        if s.variant == 'basic':
            column[4] = 0.0
        target = y[k] - (0 if s.variant in ('V0', 'basic') else past[0])
        gain = p @ column / (s.forgetting + column @ p @ column)
        theta = theta + gain * (target - theta @ column)
        p = (p - np.outer(gain, column @ p)) / s.forgetting
        a0 = -theta[4] if s.variant == 'V2' else theta[4]
        h += theta[3] * du + a0 * abs(du) - theta[6] * abs(h) * du - theta[5] * abs(du) * h
        if s.harmonic:
            past3 = [past3[0] + theta[-4:] @ column[-4:], *past3[:2]]
        past = [y[k], *past[:2]]
        before = u[k]
    return theta


@pytest.mark.parametrize(
    'settings',
    [
        RlsSettings(),
        RlsSettings(variant='V0'),
        RlsSettings(variant='V2'),
        RlsSettings(variant='basic'),
        RlsSettings(offset=True, forgetting=0.9999),
        RlsSettings(harmonic=3, frequency=23.0),
        RlsSettings(variant='V0', harmonic=5, frequency=14.0, offset=True),
    ],
)
def test_equals_the_equations_of_the_papers(settings: RlsSettings) -> None:
    u = sine(23.0, 2.0)
    y = plant(u)
    rls = OnlineRls(settings)
    rls.update_many(u, y)
    values = rls.estimate().parameters()
    theta = by_the_book(u, y * 1e3, settings)
    lags = ('a1', 'a2') if settings.variant == 'V0' else ('c1', 'c2')
    got = [values.get(lags[0], 0.0), values.get(lags[1], 0.0), values['A1'] * 1e3]
    got += [values['A'] * 1e3, values['beta'], values['gamma']]
    np.testing.assert_allclose(got, theta[[0, 1, 2, 3, 5, 6]], rtol=2e-5)
    sign = -1 if settings.variant == 'V2' else 1
    np.testing.assert_allclose(values.get('A0', 0.0) * 1e3, sign * theta[4], rtol=2e-5)
    assert ('A0' in values) == (settings.variant != 'basic')


def test_one_by_one_gives_the_same_bits_as_many() -> None:
    u = sine(23.0, 1.0)
    y = plant(u)
    settings = RlsSettings(harmonic=3, frequency=23.0, offset=True, forgetting=0.9995)
    many, single = OnlineRls(settings), OnlineRls(settings)
    errors = many.update_many(u, y)
    singles = [single.update(a, b) for a, b in zip(u.tolist(), y.tolist(), strict=True)]
    np.testing.assert_array_equal(errors, singles)
    np.testing.assert_array_equal(many.estimate().values, single.estimate().values)


def test_only_the_difference_of_a1_and_a_is_seen() -> None:
    """In the papers' regressor S(du) = u, so A1 + A stays at its start, .015 mm/V."""
    u = sine(10.0, 5.0)
    rls = OnlineRls()
    rls.update_many(u, plant(u))
    estimate = rls.estimate()
    values = estimate.parameters()
    assert values['A1'] + values['A'] == pytest.approx(15e-6, rel=1e-6)
    assert any('A1 - A' in note for note in estimate.notes)
    assert estimate.condition_number > 1e3


def test_small_one_step_errors_but_a_poor_free_run() -> None:
    """What the papers do not say: one step ahead is easy, simulation is not."""
    u = sine(23.0, 20.0)
    y = plant(u)
    rls = OnlineRls()
    one_step = np.std(rls.update_many(u, y)[-1000:])
    free = np.std((rls.free_run(u) - y)[-1000:])
    assert free > 3 * one_step


def test_the_harmonic_columns_remove_the_odd_harmonic() -> None:
    u = sine(23.0, 20.0)
    y = plant(u)
    errors = []
    for harmonic in (0, 3):
        rls = OnlineRls(RlsSettings(harmonic=harmonic, frequency=23.0))
        rls.update_many(u, y)
        errors.append(np.std((rls.free_run(u) - y)[-1000:]))
    assert errors[1] < errors[0] / 4


@pytest.mark.parametrize('forgetting', [0.98, 0.999])
@pytest.mark.parametrize('offset', [False, True])
def test_stays_finite_with_the_actuator_parked(forgetting: float, offset: bool) -> None:
    u = np.concatenate([sine(10.0, 2.0), np.zeros(60_000), sine(10.0, 2.0)])
    rls = OnlineRls(RlsSettings(forgetting=forgetting, offset=offset))
    errors = rls.update_many(u, plant(u))
    assert np.all(np.isfinite(errors))
    assert np.max(np.abs(errors[-500:])) < 5e-6


def test_a_lost_sample_is_skipped() -> None:
    u = sine(10.0, 1.0)
    y = plant(u)
    rls = OnlineRls()
    rls.update_many(u, y)
    before = rls.estimate().values
    assert np.isnan(rls.update(0.1, float('nan')))
    np.testing.assert_array_equal(rls.estimate().values, before)


def test_forgetting_changes_while_running_and_is_checked() -> None:
    rls = OnlineRls()
    u = sine(10.0, 1.0)
    rls.update_many(u, plant(u))
    rls.forgetting = 0.99
    assert rls.settings.forgetting == 0.99
    with pytest.raises(IdentificationError, match='forgetting'):
        rls.forgetting = 1.2
    assert rls.forgetting == 0.99


def test_reset_starts_anew() -> None:
    u = sine(10.0, 1.0)
    y = plant(u)
    rls = OnlineRls()
    first = rls.update_many(u, y)
    rls.reset()
    np.testing.assert_array_equal(rls.update_many(u, y), first)


@pytest.mark.parametrize(
    ('make', 'word'),
    [
        (lambda: RlsSettings(variant='V3'), 'V0, V1, V2'),
        (lambda: RlsSettings(harmonic=3), 'frequency'),
        (lambda: RlsSettings(harmonic=4, frequency=1.0), '0, 3 or 5'),
        (lambda: RlsSettings(variant='V2', harmonic=3, frequency=1.0), 'V0 or V1'),
        (lambda: RlsSettings(unit='inch'), 'mm'),
        (lambda: RlsSettings(dt=0.0), 'dt'),
    ],
)
def test_wrong_settings_are_named(make: Callable[[], object], word: str) -> None:
    with pytest.raises(IdentificationError, match=word):
        make()
