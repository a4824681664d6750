"""Output error: derivatives, folding, solver, recovery, uncertainty."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from piezo_hysteresis.blocks import named_block
from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.identification import identify
from piezo_hysteresis.identification.fit import fit
from piezo_hysteresis.identification.fit_data import fold, targets_of, whole
from piezo_hysteresis.identification.free_run import shifted
from piezo_hysteresis.identification.objective import Prior
from piezo_hysteresis.identification.output_error import output_error, suited
from piezo_hysteresis.identification.periods import period_of
from piezo_hysteresis.identification.sensitivities import delays_by_ticks, sensitivities
from piezo_hysteresis.identification.starts import (
    linear_parameters,
    representative,
    resonant_lines,
    starts,
)
from piezo_hysteresis.identification.uncertainty import Covariance, digits, warnings_of
from piezo_hysteresis.models import Model, named
from piezo_hysteresis.numerics.qr import triangle
from piezo_hysteresis.records import Record, RecordInfo

DT = 1e-3
TRUTH = {
    'A1': 180e-6,
    'A': 60e-6,
    'beta': 2.5,
    'gamma': 1.0,
    'natural_frequency': 68.0,
    'damping_ratio': 0.015,
    'offset': 6e-6,
}


def chain(*blocks: str, **held: float) -> Model:
    return Model('test', tuple(named_block(each) for each in blocks), held)


# away from neutral values, where differences are one-sided
MOVED = {
    'A0': 3e-6,
    'lag_time': 2e-3,
    'creep_share': 0.1,
    'creep_time': 0.5,
    'mode_cubic': 4e6,
    'mode_friction': 2e-6,
    'presliding': 3e-6,
    'breakaway': 1.2,
}
BIMORPH = chain('bouc_wen', 'mode', 'offset', A0=0.0)


@pytest.mark.parametrize(
    ('blocks', 'by_ticks'),
    [
        (('prandtl_ishlinskii', 'offset'), True),
        (('prandtl_ishlinskii', 'creep', 'offset'), True),
        (('prandtl_ishlinskii', 'logarithmic_creep', 'offset'), True),
        (('bouc_wen', 'mode', 'offset'), False),
        (('bouc_wen', 'mode', 'creep', 'offset'), False),
        (('bouc_wen', 'sensor_lag', 'offset'), False),
    ],
)
def test_a_delay_moves_by_ticks_what_passes_a_held_voltage_on(
    blocks: tuple[str, ...], by_ticks: bool
) -> None:
    """The fit of a delay before plays and creep ended 1.8 ms, 9 ticks, from the true one."""
    late = chain('transport_delay', *blocks)
    assert delays_by_ticks(late) == ({'delay'} if by_ticks else set())


def sine(frequency: float, seconds: float, amplitude: float = 1.0) -> np.ndarray:
    wave = np.sin(2 * np.pi * frequency * DT * np.arange(round(seconds / DT)))
    return np.asarray(amplitude * wave)


def simulated(
    frequency: float, model: Model = BIMORPH, noise: float = 20e-9, seconds: float = 20.0
) -> Record:
    u = sine(frequency, seconds)
    y = model.respond(u, model.pack(TRUTH), DT)
    y = y + np.random.default_rng(int(frequency)).normal(0, noise, u.size)
    return Record(f'{frequency:g} Hz', DT, u, y, info=RecordInfo(frequency=frequency))


@pytest.mark.parametrize(
    'blocks',
    [
        ('bouc_wen', 'mode', 'offset'),
        ('bouc_wen_exact', 'mode', 'offset'),
        ('bouc_wen', 'autoregressive', 'offset'),
        ('gain', 'mode', 'offset'),
        ('prandtl_ishlinskii', 'mode', 'offset'),
        ('bouc_wen_exact', 'nonlinear_mode', 'offset'),
        ('amplifier_lag', 'bouc_wen_exact', 'mode', 'creep', 'offset'),
    ],
)
def test_sensitivities_equal_central_differences(blocks: tuple[str, ...]) -> None:
    model = chain(*blocks)
    start = model.defaults()
    start |= {name: value for name, value in MOVED.items() if name in start}
    p = model.pack(start)
    u = np.cumsum(np.random.default_rng(1).normal(0, 0.05, 1500))
    y, rows = sensitivities(model, p, model.parameter_names, u, DT)
    np.testing.assert_allclose(y, model.respond(u, p, DT), rtol=1e-12, atol=1e-18)
    for j, q in enumerate(model.parameters):
        name = q.name
        step = 1e-6 * max(abs(p[j]), 1e-7)
        up, down = p.copy(), p.copy()
        up[j] += step
        down[j] -= step
        expected = (model.respond(u, up, DT) - model.respond(u, down, DT)) / (2 * step)
        scale = np.max(np.abs(expected))
        if q.follows_range:
            continue
        # where it rubs the force has corners, at which one-sided differences differ
        close = 3e-4 if 'nonlinear_mode' in blocks else 1e-4
        np.testing.assert_allclose(rows[j], expected, atol=close * scale, err_msg=name)


def test_sensitivities_of_blocks_side_by_side_behind_a_lag() -> None:
    model = chain('amplifier_lag', 'bouc_wen_exact', 'mode').with_block(
        named_block('nonlocal_memory')
    )
    start = {**model.defaults(), **{f'memory{j}': 2e-6 for j in range(1, 10)}, 'lag_time': 2e-3}
    p = model.pack(start)
    u = np.cumsum(np.random.default_rng(1).normal(0, 0.05, 1500))
    y, rows = sensitivities(model, p, model.free_names, u, DT)
    np.testing.assert_allclose(y, model.respond(u, p, DT), rtol=1e-9, atol=1e-15)
    for j, name in enumerate(model.free_names):
        k = model.parameter_names.index(name)
        step = 1e-6 * max(abs(p[k]), 1e-7)
        up, down = p.copy(), p.copy()
        up[k] += step
        down[k] -= step
        expected = (model.respond(u, up, DT) - model.respond(u, down, DT)) / (2 * step)
        scale = np.max(np.abs(expected))
        np.testing.assert_allclose(rows[j], expected, atol=1e-3 * scale, err_msg=name)


def test_exact_step_sensitivities_through_zero_and_at_rest() -> None:
    """The move is split where h passes zero; the split itself depends on the parameters."""
    model = chain('bouc_wen_exact')
    u = np.array([0.0, 1.0, 1.0, 0.2, -3.0, -3.0, 4.0, 3.9, 4.5, -0.1])
    p = model.pack({'A1': 1e-4, 'A': 5e-5, 'A0': 4e-6, 'beta': 0.9, 'gamma': -0.4})
    _, rows = sensitivities(model, p, model.parameter_names, u, DT)
    for j in range(p.size):
        step = 1e-6 * abs(p[j])
        up, down = p.copy(), p.copy()
        up[j] += step
        down[j] -= step
        expected = (model.respond(u, up, DT) - model.respond(u, down, DT)) / (2 * step)
        np.testing.assert_allclose(rows[j], expected, atol=1e-8 * np.max(np.abs(expected)))


@pytest.mark.component
def test_recovers_the_family_to_two_parts_in_ten_thousand() -> None:
    result = output_error(BIMORPH, [simulated(f) for f in (1, 7, 14, 23, 35, 50)])
    assert result.converged
    assert result.warnings == ()
    for name, true in TRUTH.items():
        assert result.values[name] == pytest.approx(true, rel=2e-4), name
        assert abs(result.values[name] - true) < 5 * result.std[name], name
    assert result.noise == pytest.approx(20e-9, rel=0.03)


@pytest.mark.component
def test_deviations_are_as_large_as_the_scatter_of_repeated_fits() -> None:
    estimates = []
    for seed in range(24):
        record = simulated(23.0, seconds=4.0)
        y = record.displacement + np.random.default_rng(seed).normal(0, 200e-9, len(record))
        noisy = Record('noisy', DT, record.voltage, y, info=record.info)
        result = fit(BIMORPH, [noisy], TRUTH, free=['beta', 'natural_frequency', 'offset'])
        estimates.append([result.values[name] for name in result.free])
    spread = np.std(estimates, axis=0, ddof=1)
    stated = np.array([result.std[name] for name in result.free])
    assert np.all(stated > 0.6 * spread)
    assert np.all(stated < 1.7 * spread)
    bound = result.cramer_rao(200e-9)
    np.testing.assert_allclose(list(bound.values()), stated, rtol=0.3)


def test_the_result_does_not_depend_on_the_number_of_workers() -> None:
    records = [simulated(f, seconds=6.0) for f in (7, 14, 23)]
    one, two = (fit(BIMORPH, records, TRUTH, workers=workers) for workers in (1, 2))
    assert one.values == two.values
    assert one.std == two.std


def test_folding_gives_the_answer_of_the_whole_record() -> None:
    records = [simulated(f) for f in (14, 23)]
    folded = fit(BIMORPH, records, TRUTH)
    whole = fit(BIMORPH, records, TRUTH, folded=False)
    for name, std in whole.std.items():
        assert abs(folded.values[name] - whole.values[name]) < 4 * std, name
        assert folded.std[name] == pytest.approx(std, rel=0.35), name


def test_a_slow_block_is_never_folded() -> None:
    model = chain('bouc_wen', 'mode', 'creep', 'offset', A0=0.0)
    result = fit(model, [simulated(14.0, seconds=6.0)], TRUTH, free=['A1'], max_evaluations=3)
    assert result.targets[0].repeats == 1


def test_finds_the_period_and_leaves_out_the_transient() -> None:
    record = simulated(23.0)
    assert period_of(record) == 1000
    assert period_of(simulated(50.0)) == 20
    target, way_in = fold(record)
    assert way_in.measured.size + 1000 * target.repeats == len(record)
    assert target.repeats < 20  # the first second rings
    assert target.noise == pytest.approx(20e-9, rel=0.05)
    assert target.measured.size == 1000


@pytest.mark.parametrize(
    'voltage',
    [np.zeros(4000), np.cumsum(np.random.default_rng(0).normal(size=4000)), sine(0.3, 4.0)],
)
def test_what_does_not_repeat_is_not_folded(voltage: np.ndarray) -> None:
    record = Record('one', DT, voltage, 1e-6 * voltage)
    assert fold(record) == []
    assert targets_of([record])[0].measured.size == 4000


def test_a_drifting_record_is_not_folded() -> None:
    u = sine(10.0, 20.0)
    y = 1e-4 * u + 1e-7 * DT * np.arange(u.size)
    y += np.random.default_rng(0).normal(0, 20e-9, u.size)
    assert fold(Record('drift', DT, u, y)) == []


@pytest.mark.slow
def test_sampling_offset_is_found_and_zero_where_there_is_none() -> None:
    on_time = [simulated(f) for f in (7, 14, 23, 35)]
    late = [
        Record(r.name, DT, r.voltage[:-2], shifted(r.displacement, 0.4)[:-2], info=r.info)
        for r in on_time
    ]
    assert output_error(BIMORPH, on_time).sampling_offset == 0.0
    found = output_error(BIMORPH, late).sampling_offset
    assert found == pytest.approx(0.4 * DT, rel=0.03)


def test_the_triangle_is_that_of_the_matrix() -> None:
    rows = np.random.default_rng(0).normal(size=(5, 101))
    r = triangle(rows.copy())
    np.testing.assert_allclose(r.T @ r, rows @ rows.T, rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(np.tril(r, -1), 0.0)
    short = rows[:, :3]
    np.testing.assert_allclose(triangle(short.copy()).T @ triangle(short.copy()), short @ short.T)


def test_shifting_by_whole_samples_is_exact() -> None:
    y = np.random.default_rng(0).normal(size=30)
    np.testing.assert_array_equal(shifted(y, 1.0)[:-1], y[1:])
    np.testing.assert_array_equal(shifted(y, -1.0)[1:], y[:-1])
    np.testing.assert_array_equal(shifted(y, 0.0), y)


@pytest.mark.parametrize(
    ('model', 'expected'),
    [
        (named('classical'), {'A1', 'A', 'offset'}),
        (named('linear_mode'), {'A1', 'offset'}),
        (BIMORPH, {'A1', 'A', 'offset'}),
    ],
)
def test_finds_what_is_linear(model: Model, expected: set[str]) -> None:
    assert set(linear_parameters(model, model.free_names, 1.0)) == expected


def test_it_reports_parameters_that_are_not_distinguished() -> None:
    """A loop of tiny amplitude does not saturate: A1 - A is all that it shows."""
    model = chain('bouc_wen', 'offset', A0=0.0)
    u = 1e-4 * sine(10.0, 2.0)
    y = model.respond(u, model.pack({**model.defaults()}), DT)
    y = y + np.random.default_rng(0).normal(0, 1e-10, u.size)
    result = fit(model, [Record('tiny', DT, u, y)], free=['A1', 'A', 'offset'])
    assert result.condition > 1e3
    assert any('A1' in each and 'distinguished' in each for each in result.warnings)


def test_a_parameter_without_influence_has_no_digits() -> None:
    record = Record('still', DT, np.zeros(2000), np.random.default_rng(0).normal(0, 1e-8, 2000))
    result = fit(chain('gain', 'offset'), [record])
    assert np.isinf(result.std['A1'])
    assert any('A1 has no influence' in each for each in result.warnings)
    assert np.isfinite(result.std['offset'])


def test_an_unfinished_fit_is_reported() -> None:
    result = fit(BIMORPH, [simulated(23.0)], max_evaluations=2)
    assert not result.converged
    assert 'did not converge' in result.warnings[0]


def test_a_prior_holds_what_the_data_leave_open() -> None:
    record = simulated(1.0)
    loose = fit(BIMORPH, [record], TRUTH)
    tight = fit(BIMORPH, [record], TRUTH, priors={'natural_frequency': Prior(mean=68.0, std=1e-4)})
    assert tight.std['natural_frequency'] < 2e-4 < loose.std['natural_frequency']


def test_bounds_hold_and_are_reported() -> None:
    result = fit(BIMORPH, [simulated(23.0)], TRUTH, bounds={'offset': (7e-6, 1e-3)})
    assert result.values['offset'] == 7e-6
    assert any('offset is at its bound' in each for each in result.warnings)


def test_wrong_names_are_refused() -> None:
    with pytest.raises(IdentificationError, match='betta'):
        fit(BIMORPH, [simulated(23.0, seconds=1.0)], {'betta': 1.0})
    with pytest.raises(IdentificationError, match='at least one'):
        fit(BIMORPH, [])
    with pytest.raises(IdentificationError, match='equal or relative'):
        fit(BIMORPH, [simulated(23.0, seconds=1.0)], weights='heavy')


def test_confounded_parameters_are_named_once_together() -> None:
    names = [f'w{j}' for j in range(6)]
    alike = np.full((6, 6), 0.999)
    result = Covariance(np.full(6, 1.5), alike, 1e4, ())
    remarks = warnings_of(result, names, np.ones(6))
    assert len(remarks) == 2
    assert remarks[0].startswith('w0, w1, w2, w3, w4 and w5 can hardly be distinguished')
    assert 'smaller than their uncertainties' in remarks[1]


def test_lost_directions_that_share_a_parameter_are_one_warning() -> None:
    lost = (
        (('w2', 0.9), ('w0', 0.1)),
        (('w1', 0.5), ('w2', 0.5)),
        (('w5', 0.7), ('w4', 0.3)),
        (('w3', 1.0),),
    )
    names = [f'w{j}' for j in range(6)]
    result = Covariance(np.full(6, np.inf), np.eye(6), 1e9, lost)
    remarks = warnings_of(result, names, np.ones(6))
    assert [each.split(':')[0] for each in remarks] == [
        'w0, w1 and w2 cannot be distinguished from these records',
        'w4 and w5 cannot be distinguished from these records',
        'w3 has no influence on these records',
    ]


def test_digits_end_where_the_uncertainty_begins() -> None:
    assert digits(1.23456, 0.0123) == '1.23 ± 0.01'
    assert digits(1e-4, 1e-3) == '0 within 0.0010'
    assert digits(432.0, 129.0) == '400 ± 100'
    assert digits(8.4e-5, 7e-5) == '0.00008 ± 0.00007'
    assert digits(1.0, float('inf')) == 'not determined'


def test_a_long_warm_up_is_no_reason_to_scan_nothing() -> None:
    u = sine(5.0, 60.0)
    info = RecordInfo(warm_up=30.0)
    record = Record('late', DT, u, 1e-4 * u, info=info)
    (seen,) = representative([whole(record)])
    assert seen.measured.size > 10_000
    assert seen.pick(seen.voltage).size == seen.measured.size


@pytest.mark.component
def test_a_delay_of_what_is_held_is_found_from_ticks_away() -> None:
    model = chain('transport_delay', 'prandtl_ishlinskii', 'offset')
    u = np.concatenate([sine(f, 4.0) for f in (1.0, 7.0, 19.0)])
    truth = {**model.defaults(), 'delay': 3.5 * DT}
    y = model.respond(u, model.pack(truth), DT)
    y = y + np.random.default_rng(0).normal(0, 20e-9, u.size)
    record = Record('late', DT, u, y)
    for begin in (1.5e-3, 4.5e-3):
        result = fit(model, [record], {**truth, 'delay': begin}, sampling_offset=True)
        assert result.rms == pytest.approx(20e-9, rel=0.05)


@pytest.mark.component
@pytest.mark.parametrize(
    'names',
    [
        ('transport_delay', 'bouc_wen_exact', 'mode', 'creep', 'sensor_lag', 'offset'),
        ('amplifier_lag', 'bouc_wen_exact', 'mode', 'offset'),
        ('slew_limit', 'prandtl_ishlinskii', 'nonlinear_mode', 'gain_decay', 'creep'),
    ],
)
def test_runs_between_the_ticks_are_differentiated(names: tuple[str, ...]) -> None:
    """Against central differences of the whole chain, twice as coarse as those of the run."""
    model = Model('chain', tuple(named_block(name) for name in names))
    t = np.arange(800) * 1e-3
    voltage = np.sin(2 * np.pi * 11.0 * t) * (1 - 0.3 * t)
    values = {**model.defaults(), 'A1': 1.5e-4, 'A': 5e-5, 'delay': 1.3e-3, 'lag_time': 4e-4,
              'slew_rate': 45.0, 'mode_friction': 1e-6, 'breakaway': 1.2, 'creep_share': 0.05,
              'creep_time': 0.1, 'mode_cubic': 1e6,
              'sensor_lag_time': 7e-4, 'natural_frequency': 70.0, 'gain_loss': 0.1}  # fmt: skip
    values = {name: values[name] for name in model.parameter_names}
    free = [name for name in model.free_names if name != 'pi_range']
    y, rows = sensitivities(model, model.pack(values), free, voltage, 1e-3)
    expected = model.respond(voltage, model.pack(values), 1e-3)
    np.testing.assert_allclose(y, expected, rtol=0, atol=1e-12 * np.ptp(expected))
    for name, row in zip(free, rows, strict=True):
        q = next(q for q in model.parameters if q.name == name)
        step = 1e-5 * max(abs(values[name]), 0.1 * q.scale)
        above = model.pack({**values, name: values[name] + step}, checked=False)
        below = model.pack({**values, name: values[name] - step}, checked=False)
        difference = model.respond(voltage, above, 1e-3) - model.respond(voltage, below, 1e-3)
        difference /= 2.0 * step
        size = np.abs(difference).max()
        np.testing.assert_allclose(row, difference, atol=2e-3 * size + 1e-16, err_msg=name)


def test_a_delay_is_found_across_a_step_that_moves_by_whole_ticks() -> None:
    """Each tick of delay error moves one large residual, on one side of the step only."""
    model, dt = chain('transport_delay', 'bouc_wen', 'offset', A0=0.0), 2e-4
    t = dt * np.arange(6000)
    voltage = np.where(t < 0.3, 0.0, -np.cos(2 * np.pi * 2.0 * (t - 0.3)))
    truth = {**model.defaults(), 'delay': 4e-3}
    displacement = model.respond(voltage, model.pack(truth), dt)
    # read before the voltage of the tick acts
    seen = np.concatenate([[displacement[0]], displacement[:-1]])
    record = Record('step', dt, voltage, seen)
    found = fit(model, [record], {**truth, 'delay': 5e-3}, free=('delay',))
    assert found.values['delay'] == pytest.approx(4e-3, abs=dt)


def test_start_values_keep_an_offset_that_zeros_of_the_records_determine() -> None:
    """Its derivative is a zero of the record: only rounding of it is left, no direction."""
    records = [simulated(f) for f in (1, 7, 14)]
    model = suited(BIMORPH, records)
    targets = [replace(target, own_zero=True) for target in targets_of(records)]
    for start in starts(model, targets, model.free_names, count=4):
        assert abs(start.values['offset']) < 1e-9


@pytest.mark.component
def test_the_scan_sees_the_record_that_shows_the_mode() -> None:
    """The sines fold, the multisine does not: one of its lines lies on a narrow resonance."""
    model, rng = named('bouc_wen_mode'), np.random.default_rng(1)
    truth = {**model.defaults(), **TRUTH, 'natural_frequency': 71.3, 'damping_ratio': 0.01}
    time = DT * np.arange(4000)
    lines = 71.2 * 1.232 ** np.arange(-14.0, 5.0)
    drives = {
        'many': 0.05 * np.sin(2 * np.pi * lines * time[:, None] + lines**2).sum(axis=1),
        'slow': 0.8 * np.sin(2 * np.pi * 2.0 * time),
        'small': 0.4 * np.sin(2 * np.pi * 4.0 * time),
    }
    records = [
        Record(name, DT, u, model.respond(u, model.pack(truth), DT) + noise)
        for name, u in drives.items()
        for noise in [1e-8 * rng.standard_normal(u.size)]
    ]
    targets = targets_of(records)
    assert {t.name for t in targets if t.repeats > 1} == {'slow', 'small'}
    few = representative(targets)
    assert [t.name for t in few if '(' not in t.name] == ['slow', 'small', 'many']
    assert np.min(np.abs(resonant_lines(few) - 71.3)) < 0.3
    best = starts(model, few, model.free_names, count=1)[0]
    assert best.values['natural_frequency'] == pytest.approx(71.3, rel=0.01)


@pytest.mark.parametrize('zero', ['record', 'common'])
def test_the_zero_of_a_model_is_that_of_its_records(zero: str) -> None:
    """One zero per record determines none of the model, but a compensator uses it."""
    model = named('prandtl_ishlinskii')
    truth = {**model.defaults(), 'w0': 2e-7, 'w3': 5e-8, 'offset': 40e-6}
    time = DT * np.arange(2000)
    records = [
        Record(f'{f:g} Hz', DT, u, model.respond(u, model.pack(truth), DT) + shift)
        for f, shift in ((2.0, 1e-7), (3.0, -1e-7))
        for u in [np.sin(2 * np.pi * f * time)]
    ]
    found = identify(records, 'prandtl_ishlinskii', zero=zero)
    assert found.values['offset'] == pytest.approx(40e-6, abs=2e-7)
