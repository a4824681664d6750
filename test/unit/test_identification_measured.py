"""Measured and public benchmark data; skipped where they are not there."""

from pathlib import Path

import numpy as np
import pytest

from piezo_hysteresis.blocks import named_block
from piezo_hysteresis.identification import fit, identify, output_error, targets_of
from piezo_hysteresis.identification.initial_conditions.record_start import preceded
from piezo_hysteresis.identification.output_error import suited
from piezo_hysteresis.identification.prediction import predictions
from piezo_hysteresis.models import named
from piezo_hysteresis.records import load

DATA = Path(__file__).parents[3] / 'shared' / 'data'
MEASURED = DATA / 'piezo_150v_1hz' / 'piezo_150V_1Hz.csv'
BENCHMARK = DATA / 'boucwen_benchmark' / 'train_multisine.csv'


@pytest.mark.skipif(not MEASURED.exists(), reason=f'{MEASURED.name} is not beside the repository')
def test_measured_actuator_is_predicted_beyond_what_was_fitted() -> None:
    """Fitted on the first 7 s (rest, step, virgin curve, 2.7 periods), judged on the last 3 s.

    In multiples of the range (39.4 um) a published equation reaches 0.233 % on all of it; the
    sensor noise alone is 0.12 %.
    """
    model = named('prandtl_ishlinskii')
    for block in ('mode', 'creep'):
        model = model.with_block(named_block(block))
    (whole,) = load([MEASURED])
    record = preceded(whole, [150.0, -150.0, 20.0])
    cut = len(record) - 15_000
    known = record.section(0, cut)
    start = suited(model, [known]).defaults() | {
        'natural_frequency': 956.0,
        'damping_ratio': 0.05,
        'creep_share': 0.02,
        'creep_time': 0.1,
    }
    result = fit(suited(model, [known]), [known], start, folded=False, sampling_offset=True)
    assert result.converged
    views = targets_of([record], folded=False)
    (run,) = predictions(result.model, result.values, views, result.sampling_offset)
    error = record.displacement - run.displacement
    span = np.ptp(whole.displacement)
    assert 100 * np.sqrt(np.mean(error[cut:] ** 2)) / span < 0.23
    assert 100 * np.sqrt(np.mean(error[record.warm_up_samples :] ** 2)) / span < 0.23
    assert result.values['natural_frequency'] == pytest.approx(956, abs=10)


@pytest.mark.slow
@pytest.mark.skipif(not BENCHMARK.exists(), reason=f'{BENCHMARK.name} is not there')
def test_benchmark_parameters_from_the_training_record() -> None:
    """Truth: m 2, c 10, k = alpha = 5e4, 800, -1100; the tests of the benchmark stay unseen."""
    (record,) = load([BENCHMARK])
    found = identify([record], named('bouc_wen_oscillator'), sampling_offset=False)
    truth = {
        'mass': 2.0,
        'damping': 10.0,
        'stiffness': 5e4,
        'z_alpha': 5e4,
        'z_beta': 800.0,
        'z_gamma': -1100.0,
    }
    assert found.converged
    for name, true in truth.items():
        assert abs(found.values[name] - true) < 4 * found.std[name], name
        assert found.std[name] < 5e-3 * abs(true), name
    (target,) = targets_of([record])
    assert target.repeats == 5


@pytest.mark.slow
@pytest.mark.skipif(not MEASURED.exists(), reason=f'{MEASURED.name} is not beside the repository')
def test_a_single_record_is_reported_not_to_determine_the_shape() -> None:
    (record,) = load([MEASURED])
    result = output_error(named('bouc_wen_mode'), [record], count=2, max_evaluations=60)
    assert any('distinguished' in each for each in result.warnings)
