"""Records of several axes: what they hold, and what they refuse."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from piezo_hysteresis.axes.axes_record import AxesRecord
from piezo_hysteresis.errors import RecordError

RANDOM = np.random.default_rng(3)
U = RANDOM.normal(size=(60, 3))
Y = 1e-6 * RANDOM.normal(size=(60, 2))


def test_a_record_knows_its_channels_and_gives_one_pair_as_an_ordinary_record() -> None:
    record = AxesRecord('r', 1e-3, U, Y)
    assert (record.axes, record.outputs, len(record), record.rate) == (3, 2, 60, 1000.0)
    pair = record.axis(2, 1)
    np.testing.assert_array_equal(pair.voltage, U[:, 2])
    np.testing.assert_array_equal(pair.displacement, Y[:, 1])
    assert (pair.name, pair.dt) == ('r/axis_3_to_2', 1e-3)
    with pytest.raises(RecordError, match='no pair of input 2 and output 2'):
        record.axis(2)


def test_the_mean_of_the_periods_and_the_noise_of_one() -> None:
    clean = RANDOM.normal(size=(2000, 2))
    size = np.array([0.1, 0.3])
    noisy = np.concatenate([clean + size * RANDOM.normal(size=clean.shape) for _ in range(4)])
    record = AxesRecord('r', 1e-3, np.tile(clean, (4, 1)), noisy, periods=4)
    noise = record.noise
    assert noise is not None
    np.testing.assert_allclose(noise, size, rtol=0.05)
    mean = record.mean_period()
    assert (mean.periods, len(mean), mean.noise) == (1, 2000, None)
    left = np.std(mean.displacement - clean, axis=0)
    np.testing.assert_allclose(left, size / 2, rtol=0.08)


def test_a_section_of_whole_periods_keeps_its_steady_state() -> None:
    record = AxesRecord('r', 1e-3, np.tile(U[:20], (3, 1)), Y, periods=3)
    assert record.section(20, 60).periods == 2
    assert record.section(5, 25).periods == 1  # from anywhere within a steady state
    assert record.section(0, 30).periods == 0
    assert AxesRecord('r', 1e-3, U, Y).section(0, 20).periods == 0
    assert record.axis(0).info.start == 'settled'


def _with_a_gap() -> Any:
    gap = Y.copy()
    gap[7, 1] = np.nan
    return gap


@pytest.mark.parametrize(
    ('changed', 'words'),
    [
        ({'dt': 0.0}, 'sampling interval must be a positive'),
        ({'dt': 'fast'}, 'sampling interval must be a positive'),
        ({'voltage': U[:, 0]}, r'voltage must have the shape \(samples, axes\), got \(60,\)'),
        ({'voltage': np.zeros((60, 0))}, r'got \(60, 0\)'),
        ({'displacement': Y[:50]}, '50 samples but the voltages 60'),
        ({'displacement': _with_a_gap()}, 'first at sample 7 of axis 2'),
        ({'displacement': [['a']]}, 'array of numbers'),
        ({'periods': 7}, '60 samples are not 7 whole periods'),
        (
            {'periods': 3},
            r'the voltages of its 3 periods differ by 0\.\d+ V RMS; state the number',
        ),
        ({'periods': -1}, 'whole number from 0 on'),
    ],
)
def test_what_is_no_record_is_refused_in_one_sentence(changed: Any, words: str) -> None:
    good: dict[str, Any] = {'dt': 1e-3, 'voltage': U, 'displacement': Y}
    with pytest.raises(RecordError, match=words) as caught:
        AxesRecord('r', **{**good, **changed})
    assert str(caught.value).count('\n') == 0
    assert str(caught.value).startswith('record r: ')
