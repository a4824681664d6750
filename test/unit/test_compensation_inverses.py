"""Every inverse undoes its own model, gives the same bits both ways, and fails safely."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from piezo_hysteresis.blocks import named_block
from piezo_hysteresis.compensation.inverses.block_inverse import OscillatorInverse
from piezo_hysteresis.compensation.inverses.chain_inverse import ChainInverse
from piezo_hysteresis.compensation.inverses.inverse_choice import inverse_for, model_gain
from piezo_hysteresis.compensation.inverses.physical import (
    ExtendedInverse,
    PhysicalInverse,
    SlopeSelectedInverse,
    least_slope,
)
from piezo_hysteresis.compensation.link import Limits, ReferencePoint
from piezo_hysteresis.compensation.offline_loop import reference_points
from piezo_hysteresis.errors import CompensationError, IdentificationError
from piezo_hysteresis.identification.inverse_fit import InverseBoucWen, fit_inverse, selector_table
from piezo_hysteresis.models.chain import Model
from piezo_hysteresis.models.named import named
from piezo_hysteresis.waveforms import Sine, Triangle
from piezo_hysteresis.waveforms.waveform import Samples

DT = 1e-3
BOUC_WEN = {'A1': 150e-6, 'A': 40e-6, 'beta': 1.0, 'gamma': 0.1}
MODE = {'natural_frequency': 68.0, 'damping_ratio': 0.015}
AR = {'c1': 0.4752, 'c2': -0.7983}
PLAYS = {'pi_range': 1.0, 'w0': 100e-6, **{f'w{j}': j * 1e-6 for j in range(1, 10)}}
INVERSE = {'inverse_gain': 9e3, 'inverse_A': -2e3, 'inverse_beta': 1e4, 'inverse_gamma': 2e3}
OFFSET = {'offset': 6e-6}
OSCILLATOR = {'mass': 0.25, 'damping': 1.2, 'stiffness': 7e3, 'z_alpha': 3e3, 'z_beta': 3e3}


def chain(*names: str) -> Model:
    return Model('test', tuple(named_block(name) for name in names))


def reference(
    frequency: float, seconds: float = 2.0, amplitude: float = 100e-6, dt: Any = DT
) -> Samples:
    time = np.arange(round(seconds / dt)) * dt
    return Sine(amplitude, frequency, seconds, ramp=0.6).sample(time)


# Chain, values, class of the inverse that is chosen, largest error at 10 Hz [m].
CASES = {
    'extended': (('bouc_wen', 'autoregressive', 'offset'),
                 {'A1': 50e-6, 'A': 10e-6, 'A0': 2e-6, 'beta': 1.0, 'gamma': 0.1, **AR, **OFFSET},
                 ExtendedInverse, 1e-15),
    'modified': (('bouc_wen_exact', 'offset'), {**BOUC_WEN, 'A0': 5e-6, **OFFSET},
                 PhysicalInverse, 1e-14),
    'euler': (('bouc_wen', 'offset'), {**BOUC_WEN, 'A0': 5e-6, **OFFSET}, PhysicalInverse, 1e-14),
    'bouc_wen_mode': (('bouc_wen_exact', 'mode', 'offset'), {**BOUC_WEN, **MODE, **OFFSET},
                      PhysicalInverse, 2e-9),
    'plays': (('prandtl_ishlinskii', 'offset'), {**PLAYS, **OFFSET}, PhysicalInverse, 1e-14),
    'plays_mode': (('prandtl_ishlinskii', 'mode'), {**PLAYS, **MODE}, PhysicalInverse, 2e-9),
    'linear_mode': (('gain', 'mode', 'offset'), {'A1': 120e-6, **MODE, **OFFSET},
                    PhysicalInverse, 2e-9),
    'delay': (('transport_delay', 'bouc_wen_exact', 'mode'), {**BOUC_WEN, **MODE, 'delay': 4e-3},
              PhysicalInverse, 1e-8),
    'inverse_law': (('inverse_bouc_wen', 'offset'), {**INVERSE, **OFFSET},
                    SlopeSelectedInverse, 1e-9),
    'oscillator': (('bouc_wen_oscillator',), {**OSCILLATOR, 'interpolation': 2.0},
                   OscillatorInverse, 5e-8),
    'preisach': (('preisach', 'mode'), MODE, ChainInverse, 2e-9),
    'everything': (('amplifier_lag', 'square_law', 'bouc_wen_exact', 'mode', 'creep',
                    'sensor_nonlinearity', 'offset'),
                   {**BOUC_WEN, **MODE, **OFFSET, 'sensor_quadratic': 77.0, 'lag_time': 1e-3},
                   ChainInverse, 3e-8),
    'power': (('bouc_wen_power', 'stiffness', 'mode', 'logarithmic_creep'),
              {**BOUC_WEN, **MODE, 'exponent': 2.0, 'cubic_stiffness': 5e6}, ChainInverse, 3e-9),
    'creep_pair': (('bouc_wen_exact', 'mode', 'creep_pair'),
                   {**BOUC_WEN, **MODE, 'creep_share': 0.05, 'creep_time': 0.1,
                    'slow_creep_share': 0.05, 'slow_creep_ratio': 30.0}, ChainInverse, 3e-8),
    'nonlinear_mode': (('bouc_wen_exact', 'nonlinear_mode'),
                       {**BOUC_WEN, **MODE, 'mode_cubic': 5e6, 'mode_friction': 1e-6,
                        'presliding': 20e-6}, ChainInverse, 3e-7),
    'two_modes': (('bouc_wen_exact', 'mode', 'resonance'),
                  {**BOUC_WEN, **MODE, 'resonance_frequency': 400.0}, ChainInverse, 3e-8),
    'lag_before_mode': (('amplifier_lag', 'bouc_wen_exact', 'mode'),
                        {**BOUC_WEN, **MODE, 'lag_time': 4e-4}, ChainInverse, 1e-7),
    # a lag that is over before a sample is: no number on the way may overflow
    'fast_lag': (('amplifier_lag', 'bouc_wen_exact', 'mode'),
                 {**BOUC_WEN, **MODE, 'lag_time': 1e-7}, ChainInverse, 1e-7),
    'part_of_a_tick': (('transport_delay', 'bouc_wen_exact', 'mode', 'creep'),
                       {**BOUC_WEN, **MODE, 'delay': 2.3e-3}, ChainInverse, 1e-7),
    'mode_pair': (('bouc_wen_exact', 'mode_pair'),
                  {**BOUC_WEN, **MODE, 'resonance_frequency': 400.0, 'resonance_share': 0.2},
                  ChainInverse, 3e-8),
}  # fmt: skip


def build(case: Any) -> Any:
    names, values, kind, bound = CASES[case]
    model = chain(*names)
    known = {name: value for name, value in values.items() if name in model.parameter_names}
    return model, known, kind, bound


# Inverses that are found numerically, sample by sample.
NUMERIC = ('everything', 'power', 'creep_pair', 'part_of_a_tick', 'lag_before_mode')
MARKED = [pytest.param(case, marks=pytest.mark.slow if case in NUMERIC else []) for case in CASES]


@pytest.mark.component
@pytest.mark.parametrize('case', MARKED)
def test_the_inverse_undoes_its_model(case: Any) -> None:
    model, values, kind, bound = build(case)
    link = inverse_for(model, values, DT)
    assert type(link) is kind
    wanted = reference(10.0)
    voltage = link.respond(wanted.value, wanted.velocity, wanted.acceleration)
    answer = model.respond(voltage, model.pack(values), DT)
    assert np.abs(answer - wanted.value)[1400:].max() < bound


@pytest.mark.component
@pytest.mark.parametrize('case', MARKED)
def test_array_and_step_give_the_same_bits(case: Any) -> None:
    model, values, _, _ = build(case)
    link = inverse_for(model, values, DT)
    wanted = reference(23.0, 0.8)
    whole = link.respond(wanted.value, wanted.velocity, wanted.acceleration)
    single = [link.step(point) for point in reference_points(wanted)]
    assert np.array_equal(whole, single)
    link.reset()
    again = [link.step(point) for point in reference_points(wanted)]
    assert np.array_equal(whole, again)


@pytest.mark.parametrize('case', ['extended', 'bouc_wen_mode', 'plays_mode', 'everything'])
def test_new_parameters_do_not_make_the_output_jump(case: str) -> None:
    model, values, _, _ = build(case)
    limits = Limits(-5.0, 5.0, slew=100.0)
    link = inverse_for(model, values, DT, limits=limits)
    steady = inverse_for(model, values, DT, limits=limits)
    points = list(reference_points(reference(5.0)))
    path = [link.step(point) for point in points[:1200]]
    calm = np.abs(np.diff([steady.step(point) for point in points])).max()
    first = 'w0' if 'w0' in values else 'A1'
    link.set_parameters({first: 1.3 * values[first]})
    path += [link.step(point) for point in points[1200:]]
    assert np.abs(np.diff(path)).max() < calm + limits.slew * DT
    assert np.ptp(path[1700:]) < 0.85 * np.ptp(path[800:1200])


def test_a_refused_set_leaves_the_old_one_in_force() -> None:
    model, values, _, _ = build('bouc_wen_mode')
    link = inverse_for(model, values, DT)
    before = link.parameters
    with pytest.raises(CompensationError):
        link.set_parameters({'A1': -1e-4})
    assert link.parameters == before


def test_extended_inverse_is_the_printed_pair_of_equations() -> None:
    p = {'A1': 50e-6, 'A': 10e-6, 'A0': 2e-6, 'beta': 1.0, 'gamma': 0.3, **AR}
    d = reference(14.0, 1.0, 60e-6).value
    printed = []
    u1 = h1 = d1 = d2 = d3 = 0.0
    for now in d:
        q = now - d1 - p['c1'] * d2 - p['c2'] * d3 + h1
        voltages = []
        for s in (1.0, -1.0):  # (16), (17)
            q1 = q + (-p['A'] - s * p['A0'] + p['gamma'] * abs(h1) + s * p['beta'] * h1) * u1
            slope = p['A1'] - p['A'] - s * p['A0'] + p['gamma'] * abs(h1) + s * p['beta'] * h1
            voltages.append(q1 / slope)
        u = voltages[0] if voltages[0] - u1 >= 0 else voltages[1]
        du = u - u1
        h1 += p['A'] * du + p['A0'] * abs(du) - (p['gamma'] * abs(h1) * du
                                                  + p['beta'] * abs(du) * h1)  # fmt: skip
        u1, d1, d2, d3 = u, now, d1, d2
        printed.append(u)
    ours = ExtendedInverse(p, DT, start=0.0).respond(d)
    np.testing.assert_allclose(ours, printed, atol=1e-12)


def test_the_law_of_tatebatake_and_fujii_is_their_equation_as_printed() -> None:
    """Tatebatake 2017 (12): h of the sample before, over A1, with the sign of A0 of Fujii 2018."""
    p = {'A1': 50e-6, 'A': 10e-6, 'A0': 2e-6, 'beta': 1.0, 'gamma': 0.3, **AR}
    d = reference(14.0, 1.0, 60e-6).value
    printed = []
    u1 = h1 = d1 = d2 = d3 = 0.0
    for now in d:
        u = (now - d1 - p['c1'] * d2 - p['c2'] * d3 + h1) / p['A1']
        du = u - u1
        h1 += (
            p['A'] * du + p['A0'] * abs(du) - p['gamma'] * abs(h1) * du - p['beta'] * abs(du) * h1
        )
        u1, d1, d2, d3 = u, now, d1, d2
        printed.append(u)
    ours = ExtendedInverse(p, DT, law='printed', start=0.0).respond(d)
    np.testing.assert_allclose(ours, printed, atol=1e-12)
    solved = ExtendedInverse(p, DT, start=0.0).respond(d)
    assert np.max(np.abs(ours - solved)) > 1e-3


EXTENDED = {'A1': 50e-6, 'A': 10e-6, 'A0': 0.0, 'beta': 1.0, 'gamma': 0.1, **AR, **OFFSET}
BY_NAME = {
    'fujii2018': ('extended', EXTENDED, ExtendedInverse),
    'tatebatake2017': ('extended', EXTENDED, ExtendedInverse),
    'zhou2021': ('bouc_wen_mode', {**BOUC_WEN, **MODE}, PhysicalInverse),
    'exact': ('classical', BOUC_WEN, PhysicalInverse),
    'numeric': ('classical', BOUC_WEN, ChainInverse),
    'gain': ('preisach', {}, PhysicalInverse),
    'xiao2014': ('inverse', {}, SlopeSelectedInverse),
    'fang2019': ('rate_dependent', {'A1': 150e-6, 'A': 40e-6}, ChainInverse),
}


@pytest.mark.parametrize('law', BY_NAME)
def test_a_law_is_chosen_by_the_name_of_its_paper(law: Any) -> None:
    name, values, kind = BY_NAME[law]
    link = inverse_for(named(name), values, DT, law=law)
    assert isinstance(link, kind)
    assert np.all(np.isfinite(link.respond(reference(5.0, 0.4, 20e-6).value)))


def test_the_late_laws_miss_more_than_the_solved_ones() -> None:
    """What one sample of hysteresis costs: both forms on the model that they invert."""
    for model, values, late, solved in (
        ('extended', EXTENDED, 'tatebatake2017', 'fujii2018'),
        ('bouc_wen_mode', {**BOUC_WEN, **MODE}, 'zhou2021', 'exact'),
    ):
        chain_ = named(model)
        samples = reference(10.0, 2.0, 40e-6)
        errors = []
        for law in (late, solved):
            link = inverse_for(chain_, values, DT, law=law, start=0.0)
            voltage = np.array(
                [link.step(point, 0.0, None) for point in reference_points(samples)]
            )
            moved = chain_.respond(voltage, chain_.pack(values), DT)
            errors.append(float(np.std((moved - samples.value)[1000:])))
        assert errors[0] > 2 * errors[1]


@pytest.mark.parametrize(
    ('law', 'name', 'says'),
    [
        (
            'tatebatake2017',
            'classical',
            'inverts bouc_wen and autoregressive, but model classical',
        ),
        ('zhou2021', 'preisach', 'inverts bouc_wen_exact or bouc_wen'),
        ('xiao2014', 'classical', 'inverts inverse_bouc_wen or inverse_selector'),
        ('best', 'classical', "there is no inverse 'best'; choose one of auto"),
    ],
)
def test_a_law_that_is_not_for_the_model_is_refused(law: str, name: str, says: str) -> None:
    with pytest.raises(CompensationError, match=says):
        inverse_for(named(name), {}, DT, law=law)
    with pytest.raises(CompensationError, match='choose solved or printed'):
        ExtendedInverse(EXTENDED, DT, law='guessed')


def test_delayed_law_is_rakotondrabes_multiplicative_form() -> None:
    d = reference(10.0, 0.5).value
    link = PhysicalInverse(BOUC_WEN, DT, law='delayed', start=0.0)
    h = last = 0.0
    for now, ours in zip(d, link.respond(d), strict=True):
        u = (now + h) / BOUC_WEN['A1']
        du = u - last
        h += BOUC_WEN['A'] * du - BOUC_WEN['gamma'] * abs(h) * du - BOUC_WEN['beta'] * abs(du) * h
        last = u
        assert ours == pytest.approx(u, abs=1e-14)


@pytest.mark.component
def test_analytic_play_inverse_agrees_with_the_numeric_one() -> None:
    model, values, _, _ = build('plays')
    wanted = reference(7.0)
    analytic = inverse_for(model, values, DT).respond(wanted.value)
    numeric = ChainInverse(model, values, DT).respond(wanted.value)
    np.testing.assert_allclose(analytic, numeric, atol=1e-10)


def test_slopes_that_are_not_positive_are_clamped_and_counted_never_flipped() -> None:
    falling = {'A1': 170e-6, 'A': 125e-6, 'beta': 0.6, 'gamma': 0.1}
    assert least_slope(falling) < 0.0
    wanted = reference(10.0, 2.0, 150e-6)
    for law in ('exact', 'euler'):
        link = PhysicalInverse(falling, DT, law=law, start=0.0)
        voltage = [link.step(point) for point in reference_points(wanted)]
        assert link.counters()['clamped_slopes'] > 0
        assert np.isfinite(voltage).all()
    moves = np.diff(PhysicalInverse(falling, DT, law='delayed', start=0.0).respond(wanted.value))
    assert np.isfinite(moves).all()


def test_a_reference_beyond_the_stroke_is_limited_without_later_error() -> None:
    model, values, _, _ = build('bouc_wen_mode')
    limits = Limits(-1.2, 1.2)
    far = Triangle(400e-6, 4.0, frequency=1.0).sample(np.arange(4000.0) * DT)
    near = reference(5.0, 4.0, 80e-6)
    link = inverse_for(model, values, DT, limits=limits)
    for point in list(reference_points(far))[:1000]:
        assert -1.2 <= link.step(point) <= 1.2
    assert link.counters()['out_of_stroke'] > 100
    assert link.counters()['corners'] > 0
    points = list(reference_points(near))
    fresh = inverse_for(model, values, DT, limits=limits)
    after = np.array([link.step(point) for point in points])
    clean = np.array([fresh.step(point) for point in points])
    # What the excursion left in h is driven out by the reference itself.
    assert np.abs(after - clean)[3500:].max() < 0.03


def test_a_reference_that_is_no_number_is_held_and_counted() -> None:
    link = PhysicalInverse(BOUC_WEN, DT, start=0.0)
    held = link.step(ReferencePoint(0, 50e-6, 0.0, 0.0, 0.0, 0.0))
    after = link.step(ReferencePoint(1, math.nan, 0.0, 0.0, 0.0, 0.0))
    assert after == pytest.approx(held, abs=1e-12)
    assert link.counters()['refused_references'] == 1


@pytest.mark.parametrize(
    'values',
    [
        {**BOUC_WEN, 'A1': 0.0},
        {**BOUC_WEN, 'A': 160e-6},
        {**BOUC_WEN, 'A1': math.nan},
        {'A1': 150e-6},
        {**BOUC_WEN, 'natural_frequency': 68.0},
    ],
)
def test_models_without_inverse_are_refused_with_a_sentence(values: dict[str, Any]) -> None:
    with pytest.raises(CompensationError):
        PhysicalInverse(values, DT)


def test_a_chain_with_a_block_that_turns_back_is_refused() -> None:
    model = chain('bouc_wen_power', 'mode')
    with pytest.raises(CompensationError, match='does not keep its sign'):
        inverse_for(model, {**BOUC_WEN, **MODE, 'A1': 30e-6}, DT)


def test_the_start_is_smooth_for_a_reference_that_begins_away_from_rest() -> None:
    link = PhysicalInverse({**BOUC_WEN, **MODE, **OFFSET}, DT, start=0.5)
    voltage = np.array([link.step(ReferencePoint(k, 100e-6, 0, 0, 0, 0)) for k in range(1000)])
    assert abs(voltage[0]) < 1e-3
    assert np.abs(np.diff(voltage, 2)).max() < 2e-4


def test_selector_recovers_its_rows_and_follows_triangles() -> None:
    rows = [
        InverseBoucWen(slope, 3e6, -2e6, 2e5, 3e4 * (1 + i))
        for i, slope in enumerate((1e-3, 3e-3))
    ]
    time = np.arange(4000.0) * 1e-5
    fitted = []
    for row, frequency in zip(rows, (20.0, 60.0), strict=True):
        wave = Triangle(12.5e-6, 1.0, frequency=frequency).sample(time)
        law = {'inverse_gain': row.c, 'inverse_A': row.a, 'inverse_beta': row.b}
        link = SlopeSelectedInverse({**law, 'inverse_gamma': row.g}, 1e-5, start=0.0)
        voltage = link.respond(wave.value, wave.velocity)
        fitted.append(fit_inverse(wave.value, voltage, row.slope, warm_up=500))
        both = SlopeSelectedInverse(selector_table(rows), 1e-5, start=0.0)
        np.testing.assert_allclose(both.respond(wave.value, wave.velocity), voltage, atol=0.1)
    for row, found in zip(rows, fitted, strict=True):
        assert found.c == pytest.approx(row.c, rel=0.02)
        assert found.b == pytest.approx(row.b, rel=0.1)
    with pytest.raises(IdentificationError):
        selector_table(rows[:1])


def test_model_gain_is_that_of_mode_and_mean_slope() -> None:
    model = named('bouc_wen_mode')
    values = {**BOUC_WEN, **MODE, **OFFSET, 'A0': 0.0}
    gain = model_gain(model, values, DT)
    ratio = 50.0 / 68.0
    mode = 1.0 / (1.0 - ratio**2 + 2j * 0.015 * ratio)
    lag = np.exp(-2j * np.pi * 50.0 * 0.5 * DT)
    assert gain(50.0) / gain(0.0) == pytest.approx(mode * lag, rel=0.01)
    assert 110e-6 < gain(0.0).real < 150e-6
    assert gain(-50.0) == pytest.approx(np.conj(gain(50.0)))


def test_without_compensation_an_offset_that_balances_a0_is_no_displacement() -> None:
    """RLS of the papers finds A0 and, from free runs, an offset of the other sign."""
    model = named('extended')
    values = {'A1': 1.0e-4, 'A': 4e-5, 'A0': 3.6e-7, 'beta': 0.05, 'gamma': 0.01,
              'c1': -0.2, 'c2': 0.1, 'offset': 0.0}  # fmt: skip
    drive = np.sin(2 * np.pi * 10.0 * DT * np.arange(30_000))
    known = {name: values[name] for name in model.parameter_names}
    mean = float(model.respond(drive, model.pack(known), DT)[-1000:].mean())
    assert abs(mean) > 3e-6
    known['offset'] = 7e-6 - mean
    link = inverse_for(model, known, DT, law='gain', start=0.0, limits=Limits(-2.0, 2.0, 1e9))
    assert link.step(ReferencePoint(0, 7e-6, 0.0, 0.0, 0.0, 0.0), 0.0) == pytest.approx(
        0, abs=3e-3
    )
