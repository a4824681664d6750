"""Detection limits: sizes that show, sizes that hide, and what they are called."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from piezo_hysteresis.blocks import named_block
from piezo_hysteresis.cli.main import main
from piezo_hysteresis.discovery import Discovery, discover
from piezo_hysteresis.discovery.detection.limits import (
    BetterExperiment,
    DetectionCalculator,
    DetectionLimit,
    NuisanceDirections,
    Signature,
    Whitening,
    scaled,
)
from piezo_hysteresis.discovery.detection.statements import (
    in_prefixes,
    recommendations,
    sentence,
    statements,
)
from piezo_hysteresis.experiments.planned_experiment import ExperimentLimits, catalogue
from piezo_hysteresis.identification import identify
from piezo_hysteresis.identification.fit_data import FitData, whole
from piezo_hysteresis.identification.free_run import simulated
from piezo_hysteresis.models import Model, candidates, named
from piezo_hysteresis.records import Record, RecordInfo, write_csv
from piezo_hysteresis.reporting.validation_report import detection_section, limits_line

DT = 1e-3
SLOW = {'creep_time': 30.0}


def records(model: Model, values: dict[str, float], seed: int = 0) -> list[Record]:
    """Return noisy sines of a model."""
    found = []
    for k, frequency in enumerate((1.0, 4.0, 15.0)):
        u = np.sin(2 * np.pi * frequency * DT * np.arange(4000))
        y = model.respond(u, model.pack(values), DT)
        y = y + np.random.default_rng(10 * seed + k).normal(0, 2e-8, u.size)
        found.append(Record(f'{frequency:g} Hz', DT, u, y, info=RecordInfo(frequency=frequency)))
    return found


@pytest.fixture(scope='module')
def nothing() -> Discovery:
    model = named('classical')
    return discover(records(model, model.defaults()), 'classical')


def limit_of(found: Discovery, variant: str) -> DetectionLimit:
    return next(each for each in found.verdict.detection_limits if each.variant == variant)


@pytest.mark.component
def test_nothing_missing_is_a_statement_about_every_effect(nothing: Discovery) -> None:
    verdict = nothing.verdict
    assert verdict.verdict == 'none'
    names = {each.effect for each in verdict.detection_limits}
    assert {'creep', 'transport_delay', 'resonance', 'drift'} <= names
    assert 'known effects: from' in verdict.unexplained.description
    assert verdict.to_dict()['detection_limits'][0]['units']
    creep = limit_of(nothing, 'creep')
    assert 0.0 < creep.size['creep_share'] < 0.05
    assert 1e-9 < creep.displacement_rms_m < 1e-7


@pytest.mark.component
@pytest.mark.parametrize('variant', ['creep', 'amplifier_lag', 'drift'])
def test_twice_the_limit_is_seen_and_a_quarter_is_not(nothing: Discovery, variant: str) -> None:
    limit, final = limit_of(nothing, variant), nothing.final
    candidate = next(
        each
        for each in candidates(final.model, nothing.data.amplitude, nothing.data.span)
        if each.effect.variant == variant
    )
    verdicts = []
    for multiple in (0.25, 2.0):
        values = candidate.values(final.values, limit.size | limit.shape)
        hidden = scaled(candidate, values, multiple)
        verdicts.append(
            discover(records(candidate.model, hidden, seed=3), 'classical').verdict.verdict
        )
    assert verdicts[0] == 'none'
    assert verdicts[1] != 'none'


@pytest.mark.component
def test_a_delay_below_a_sample_passes_for_the_clock(nothing: Discovery) -> None:
    assert limit_of(nothing, 'transport_delay').size['delay'] > 0.9 * DT


@pytest.mark.component
def test_the_recommended_experiment_has_the_predicted_limit(nothing: Discovery) -> None:
    slow = next(each for each in nothing.verdict.detection_limits if each.shape == SLOW)
    assert slow.better is not None
    assert slow.better.name.startswith('step to')
    predicted = slow.better.size['creep_share']
    assert predicted < 0.1 * slow.size['creep_share']
    data = nothing.data
    low, high = (float(function(data.records[0].voltage)) for function in (np.min, np.max))
    limits = ExperimentLimits(low, high, slew=2.0 * np.pi * 15.0)
    step = next(
        each for each in catalogue(limits, 1.0 / DT) if each.name.endswith('held for 30 s')
    )
    voltage = step.voltage(1.0 / DT)
    final = nothing.final
    answer = final.model.respond(voltage, final.model.pack(final.values), DT)
    measured = answer + np.random.default_rng(5).normal(0, 2e-8, answer.size)
    record = Record('step', DT, voltage, measured, info=step.info)
    again = discover([*data.records, record], 'classical').verdict
    assert again.verdict == 'none'
    reached = next(each for each in again.detection_limits if each.shape == SLOW)
    assert 0.5 * predicted < reached.size['creep_share'] < 2.0 * predicted


def limit(**changes: Any) -> DetectionLimit:
    whole = DetectionLimit(
        effect='creep',
        variant='creep',
        size={'creep_share': 0.004},
        neutral={'creep_share': 0.0},
        shape={'creep_time': 3.0},
        units={'creep_share': '1', 'creep_time': 's'},
        displacement_rms_m=2e-8,
        shown=True,
        apart_factor=1.0,
        nearest='drift',
        experiment='step and hold',
    )
    return replace(whole, **changes)


def test_a_statement_gives_the_range_of_sizes_once_for_both_signs() -> None:
    found = statements(
        [
            limit(),
            limit(size={'creep_share': -0.0041}),
            limit(size={'creep_share': 0.05}, shape={'creep_time': 30.0}, displacement_rms_m=3e-8),
        ]
    )
    assert [each.brief for each in found] == ['0.4 % to 5 %']
    assert found[0].sizes.count('creep_time') == 2
    assert found[0].displacement_m == (2e-8, 3e-8)


def test_a_better_experiment_is_stated_with_its_limit() -> None:
    better = BetterExperiment('step to 1 V held for 30 s', 31.0, {'creep_share': 5e-4})
    (found,) = statements([limit(better=better)])
    assert found.better == 'step to 1 V held for 30 s: creep_share 0.05 % (creep_time 3 s)'
    assert recommendations([limit(), limit(better=better)]) == (
        'To show smaller effects: step to 1 V held for 30 s (creep from 0.4 % to 0.05 %).',
    )
    assert recommendations([limit()]) == ()


def test_what_shows_at_no_size_is_stated() -> None:
    (found,) = statements([limit(shown=False)])
    assert (found.brief, found.hidden) == ('no size', 'creep_time 3 s')
    assert 'would not show creep at any size' in sentence(
        [found, *statements([limit(effect='drift', variant='drift')])]
    )


def test_a_look_alike_is_named_with_the_size_that_distinguishes_it() -> None:
    (found,) = statements([limit(apart_factor=12.0)])
    assert found.apart == 'drift below 12 times that'
    section = detection_section([limit(apart_factor=12.0)])
    assert section is not None
    assert limits_line([limit()]) == 'creep 0.4 %'


@pytest.mark.parametrize(
    ('value', 'unit', 'text'),
    [
        (1.9e-4, 's', '190 µs'),
        (1.74e-8, 'm/s', '17.4 nm/s'),
        (0.97, 'V', '970 mV'),
        (52000.0, '1/m^2', '5.2e+04 1/m^2'),
        (0.02, '1', '0.02'),
    ],
)
def test_numbers_have_a_prefix_of_their_unit(value: float, unit: str, text: str) -> None:
    assert in_prefixes(value, unit) == text


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**31), st.integers(200, 900))
def test_whitened_noise_has_unit_variance_and_comes_back(seed: int, size: int) -> None:
    generator = np.random.default_rng(seed)
    error = 3e-8 * generator.standard_normal(size)
    whitening = Whitening([error], [1e-9], [1.0])
    assert np.std(whitening([error])) == pytest.approx(1.0, rel=0.15)
    change = generator.standard_normal(size)
    np.testing.assert_allclose(whitening.inverse(whitening([change]))[0], change, atol=1e-9)


def test_nuisances_take_what_is_theirs_and_the_clock_within_its_bounds() -> None:
    t = np.linspace(0.0, 1.0, 500)
    free, clock = np.sin(40 * t), np.cos(40 * t)
    nuisances = NuisanceDirections([free], clock, (-2.0, 2.0))
    assert np.max(np.abs(nuisances.remove(3.0 * free + 1.5 * clock))) < 1e-9
    left = nuisances.remove(5.0 * clock)
    assert np.linalg.norm(left) == pytest.approx(3.0 * np.linalg.norm(clock), rel=0.01)


def test_a_parameter_with_a_prior_takes_what_a_ridge_takes() -> None:
    generator = np.random.default_rng(3)
    rows, change = generator.standard_normal((2, 300)), generator.standard_normal(300)
    nuisances = NuisanceDirections((), np.zeros(300), (0.0, 0.0), list(rows))
    left = nuisances.remove(change)
    moved = np.linalg.solve(rows @ rows.T + np.eye(2), rows @ change)
    np.testing.assert_allclose(left[:300], change - moved @ rows, atol=1e-9)
    np.testing.assert_allclose(left[300:], -moved, atol=1e-9)


@pytest.mark.component
def test_effects_that_records_cannot_distinguish_come_with_their_models(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    model = named('classical').with_block(named_block('drift'))
    u = np.sin(2 * np.pi * 2.0 * DT * np.arange(3000))
    y = model.respond(u, model.pack({**model.defaults(), 'drift_rate': 1e-6}), DT)
    y = y + np.random.default_rng(5).normal(0, 1e-7, u.size)
    monkeypatch.setattr('piezo_hysteresis.discovery.detection.limits.APART', 1e9)
    found = discover([Record('r', DT, u, y, info=RecordInfo(frequency=2.0))], 'classical')
    (effect,) = found.verdict.effects
    alike = [each.name for each in effect.look_alikes]
    assert 'creep' in alike
    assert not {'transport_delay', 'sensor_nonlinearity'} & set(alike)  # nothing of a drift
    assert [each.effect for each in found.alike['drift']] == alike
    advice = ' '.join(found.verdict.next_experiments)
    assert all(name in advice for name in alike)


def test_sizes_are_scaled_from_where_an_effect_changes_nothing() -> None:
    model = named('classical')
    every = {each.effect.variant: each for each in candidates(model, 1.0, 1e-5)}
    creep = every['creep']
    values = creep.values(model.defaults(), creep.starts[0])
    assert scaled(creep, values, 0.5)['creep_share'] == 0.5 * values['creep_share']
    slow = every['slew_limit']
    start = slow.values(model.defaults(), slow.starts[0])
    assert scaled(slow, start, 0.5)['slew_rate'] == 2.0 * start['slew_rate']
    record = records(model, model.defaults())[0]
    neutral = scaled(creep, values, 0.0)
    np.testing.assert_allclose(
        simulated(creep.model, creep.model.pack(neutral), whole(record)),
        simulated(model, model.pack(model.defaults()), whole(record)),
        atol=1e-15,
    )


@pytest.mark.component
def test_validate_states_the_limits_of_new_records(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model = named('classical')
    saved, data = tmp_path / 'model.yaml', tmp_path / 'new.csv'
    identify(records(model, model.defaults()), 'classical').save(saved)
    write_csv(data, records(model, model.defaults(), 1)[1])
    words = ['validate', str(data), '--model', str(saved), '--out', str(tmp_path / 'out')]
    assert main([*words, '--detection-limits']) == 0
    assert 'detection limits: ' in capsys.readouterr().out
    summary = json.loads((tmp_path / 'out' / 'summary.json').read_text())
    limits = {each['variant']: each for each in summary['detection_limits']}
    # one record of 4 s at 4 Hz, noise 20 nm
    assert 1e-9 < limits['drift']['displacement_rms_m'] < 1e-6
    assert 'Detection limits' in (tmp_path / 'out' / 'report.html').read_text()


def test_no_limit_is_below_what_a_free_run_in_double_precision_resolves() -> None:
    searched = object.__new__(DetectionCalculator)
    voltage = np.linspace(0.0, 100.0, 50)
    view = FitData('r', voltage, 1e-7 * voltage, 0, 1, DT, 0.0, 1, 1e-20, 0)
    searched._views = (view,)
    searched._whitening = Whitening([np.ones(50)], [1.0], [1.0])
    searched._detection_test = lambda changes: lambda factor: True
    base = named('classical')
    candidate = next(c for c in candidates(base) if c.effect.name == 'drift')
    left = 1e30 * np.sin(voltage)
    found = Signature(candidate, {}, {}, 1.0, 1e-12, left, False)
    assert searched.detectable_factor(found) * found.rms >= 0.99e-10 * 1e-5
