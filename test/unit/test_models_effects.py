"""Effects: every name of the vocabulary, neutral ones change nothing, starts do."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from piezo_hysteresis import models
from piezo_hysteresis.blocks import EFFECTS
from piezo_hysteresis.blocks.effect import Residual
from piezo_hysteresis.errors import ModelError
from piezo_hysteresis.identification import output_error
from piezo_hysteresis.models.chain import Model
from piezo_hysteresis.records import Record, RecordInfo

DT = 1e-3
VOLTS, METRES = 150.0, 20e-6
# What users search for, and what verdicts of former versions say.
PROMISED = (
    *('asymmetry', 'hysteresis', 'hysteresis_exponent', 'nonlocal_memory', 'rate_dependence'),
    *('electrostriction', 'saturation', 'slew_limit', 'amplifier_lag', 'transport_delay'),
    *('resonance', 'odd_harmonic', 'stiffness', 'friction', 'creep', 'drift', 'gain_decay'),
    *('mains_hum', 'sensor_nonlinearity', 'offset'),
)
# the band-limited oscillator knows the force between samples, the baseline held it; a mode in the
# place of an autoregression keeps only its static gain
APPROXIMATE = {'restoring_force': 0.2, 'restoring_force_held_input': 1e-6, 'series_mode': 1.0}
BASELINES = [models.named(name) for name in models.NAMES]
PAIRS = [(model, effect) for model in BASELINES for effect in EFFECTS]
APPLICABLE = [
    pytest.param(model, effect, id=f'{model.name}-{effect.name}-{effect.variant}')
    for model, effect in PAIRS
    if models.applicable(model, effect)
]


def drive(n: int = 2000, frequency: float = 23.0) -> Any:
    t = np.arange(n) * DT
    return VOLTS * np.sin(2 * np.pi * frequency * t) * (0.3 + 0.7 * t / t[-1])


def answer(model: Any, values: Any, voltage: Any) -> Any:
    return model.respond(voltage, model.pack(values), DT, frequency=23.0)


def test_the_vocabulary_keeps_what_was_promised() -> None:
    assert set(PROMISED) <= set(models.EFFECT_NAMES)


@pytest.mark.parametrize('name', models.EFFECT_NAMES)
def test_every_effect_fits_some_baseline_and_explains_itself(name: Any) -> None:
    without_offset = models.named('classical').without_block('offset')
    tried = [*BASELINES, without_offset]
    for effect in models.described(name):
        if effect.variant != 'in_nonlinear_mode':
            assert any(models.applicable(model, effect) for model in tried), effect.variant
        assert effect.physics.endswith('.')
        assert effect.experiment.endswith('.')
        assert set(effect.mistaken_for) <= set(models.EFFECT_NAMES) - {name}


@pytest.mark.parametrize(('model', 'effect'), APPLICABLE)
def test_neutral_changes_nothing_and_starts_change_something(model: Any, effect: Any) -> None:
    model = models.for_range(model, VOLTS, METRES)
    before = model.defaults()
    voltage = drive()
    y = answer(model, before, voltage)
    candidate = models.add_effect(model, effect, VOLTS, METRES)
    neutral = answer(candidate.model, candidate.values(before), voltage)
    tolerance = APPROXIMATE.get(effect.variant, 1e-12)
    np.testing.assert_allclose(neutral, y, rtol=0, atol=tolerance * np.ptp(y))
    assert set(candidate.added) <= set(candidate.model.free_names)
    for start in candidate.starts:
        assert set(start) == set(candidate.added)
        values = candidate.values(before, start)
        if effect.name != 'odd_harmonic' and 'saturation' not in effect.name:
            changed = answer(candidate.model, values, voltage)
            assert np.isfinite(changed).all()
    first = answer(candidate.model, candidate.values(before, candidate.starts[0]), voltage)
    assert np.ptp(first - neutral) > 1e-5 * np.ptp(y)


@pytest.mark.parametrize(
    ('one', 'other'),
    list(
        itertools.permutations(
            ('nonlocal_memory', 'hysteresis_exponent', 'electrostriction', 'stiffness'), 2
        )
    ),
)
def test_two_effects_go_together_and_survive_a_file(one: Any, other: Any, tmp_path: Path) -> None:
    model = models.for_range(models.named('bouc_wen_mode'), VOLTS, METRES)
    values = model.defaults()
    y = answer(model, values, drive())
    for name in (one, other):
        candidate = models.add_effect(model, models.described(name)[0], VOLTS, METRES)
        values = candidate.values(values)
        model = candidate.model
    np.testing.assert_allclose(answer(model, values, drive()), y, atol=1e-12 * np.ptp(y), rtol=0)
    path = tmp_path / 'model.yaml'
    models.ModelFile(model, values).save(path)
    read = models.ModelFile.load(path)
    np.testing.assert_array_equal(
        answer(read.model, read.values, drive()), answer(model, values, drive())
    )


def test_a_second_mode_gets_its_own_names() -> None:
    resonance = models.described('resonance')[0]
    once = models.add_effect(models.named('classical'), resonance)
    twice = models.add_effect(once.model, resonance)
    assert twice.added == ('resonance_frequency_2', 'resonance_damping_2', 'resonance_share_2')
    values = twice.values(once.values(once.model.defaults(), once.starts[0]), twice.starts[0])
    assert values['resonance_share'] == once.starts[0]['resonance_share']
    assert values['resonance_share_2'] == twice.starts[0]['resonance_share_2']


def test_a_sensor_errs_before_its_offset_and_friction_acts_on_the_drive_of_the_mode() -> None:
    model = models.named('bouc_wen_mode')
    behind = {'sensor_nonlinearity': 'offset', 'amplifier_lag': 'offset', 'friction': 'mode'}
    for effect in EFFECTS:
        other = behind.get(effect.name)
        if other is None or effect.replaces or not models.applicable(model, effect):
            continue
        assert effect.block is not None
        chain = models.add_effect(model, effect).model.block_names
        assert chain.index(effect.block.name) < chain.index(other), effect.variant


def test_an_effect_is_not_added_twice_and_unknown_names_are_refused() -> None:
    (asymmetry,) = models.described('asymmetry')
    free = models.add_effect(models.named('classical'), asymmetry)
    with pytest.raises(ModelError, match='asymmetry'):
        models.add_effect(free.model, asymmetry)
    with pytest.raises(ModelError, match='choose one of'):
        models.described('ghosts')


@pytest.mark.parametrize('variant', ['nonlocal_memory', 'nonlocal_memory_fine'])
def test_ranges_are_scaled_once_however_often_a_model_is_suited(variant: str) -> None:
    effect = next(e for e in models.described('nonlocal_memory') if e.variant == variant)
    model = models.for_range(models.named('classical'), VOLTS, METRES)
    candidate = models.add_effect(model, effect, VOLTS, METRES)
    again = models.for_range(candidate.model, VOLTS, METRES)
    (name,) = effect.holds
    assert again.held[name] == candidate.model.held[name] == VOLTS
    assert again.defaults() == candidate.model.defaults()
    assert [q.scale for q in again.parameters] == [q.scale for q in candidate.model.parameters]


def test_fitting_keeps_the_range_that_an_effect_was_given() -> None:
    effect = models.described('nonlocal_memory')[0]
    candidate = models.add_effect(models.named('classical'), effect, VOLTS, METRES)
    wave = VOLTS * np.sin(2 * np.pi * 5 * DT * np.arange(2000))
    truth = candidate.values(candidate.model.defaults()) | {'memory3': 0.1 * METRES / VOLTS}
    truth |= {'A1': METRES / VOLTS, 'A': 0.3 * METRES / VOLTS, 'beta': 1 / VOLTS}
    y = np.roll(answer(candidate.model, truth, wave), 1)  # measured before the voltage acts
    y[0] = y[1]
    record = Record('wave', DT, wave, y, info=RecordInfo(excitation='sine', frequency=5.0))
    result = output_error(candidate.model, [record], sampling_offset=False, count=3)
    assert result.values['memory_range'] == VOLTS
    assert result.residuals['wave'].std() < 1e-3 * METRES


def test_a_mode_takes_the_place_of_an_autoregression_with_its_static_gain() -> None:
    effect = next(e for e in models.described('resonance') if e.variant == 'series_mode')
    model = models.named('extended')
    candidate = models.add_effect(model, effect)
    assert 'autoregressive' not in candidate.model.block_names
    before = model.defaults()
    slow = np.concatenate([np.linspace(0, 1, 20_000), np.ones(2000)])
    y = answer(model, before, slow)
    changed = answer(candidate.model, candidate.values(before), slow)
    np.testing.assert_allclose(changed[-1], y[-1], rtol=1e-3)
    guesses = candidate.guessed(Residual(slow, y, 0 * y, DT, 0.0, 0.0, before))
    assert guesses[0]['resonance_frequency'] == pytest.approx(68.0, abs=5.0)


def test_linear_model_becomes_an_oscillator_of_the_same_stiffness_and_frequency() -> None:
    effect = next(
        each
        for each in models.described('hysteresis')
        if each.variant == 'restoring_force_held_input'
    )
    model = models.named('linear_mode')
    before = {'A1': 2e-5, 'natural_frequency': 25.2, 'damping_ratio': 0.016, 'offset': 1e-6}
    candidate = models.add_effect(model, effect)
    values = candidate.values(before)
    assert values['stiffness'] == pytest.approx(5e4)
    assert np.sqrt(values['stiffness'] / values['mass']) == pytest.approx(2 * np.pi * 25.2)
    assert values['offset'] == 1e-6


def residual_of(
    truth: Model, baseline: Model, frequency: Any = 7.0, n: Any = 10_000, **extra: Any
) -> Residual:
    t = np.arange(n) * DT
    voltage = np.sin(2 * np.pi * frequency * t)
    state = [truth.initial_state(DT), baseline.initial_state(DT)]
    measured = truth.respond(voltage, truth.pack(extra), DT, state=state[0], frequency=frequency)
    simulated = baseline.respond(
        voltage, baseline.pack({}), DT, state=state[1], frequency=frequency
    )
    return Residual(voltage, simulated, measured - simulated, DT, frequency)


def test_hum_is_guessed_from_the_residual() -> None:
    baseline = models.named('classical')
    (hum,) = models.described('mains_hum')
    candidate = models.add_effect(baseline, hum)
    truth = {'hum_frequency': 50.3, 'hum_sine': 2e-7, 'hum_cosine': -1e-7}
    (guess,) = candidate.guessed(residual_of(candidate.model, baseline, **truth))
    assert guess['hum_frequency'] == pytest.approx(50.3, abs=0.01)
    assert np.hypot(guess['hum_sine'], guess['hum_cosine']) == pytest.approx(2.236e-7, rel=0.1)


def test_a_resonance_is_guessed_where_a_harmonic_rings() -> None:
    baseline = models.named('classical')
    resonance = models.described('resonance')[0]
    candidate = models.add_effect(baseline, resonance)
    truth = {'resonance_frequency': 68.0, 'resonance_damping': 0.015, 'resonance_share': 1.0}
    seen = residual_of(candidate.model, baseline, frequency=14.0, n=20_000, **truth)
    assert candidate.guessed(seen)[0]['resonance_frequency'] == pytest.approx(68.0, abs=6.0)


@pytest.mark.parametrize(
    ('name', 'parameter', 'largest'),
    [('saturation', 'saturation_high', 1.0), ('slew_limit', 'slew_rate', 2 * np.pi * 7)],
)
def test_limits_are_guessed_just_inside_the_drive(
    name: str, parameter: str, largest: float
) -> None:
    baseline = models.named('classical')
    candidate = models.add_effect(baseline, models.described(name)[0])
    seen = residual_of(baseline, baseline)
    # A limit outside the drive would show nothing, and a fit could not find its way from there.
    assert 0.75 * largest < candidate.guessed(seen)[0][parameter] < largest


def test_a_candidate_has_the_name_with_which_its_chain_is_identified() -> None:
    """An effect of several blocks gave the chain of two elements the name of that of one."""
    added = [
        each
        for each in models.candidates(models.named('bouc_wen_mode'))
        if each.effect.name == 'creep'
    ]
    names = {each.model.name for each in added}
    assert {'bouc_wen_mode+creep', 'bouc_wen_mode+creep_pair'} <= names
    for each in added:
        assert models.named(each.model.name).block_names == each.model.block_names
