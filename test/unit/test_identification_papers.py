"""The models and methods of the papers, by name, recover what the data were made of."""

import numpy as np
import pytest

from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.identification import identify
from piezo_hysteresis.identification.global_search import FANG, Swarm
from piezo_hysteresis.identification.identify import Identification
from piezo_hysteresis.identification.inverse_fit import row_of
from piezo_hysteresis.identification.rls import OnlineRls, RlsSettings
from piezo_hysteresis.models import named
from piezo_hysteresis.records import Record, RecordInfo
from piezo_hysteresis.runtime.identification_plan import RecordSegmenter, SegmentEdge

DT = 1e-3
HARMONIC = {
    'A1': 60e-6, 'A': 20e-6, 'A0': 0.0, 'beta': 1.5, 'gamma': 0.5, 'c1': 0.4, 'c2': -0.75,
    'offset': 5e-6, 'c3': -0.1, 'c4': -0.2, 'al1': 3e-6, 'al2': -2e-6,
}  # fmt: skip
STACK = {'A1': 3e-7, 'A': 1e-7, 'beta': 0.06, 'gamma': 0.02, 'offset': 1e-6}
INVERSE = {
    'inverse_gain': 4e6, 'inverse_A': -2e6, 'inverse_beta': 3e5, 'inverse_gamma': 5e4,
}  # fmt: skip
FLAP = {
    'A1': 5.5e-6, 'A': 3.355e-6, 'beta': 0.039, 'gamma': 0.0065, 'mass': 0.05138,
    'damping': 100.0, 'stiffness': 8e5, 'offset': 0.0,
}  # fmt: skip


def record(
    name: str,
    values: dict[str, float],
    frequency: float,
    seconds: float,
    amplitude: float = 1.0,
    noise: float = 2e-9,
    dt: float = DT,
) -> Record:
    """Return a sine from rest, measured before the voltage of each tick acts."""
    model = named(name)
    u = amplitude * np.sin(2 * np.pi * frequency * dt * np.arange(round(seconds / dt)))
    y = model.respond(u, model.pack({**model.defaults(), **values}), dt, frequency=frequency)
    if model.answers_at_once:
        y = np.concatenate([[values.get('offset', 0.0)], y[:-1]])
    y = y + np.random.default_rng(int(frequency)).normal(0, noise, u.size)
    info = RecordInfo('', 'sine', frequency, amplitude, min(1.0, seconds / 3))
    return Record(f'{frequency:g}Hz', dt, u, y, info=info)


def worst(found: Identification) -> float:
    return max(row.nrmse_percent for row in found.records)


@pytest.mark.component
def test_the_enhanced_model_is_found_by_default_and_beats_the_extended_one() -> None:
    data = [record('enhanced3', HARMONIC, 21.0, 4.0)]
    enhanced = identify(data, named('enhanced3'))
    extended = identify(data, named('extended'))
    assert worst(enhanced) < 0.02
    assert worst(enhanced) < 0.2 * worst(extended)
    for name in ('A1', 'A', 'beta', 'c1', 'c2'):
        assert enhanced.values[name] == pytest.approx(HARMONIC[name], rel=0.02)


@pytest.mark.component
def test_the_enhanced_model_is_never_worse_than_the_extended_one() -> None:
    values = {k: v for k, v in HARMONIC.items() if k in named('extended').parameter_names}
    data = [record('extended', values, 21.0, 4.0)]
    errors = [worst(identify(data, named(name))) for name in ('extended', 'enhanced3')]
    assert errors[1] <= 1.001 * errors[0]


@pytest.mark.parametrize('block', ['harmonic3', 'exogenous3'])
def test_harmonics_follow_the_drive_and_not_what_leads_in(block: str) -> None:
    model = named('extended').with_block(
        next(b for b in named(f'enhanced3{"_sine" if block == "harmonic3" else ""}').blocks
             if b.name == block)
    )  # fmt: skip
    more = {'sine3': 2e-6, 'cosine3': 1e-6} if block == 'harmonic3' else {}
    values = {**model.defaults(), **{k: HARMONIC[k] for k in ('al1', 'al2') if not more}, **more}
    u = np.sin(2 * np.pi * 23.0 * DT * np.arange(3000))
    whole = model.respond(u, model.pack(values), DT, frequency=23.0)
    led = model.respond(
        np.concatenate([np.zeros(4), u]),
        model.pack(values),
        DT,
        state=model.initial_state(DT, -4 * DT),
        frequency=23.0,
    )
    np.testing.assert_allclose(led[-500:], whole[-500:], atol=1e-9)


def test_rls_takes_the_harmonic_of_every_record() -> None:
    data = [record('enhanced3', HARMONIC, f, 4.0) for f in (20.0, 23.0)]
    found = identify(data, named('enhanced3'), method='fujii2018')
    by_hand = OnlineRls(RlsSettings(harmonic=3, frequency=20.0))
    for each in data:
        by_hand.rest()
        by_hand.drive_at(each.info.frequency)
        by_hand.update_many(each.voltage, each.displacement)
    expected = by_hand.estimate().parameters()
    assert {k: found.values[k] for k in expected if k != 'offset'} == expected
    once = OnlineRls(RlsSettings(harmonic=3, frequency=20.0))
    for each in data:
        once.rest()
        once.update_many(each.voltage, each.displacement)
    assert once.estimate().parameters()['al1'] != pytest.approx(expected['al1'], rel=1e-3)
    silent = Record('silent', DT, data[0].voltage, data[0].displacement)
    with pytest.raises(IdentificationError, match='--frequency'):
        identify([data[0], silent], named('enhanced3'), method='rls')


def test_the_offset_of_rls_is_what_its_free_runs_miss() -> None:
    data = [record('enhanced3', HARMONIC, 23.0, 4.0)]
    found = identify(data, named('enhanced3'), method='rls')
    assert worst(found) < 10.0
    assert abs(found.values['offset']) > 0.0
    printed = identify(data, named('enhanced3'), method='rls', offset=False)
    assert printed.values['offset'] == 0.0
    # each error is that of a run in the zero of its record
    assert worst(printed) == pytest.approx(worst(found), rel=0.1)


def test_rls_uses_the_given_start_and_covariance() -> None:
    data = [record('enhanced3', HARMONIC, 23.0, 2.0)]
    start = {name: HARMONIC[name] for name in ('A1', 'A', 'beta', 'gamma', 'c1', 'c2')}
    firm = identify(data, named('extended'), method='rls', start=start, p0=1e-12)
    for name, value in start.items():
        assert firm.values[name] == pytest.approx(value, rel=1e-3)
    loose = identify(data, named('extended'), method='rls', start=start)
    assert loose.values['c1'] != pytest.approx(start['c1'], rel=1e-3)
    with pytest.raises(IdentificationError, match='cannot start from offset'):
        identify(data, named('extended'), method='rls', start={'offset': 1e-6})
    with pytest.raises(IdentificationError, match='p0'):
        identify(data, named('extended'), method='rls', p0=0.0)


def test_markers_move_the_harmonic_of_the_online_recursion() -> None:
    course = RecordSegmenter(OnlineRls(RlsSettings(harmonic=3, frequency=5.0)), 1.0 / DT)
    data = record('enhanced3', HARMONIC, 23.0, 0.5)
    course.mark(SegmentEdge(0, 'a', 23.0))
    for k, (u, y) in enumerate(zip(data.voltage, data.displacement, strict=True)):
        course.take(k, k * 1_000_000, float(u), float(y))
    recursion = OnlineRls(RlsSettings(harmonic=3, frequency=23.0))
    recursion.update_many(data.voltage, data.displacement)
    assert course.method.estimate().parameters() == recursion.estimate().parameters()
    course.mark(SegmentEdge(600_000_000, 'b', 400.0))
    course.take(600, 600_000_000, 0.0, 0.0)
    assert course.unseen == 1


@pytest.mark.component
def test_the_two_steps_of_002_recover_its_table() -> None:
    data = [
        record('second_order', FLAP, f, s, 60.0, 1e-7, 5e-4) for f, s in ((1.0, 4.0), (30.0, 1.0))
    ]
    chain = named('second_order').hold(A1=FLAP['A1'], mass=FLAP['mass'])
    found = identify(data, chain, method='zhou2021', seed=1, max_evaluations=8000)
    assert worst(found) < 0.5
    for name, share in (('A', 0.05), ('damping', 0.05)):
        assert found.values[name] == pytest.approx(FLAP[name], rel=share)
    # the height of the loop, of which beta and gamma are two halves that one amplitude mixes
    saturation = found.values['A'] / (found.values['beta'] + found.values['gamma'])
    assert saturation == pytest.approx(FLAP['A'] / (FLAP['beta'] + FLAP['gamma']), rel=0.05)
    with pytest.raises(IdentificationError, match='two drive frequencies'):
        identify(data[:1], chain, method='zhou2021')


@pytest.mark.slow
@pytest.mark.parametrize('method', ['xiao2014', 'fang2019'])
def test_the_swarms_of_003_and_004_recover_a_model(method: str) -> None:
    data = [record('classical', STACK, f, 2.0, 50.0, 1e-9) for f in (2.0, 5.0)]
    found = identify(data, named('classical'), method=method, seed=1, max_evaluations=12000)
    assert worst(found) < 0.3
    for name, share in (('A1', 0.01), ('A', 0.1), ('beta', 0.15)):
        assert found.values[name] == pytest.approx(STACK[name], rel=share)


@pytest.mark.component
@pytest.mark.parametrize('method', ['xiao2014', 'output_error'])
def test_the_inverse_of_003_is_recovered(method: str) -> None:
    data = [record('inverse', INVERSE, f, 2.0, 50.0, 1e-9) for f in (2.0, 5.0)]
    found = identify(data, named('inverse'), method=method, seed=1)
    assert worst(found) < 0.05
    for name, value in INVERSE.items():
        assert found.values[name] == pytest.approx(value, rel=0.02)


@pytest.mark.slow
def test_rows_of_the_selector_are_recovered() -> None:
    other = {**INVERSE, 'inverse_gain': 3e6, 'inverse_beta': 2e5}
    data = [
        record('inverse', values, f, 1.0, 50.0, 1e-9)
        for values, f in ((INVERSE, 5.0), (other, 40.0))
    ]
    for values, each in zip((INVERSE, other), data, strict=True):
        row = row_of(each)
        assert row.c == pytest.approx(values['inverse_gain'], rel=0.01)
        assert row.b == pytest.approx(values['inverse_beta'], rel=0.02)
    found = identify(data, named('inverse_selector'), method='xiao2014', seed=1)
    steep = found.values['selector_slope']
    assert steep == pytest.approx(row_of(data[1]).slope)
    assert found.values['inverse_gain_at10'] == pytest.approx(3e6, rel=0.01)
    assert found.values['inverse_gain_at1'] == pytest.approx(4e6, rel=0.05)
    with pytest.raises(IdentificationError, match='different slopes'):
        identify(data[:1], named('inverse_selector'), method='xiao2014')


@pytest.mark.slow
def test_the_selector_is_never_worse_than_one_row() -> None:
    other = {**INVERSE, 'inverse_gain': 3.6e6}
    data = [
        record('inverse', values, f, 1.0, 50.0, 1e-9)
        for values, f in ((INVERSE, 5.0), (other, 40.0))
    ]
    one, ten = (identify(data, named(name)) for name in ('inverse', 'inverse_selector'))
    assert worst(ten) < 0.5 * worst(one)


@pytest.mark.component
def test_the_exponent_is_recovered_by_name() -> None:
    truth = {**STACK, 'exponent': 1.7}
    data = [
        record('classical_power', truth, f, 2.0, a, 1e-9) for f, a in ((2.0, 50.0), (5.0, 25.0))
    ]
    found = identify(data, named('classical_power'))
    for name in ('A1', 'A', 'beta', 'exponent'):
        assert found.values[name] == pytest.approx(truth[name], rel=0.01)


@pytest.mark.component
def test_constants_of_a_swarm_are_options() -> None:
    assert FANG.constriction == pytest.approx(0.6417, abs=1e-4)
    data = [record('classical', STACK, f, 1.0, 50.0, 1e-9) for f in (2.0, 5.0)]

    def run(**constants: float) -> dict[str, float]:
        return identify(
            data, named('classical'), method='fang2019', max_evaluations=300, swarm=constants
        ).values

    assert run() == run(population=50) != run(population=20)
    assert run() != run(inertia=0.7)
    with pytest.raises(IdentificationError, match='a swarm has no speed'):
        run(speed=1.0)
    with pytest.raises(IdentificationError, match=r'0 \.\. 10'):
        Swarm(own=-1.0)
    with pytest.raises(IdentificationError, match='no swarm'):
        identify(data, named('classical'), method='de', swarm={'inertia': 0.5})


def lagging(values: dict[str, float], u: np.ndarray) -> np.ndarray:
    """Return the output [m] of Tatebatake 2017 (8) for an actuator without hysteresis."""
    y = np.zeros(u.size + 2)
    for k, voltage in enumerate(u, start=2):
        y[k] = y[k - 1] + values['c1'] * y[k - 2] + values['c2'] * y[k - 1]
        y[k] += values['A1'] * voltage
    return y[2:]


def test_the_regressor_as_printed_in_001_finds_the_linear_part() -> None:
    """Beside hysteresis it does not: its sums have the signs of no Bouc-Wen loop."""
    truth = {'A1': 60e-6, 'c1': 0.2, 'c2': -0.6}
    t, phases = DT * np.arange(20_000), np.random.default_rng(1).uniform(0.0, 6.0, 7)
    tones = (3.0, 17.0, 41.0, 83.0, 131.0, 177.0, 211.0)
    u = sum(np.sin(2 * np.pi * f * t + p) for f, p in zip(tones, phases, strict=True)) / 4
    data = [Record('tones', DT, u, lagging(truth, u))]
    found = identify(data, named('extended'), method='tatebatake2017', unit='um', p0=1e3).values
    assert found['c1'] == pytest.approx(truth['c1'], rel=1e-3)
    assert found['c2'] == pytest.approx(truth['c2'], rel=1e-3)
    # the voltage and the sum of its steps are one column: only both together are seen
    assert found['A1'] + found['A'] == pytest.approx(truth['A1'], rel=1e-3)
