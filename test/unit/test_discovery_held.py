"""A baseline with a known discrepancy: unchanged records give none, a hidden effect is named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from frozen_rounds import plays
from scipy.signal import lfilter

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks import named_block
from piezo_hysteresis.discovery import discover
from piezo_hysteresis.discovery.data.dataset import split
from piezo_hysteresis.discovery.data.tones import annotated
from piezo_hysteresis.discovery.selection.candidate_fit import (
    Added,
    CandidateFit,
    ModelSpec,
    evaluated_on,
    has_zero_time_constant,
)
from piezo_hysteresis.discovery.selection.evaluator import Deadline
from piezo_hysteresis.discovery.selection.fixed_baseline_evaluator import (
    FixedBaselineEvaluator,
    cost_of_change,
)
from piezo_hysteresis.discovery.selection.policy import HELD
from piezo_hysteresis.discovery.selection.residual_model import Expectation, expectation
from piezo_hysteresis.discovery.selection.start import SearchOptions, as_on, held_data
from piezo_hysteresis.identification import identify
from piezo_hysteresis.identification.fit_data import whole
from piezo_hysteresis.identification.initial_conditions.revision import RecordAssumptions
from piezo_hysteresis.models import PARAMETER_SHIFT, Condition, Discrepancy, ModelFile, named
from piezo_hysteresis.models.repeating import KnownResidual
from piezo_hysteresis.records import Record, RecordInfo

DT, STROKE = 2e-3, 4e-5


def actuator(frequency: float, amplitude: float, seed: int) -> Record:
    """Return a measured sine of the actuator, from rest."""
    t = DT * np.arange(4000)
    u = amplitude * np.sin(2 * np.pi * frequency * t)
    noise = 2e-8 * np.random.default_rng(seed).standard_normal(t.size)
    info = RecordInfo(excitation='sine', frequency=frequency, amplitude=amplitude, warm_up=0.5)
    return Record(f'{frequency:g}Hz_{amplitude:g}V', DT, u, plays(u) + noise, info=info)


def hidden(record: Record, kind: str) -> Record:
    y = record.displacement
    t = DT * np.arange(y.size)
    if kind == 'lag':
        a = np.exp(-DT / 8e-3)
        y = lfilter([1.0 - a], [1.0, -a], y)
    if 'delay' in kind:
        ticks = 1 if 'one tick' in kind else 2
        y = np.concatenate([np.full(ticks, y[0]), y[:-ticks]])
    if kind == 'tone':
        y = y + 6e-7 * np.sin(2 * np.pi * 37.3 * t)
    if kind == 'drift':
        y = y + 4e-7 * t
    return replace(record, displacement=np.ascontiguousarray(y))


FITTED = [actuator(f, a, k) for k, (f, a) in enumerate(((1, 1.0), (5, 1.0), (1, 0.5)))]


@pytest.fixture(scope='module')
def known() -> ModelFile:
    return identify(FITTED, named('classical')).model


@pytest.mark.component
@pytest.mark.parametrize(
    ('kind', 'name'),
    [
        ('', None),
        pytest.param('delay', 'transport_delay', marks=pytest.mark.slow),
        ('delay of one tick', 'transport_delay'),
        pytest.param('lag', 'amplifier_lag', marks=pytest.mark.slow),
        pytest.param('tone', 'mains_hum', marks=pytest.mark.slow),
        pytest.param('drift', 'drift', marks=pytest.mark.slow),
    ],
)
def test_a_known_discrepancy_is_no_effect_and_a_hidden_effect_is_named(
    known: ModelFile, kind: str, name: str | None
) -> None:
    records = [
        hidden(actuator(f, a, 10 + k), kind) for k, (f, a) in enumerate(((1, 1.0), (5, 1.0)))
    ]
    found = discover(records, known)
    verdict = found.verdict
    assert known.discrepancy is not None
    assert known.discrepancy.missed > 4 * verdict.noise_floor_rms_m
    assert [each.name for each in verdict.effects] == ([name] if name else [])
    assert verdict.verdict == ('named' if name else 'none')
    assert verdict.held_out.gap_after_rms_m <= 1.02 * verdict.held_out.gap_before_rms_m
    assert 'µm rms beyond the noise' in verdict.unexplained.description


def test_the_records_of_a_model_show_no_new_deviation(known: ModelFile) -> None:
    again = ModelFile.parse(known.text())  # as it comes from a file
    own = [replace(r, name=f'copy {k}') for k, r in enumerate(FITTED)]
    verdict = discover(own[:2], again).verdict
    assert (verdict.verdict, verdict.effects) == ('none', ())
    assert 'identified from' in verdict.summary
    assert '--baseline classical' in verdict.next_experiments[0]
    assert verdict.identified_from == ('copy 0', 'copy 1')
    assert verdict.held_out.before_in_floors == verdict.held_out.after_in_floors > 4.0


@pytest.mark.component
def test_new_records_are_evaluated_without_those_of_the_model(known: ModelFile) -> None:
    new = hidden(replace(actuator(5, 1.0, 11), name='new'), 'tone')
    found = discover([*FITTED, new], known)
    assert [each.name for each in found.verdict.effects] == ['mains_hum']
    assert [each.name for each in found.data.records] == ['new']
    assert 'Excluded records: 3' in found.verdict.summary
    # what came out of it was made from all of them
    made_from = [each.name for each in found.model.provenance.records]
    assert made_from == [*(r.name for r in FITTED), 'new']


@pytest.mark.slow
@pytest.mark.parametrize(('factor', 'moved'), [(1.0, 0.8), (1.05, 1.3)])
def test_a_moved_mode_is_no_second_one(factor: float, moved: float) -> None:
    model = named('bouc_wen_mode')
    values = {**model.defaults(), 'natural_frequency': 60.0, 'damping_ratio': 0.012}
    t = DT * np.arange(3000)
    phases = np.random.default_rng(1).uniform(0.0, 6.3, 45)
    drive = sum(0.05 * np.sin(2 * np.pi * (k + 1) * 2.0 * t + phase)
                for k, phase in enumerate(phases))  # fmt: skip

    def week(values: dict[str, float], factor: float, seed: int) -> list[Record]:
        noise = np.random.default_rng(seed)
        return [
            Record(name, DT, u, factor * y + 1e-4 * np.std(y) * noise.standard_normal(u.size))
            for name, u in (('slow', np.sin(2 * np.pi * t)), ('multisine', drive))
            for y in (model.respond(u, model.pack(values), DT),)
        ]

    first = identify(week(values, 1.0, 2), 'bouc_wen_mode').model_file()
    other = {**values, 'natural_frequency': 60.0 * moved}
    found = discover(week(other, factor, 3), first, time_limit=120.0).verdict
    assert [each.name for each in found.effects] == ['parameter_shift']
    changes = ', '.join(found.effects[0].changes)
    assert f'natural_frequency 60 Hz to {60.0 * moved:.3g} Hz ± ' in changes
    assert ('gain +5' in changes) == (factor != 1.0)


@pytest.mark.slow
@pytest.mark.parametrize('factor', [1.1, 0.8])
def test_another_gain_is_other_numbers_and_no_effect(known: ModelFile, factor: float) -> None:
    records = [actuator(f, 1.0, 50 + f) for f in (1, 5)]
    found = discover([replace(r, displacement=factor * r.displacement) for r in records], known)
    (shift,) = found.verdict.effects
    assert shift.name == 'parameter_shift'
    assert shift.changes[-1].startswith(f'gain {100 * (factor - 1):+.2g} ± ')
    assert 'loop width' not in ' '.join(shift.changes)
    assert 'A1' not in ' '.join(shift.changes)  # it only follows the gain
    assert f'no longer fits ({", ".join(shift.changes)})' in found.verdict.summary
    assert shift.parameters['A1'].value == pytest.approx(factor * known.values['A1'], rel=0.03)
    saved = ModelFile.parse(found.model.text())
    assert saved.values['A1'] == shift.parameters['A1'].value
    assert saved.deviations['A1'] == shift.parameters['A1'].std
    assert saved.correlation is not None
    assert 'A1' in saved.correlation.names


def test_a_change_of_a_value_costs_by_its_deviation_in_the_file(known: ModelFile) -> None:
    known = replace(known, correlation=None)
    data = split(annotated([actuator(f, 1.0, 60 + f) for f in (1, 5)]))
    base, seen = held_data(data, known, SearchOptions(RecordAssumptions(), 1, 1, {}, Deadline()))
    assert known.discrepancy is not None
    held = FixedBaselineEvaluator(seen, 1, 1, base, known)
    (change,) = (c for c in held.candidates(base) if c.effect is PARAMETER_SHIFT)
    # each record has a zero of its own: -1 m of offset was once reported as a changed parameter
    assert base.model.zero_names == {'offset'}
    assert 'offset' not in change.renamed

    def moved(by: float) -> float:
        std = known.deviations['A1']
        values = {**base.values, 'A1': base.values['A1'] + by * std}
        fit = evaluated_on(base.with_candidate(change, values), seen.training)
        alone = evaluated_on(
            ModelSpec(base.model, values, (), base.sampling_offset), seen.training
        )
        return held.score(fit) - held.score(alone)

    assert moved(0.0) == pytest.approx(0.0)
    assert moved(1.0) == pytest.approx(0.5)
    assert moved(100.0) == pytest.approx(HELD.price)


def test_values_that_make_up_for_each_other_cost_together() -> None:
    names, price = ('one', 'two'), 2.0
    covariance = np.array([[1.0, -0.999], [-0.999, 1.0]])

    def cost(one: float, two: float, other: float = 0.0) -> float:
        changes = {'one': one, 'two': two, 'held': other}
        return cost_of_change(changes, names, covariance, price)

    assert cost(0.0, 0.0) == 0.0
    # along what the file leaves open, and along what it tells well: their sum
    assert cost(1.0, -1.0) == pytest.approx(0.5, rel=0.01)
    assert cost(0.5, 0.5) == pytest.approx(price)
    assert cost(0.01, 0.01) == pytest.approx(0.1, rel=0.01)
    # one is another, and the other is where it was
    assert cost(50.0, 0.0) == pytest.approx(price)
    assert cost(50.0, 20.0) == pytest.approx(2.0 * price)
    assert cost(0.0, 0.0, 1e-9) == pytest.approx(price)
    assert cost_of_change({'one': 1.0}, ('one',), np.eye(1), price) == pytest.approx(0.5)
    assert cost_of_change({'one': 1.0}, (), np.empty((0, 0)), price) == price


def test_what_takes_no_time_is_a_gain() -> None:
    model = named('classical').with_block(named_block('creep'))
    names = {'creep_share': 'creep_share', 'creep_time': 'creep_time'}
    added = (Added('creep', 'creep', names),)

    def fit(seconds: float) -> CandidateFit:
        return CandidateFit(model, {**model.defaults(), 'creep_time': seconds}, added)

    assert has_zero_time_constant(fit(1e-4), DT)
    assert has_zero_time_constant(fit(DT), DT)
    assert not has_zero_time_constant(fit(10 * DT), DT)
    # the time constant of a baseline whose parameters moved is none of an added effect
    moved = (Added(PARAMETER_SHIFT.name, PARAMETER_SHIFT.variant, names),)
    assert not has_zero_time_constant(replace(fit(DT), added=moved), DT)


def test_what_a_model_always_missed_is_no_evidence() -> None:
    view = replace(whole(actuator(1, 1.0, 0)), noise=1e-8)
    missed = Discrepancy(False, (Condition(1.0, 1.0, STROKE, 4e-7, 1e-8, {2: 4e-7}),))
    known = expectation(view, missed, STROKE)
    assert known.cost(0.1 * known.expected) == known.cost(known.expected)
    assert known.cost(2.0 * known.expected) > known.cost(known.expected)


@pytest.mark.component
def test_the_model_of_a_discovery_has_its_remaining_discrepancy(known: ModelFile) -> None:
    found = discover([hidden(actuator(5, 1.0, 3), 'drift')], known)
    saved = ModelFile.parse(found.model.text())
    assert saved.discrepancy is not None
    assert saved.discrepancy.rms == pytest.approx(found.final.rms, rel=0.05)
    assert saved.deviations['beta'] == pytest.approx(known.deviations['beta'])
    assert saved.correlation is not None
    assert 'beta' in saved.correlation.names


@pytest.mark.slow
def test_a_reference_defines_the_known_discrepancy(known: ModelFile) -> None:
    before = [actuator(f, 1.0, 20 + k) for k, f in enumerate((1, 5))]
    silent = as_on(before, replace(known, discrepancy=None))
    assert silent.discrepancy is not None
    assert silent.discrepancy.held_out
    fitted = as_on(before, named('classical'))
    for baseline in (silent, fitted):
        same = discover([actuator(1, 1.0, 30), actuator(5, 1.0, 31)], baseline).verdict
        assert (same.verdict, same.effects) == ('none', ())
        changed = [hidden(actuator(f, 1.0, 40 + k), 'lag') for k, f in enumerate((1, 5))]
        verdict = discover(changed, baseline).verdict
        assert [each.name for each in verdict.effects] == ['amplifier_lag']


def test_the_same_drive_again_is_compared_sample_by_sample() -> None:
    view = replace(whole(actuator(1, 1.0, 0)), noise=1e-8)
    missed = Discrepancy(False, (Condition(1.0, 1.0, STROKE, 4e-7, 1e-8, {2: 4e-7}),))
    voltage, t = view.pick(view.voltage), DT * np.arange(view.measured.size)
    left = 4e-7 * np.sin(2 * np.pi * (2.0 + 0.3 * t) * t)  # no harmonic of any drive
    wander = 2e-7 * np.sin(2 * np.pi * 0.7 * t)
    drift = 8e-7 * (t / t[-1] - 0.5)

    def seen(*traces: FloatArray) -> Expectation:
        again = tuple(KnownResidual(voltage, each, DT) for each in traces)
        return expectation(view, replace(missed, traces=again), STROKE)

    elsewhere, once, twice = seen(), seen(left), seen(left + wander, left - wander)
    assert np.array_equal(elsewhere.repeated, np.zeros(t.size))
    for each in (once, twice):
        assert each.repeated == pytest.approx(left)
    # what the reference does not repeat is no news, and what it does is none that is expected
    assert once.new_deviation(once.powers(wander))
    assert not twice.new_deviation(twice.powers(wander))
    assert once.new_deviation(once.powers(drift))
    assert once.total < elsewhere.total


def test_a_residual_is_compared_part_by_part() -> None:
    view = replace(whole(actuator(1, 1.0, 0)), noise=1e-8)
    missed = Discrepancy(False, (Condition(1.0, 1.0, STROKE, 4e-7, 1e-8, {2: 4e-7}),))
    expected = expectation(view, missed, STROKE)
    t = DT * np.arange(view.measured.size)
    second = 4e-7 * np.sqrt(2.0) * np.cos(4 * np.pi * t)
    noise = 1e-8 * np.random.default_rng(1).standard_normal(t.size)
    tone = 4e-7 * np.sin(2 * np.pi * 37.3 * t)
    assert not expected.new_deviation(expected.powers(second + noise))
    assert expected.powers(second)[2] == pytest.approx(1.6e-13, rel=0.01)
    # a tone adds a fifth to the rms, and is news where no harmonic is
    assert expected.new_deviation(expected.powers(second + noise + tone))
    assert expected.new_deviation(expected.powers(2.0 * second))
    gain = expected.cost(expected.powers(second + noise + tone)) - expected.cost(
        expected.powers(second + noise)
    )
    assert gain > 20.0
