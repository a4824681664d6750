"""What is screened: starts for every way an effect can show, and chirps up to their end."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks import named_block
from piezo_hysteresis.discovery.data.dataset import part_of, split, thinned
from piezo_hysteresis.discovery.selection.candidate_fit import ModelSpec, evaluated_on
from piezo_hysteresis.discovery.selection.screen import Screen, ScreeningScore
from piezo_hysteresis.identification.fit_data import whole
from piezo_hysteresis.identification.free_run import StageCache, simulated
from piezo_hysteresis.models import Model, add_effect, described, named
from piezo_hysteresis.records import Record, RecordInfo
from piezo_sim.sweep import simulate

DT = 1e-3
MODE = {'natural_frequency': 83.0, 'damping_ratio': 0.016}


def answer(model: Model, values: dict[str, float], u: FloatArray) -> FloatArray:
    return model.respond(u, model.pack(values), DT, state=model.initial_state(DT))


def required_score_share(
    name: str, variant: str, hidden: dict[str, float], offset: float = 0.0
) -> ScreeningScore:
    """Screen one effect on drives of an actuator that has it."""
    base = named('bouc_wen_mode')
    own = base.defaults() | MODE | {'offset': offset}
    effect = next(e for e in described(name) if e.variant == variant)
    candidate = add_effect(base, effect)
    truth = candidate.values(own, dict(candidate.neutral) | hidden)
    views = []
    for frequency in (3.0, 11.0, 31.0):
        u = np.sin(2 * np.pi * frequency * DT * np.arange(2000))
        info = RecordInfo(excitation='sine', frequency=frequency)
        y = answer(candidate.model, truth, u)
        views.append(whole(Record(f'{frequency}', DT, u, y, info=info)))
    before = evaluated_on(ModelSpec(base, own), views)
    return Screen(before, views).score(candidate)


def test_a_second_mode_is_found_whatever_the_drives_are() -> None:
    hidden = {'resonance_frequency': 150.0, 'resonance_damping': 0.02, 'resonance_share': 0.16}
    promise = required_score_share('resonance', 'mode_pair', hidden)
    assert promise.explained > 0.3
    first, second = (start['resonance_frequency'] for start in promise.starts[:2])
    assert first == pytest.approx(150.0, rel=0.13)
    # the next start is another place to look at and not the same one again
    assert abs(first - second) > 0.15 * first


def test_a_screening_ends_with_the_time() -> None:
    base = named('bouc_wen_mode')
    own = base.defaults() | MODE
    u = np.sin(2 * np.pi * 11.0 * DT * np.arange(2000))
    record = Record('r', DT, u, 1.1 * answer(base, own, u), info=RecordInfo(frequency=11.0))
    before = evaluated_on(ModelSpec(base, own), [whole(record)])
    candidate = add_effect(base, next(e for e in described('resonance')))
    every = Screen(before, [whole(record)]).score(candidate)
    early = Screen(before, [whole(record)], stopped=lambda: True).score(candidate)
    assert len(early.starts) == 1 < len(every.starts)
    assert 0.0 <= early.explained <= every.explained


@pytest.mark.parametrize('cubic', [4e6, -4e6])
def test_a_sensor_that_is_bent_both_ways_is_seen(cubic: float) -> None:
    hidden = {'sensor_quadratic': 0.0, 'sensor_cubic': cubic}
    promise = required_score_share('sensor_nonlinearity', 'sensor_nonlinearity', hidden)
    assert promise.explained > 0.1
    assert promise.starts[0]['sensor_quadratic'] == 0.0
    assert promise.starts[0]['sensor_cubic'] != 0.0


def test_what_the_end_of_a_chirp_shows_is_not_cut_off() -> None:
    t = DT * np.arange(6000)
    sine, chirp = np.sin(2 * np.pi * 2.0 * t), np.sin(2 * np.pi * (1.0 + 16.0 * t) * t)
    records = [
        Record('sine', DT, sine, sine, info=RecordInfo(excitation='sine', frequency=2.0)),
        Record('chirp', DT, chirp, chirp, info=RecordInfo(excitation='chirp')),
    ]
    views = [whole(record) for record in records]
    kept = {v.name: v.voltage.size for v in thinned(views, 4000, split(records).periods)}
    assert kept['chirp'] > 5800
    assert kept['sine'] < 3000


def test_a_part_of_a_view_has_the_samples_of_that_part() -> None:
    t = DT * np.arange(3000)
    view = replace(
        whole(Record('sine', DT, np.sin(t), np.cos(t))),
        stride=3,
        measured=np.cos(t)[::3],
        valid=np.arange(1000.0),
        influence=2.0 * np.arange(1000.0),
    )
    part = part_of(view, 100, 400)
    assert part.valid is not None
    assert part.influence is not None
    assert part.valid.tolist() == list(range(100, 400))
    assert part.influence.tolist() == list(range(200, 800, 2))
    seen = part.pick(np.cos(DT * (np.arange(part.voltage.size) - view.first)))
    np.testing.assert_allclose(seen, part.measured, rtol=1e-12)


def test_a_lag_before_a_fast_mode_is_right_between_the_samples() -> None:
    lag, mode = 4e-4, {'natural_frequency': 180.0, 'damping_ratio': 0.07}
    loop = {'A1': 1.1e-4, 'A': 6e-5, 'beta': 0.9, 'gamma': 0.4}
    hidden = {
        'effects.noise': False,
        'effects.resonance': True,
        'effects.amplifier_lag': True,
        'amplifier.lag_time_constant': lag,
        'actuator.gain': loop['A1'],
        'bouc_wen.alpha': loop['A'] / loop['A1'],
        'bouc_wen.beta': loop['beta'],
        'bouc_wen.gamma': loop['gamma'],
        **{f'structure.{name}': value for name, value in mode.items()},
    }
    plan = [{'kind': 'sine', 'frequency': 37.0, 'amplitude': 1.0, 'duration': 1.0}]
    (record,) = simulate('generic_bouc_wen', plan, hidden, 1)
    model = Model('chain', tuple(map(named_block, ('amplifier_lag', 'bouc_wen_exact', 'mode'))))
    error = record.displacement - answer(model, {**loop, **mode, 'lag_time': lag}, record.voltage)
    # noise is off, the converter of the simulator is what is left
    assert float(np.std(error[300:])) < 1e-3 * float(np.std(record.displacement))


@pytest.mark.parametrize(
    ('name', 'variant', 'known'),
    [('creep', 'creep', 1), ('resonance', 'mode_pair', 1), ('electrostriction', 'square_law', 0)],
)
def test_stages_that_are_known_are_not_run_again(name: str, variant: str, known: int) -> None:
    base = named('bouc_wen_mode')
    own = base.defaults() | MODE
    u = np.sin(2 * np.pi * 5.0 * DT * np.arange(900))
    view = whole(Record('5', DT, u, answer(base, own, u), info=RecordInfo(frequency=5.0)))
    cache = StageCache(base, base.pack(own), [view])
    effect = next(e for e in described(name) if e.variant == variant)
    candidate = add_effect(base, effect)
    packed = candidate.model.pack(candidate.values(own, candidate.starts[0]))
    assert cache.of(candidate.model, packed, view)[0] == known
    alone = simulated(candidate.model, packed, view)
    assert np.array_equal(simulated(candidate.model, packed, view, cache=cache), alone)
    # another value of the first stage, another view
    other = base.pack(own | {'beta': 2.0 * own['beta']})
    assert cache.of(base, other, view)[0] == 0
    assert cache.of(base, base.pack(own), whole(Record('6', DT, u, u)))[0] == 0


@pytest.mark.parametrize('offset', [0.0, -3e-3])
def test_the_centre_of_a_curve_is_sought_within_the_stroke(offset: float) -> None:
    hidden = {'side_even': 0.0, 'side_odd': 300.0, 'side_centre': 0.0}
    found = required_score_share('sensor_nonlinearity', 'sensor_two_sided', hidden, offset)
    guess = max(found.starts, key=lambda start: start['side_odd'])
    assert guess['side_odd'] == pytest.approx(300.0, rel=0.2)
    assert abs(guess['side_centre']) < 2e-5
