"""A transfer function from records, and what H-infinity makes of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy import signal

from piezo_hysteresis.cli.main import main
from piezo_hysteresis.compensation.feedback.feedback_link import HInfinityWeights
from piezo_hysteresis.compensation.feedback.hinf import design, transfer_function
from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.identification.arx import TransferFunction, fit_transfer_function
from piezo_hysteresis.records import Record, write_csv

# Xiao 2014 (4), from volt to metre.
TOP, BOTTOM = np.array([1.135, 35.77]), np.array([1.0, 3960.0, 5.046e6, 1.452e8])
DT = 1e-4


def record(noise: float = 0.0, seed: int = 0) -> Record:
    rng = np.random.default_rng(seed)
    u = np.concatenate([np.zeros(50), np.repeat(rng.uniform(-5, 5, 60), 50)])
    a, b, c, _, _ = signal.cont2discrete(signal.tf2ss(TOP, BOTTOM), DT)
    state, y = np.zeros(3), np.zeros(u.size)
    for k in range(u.size):
        y[k] = c[0] @ state
        state = a @ state + b[:, 0] * u[k]
    return Record('steps', DT, u, y + rng.normal(0, noise, u.size) if noise else y)


@pytest.mark.component
def test_recovers_poles_and_zeros_exactly_without_noise() -> None:
    found = fit_transfer_function([record()])
    np.testing.assert_allclose(found.numerator, TOP, rtol=1e-6)
    np.testing.assert_allclose(found.denominator, BOTTOM, rtol=1e-6)
    plain = fit_transfer_function([record()], rounds=0)
    np.testing.assert_allclose(plain.denominator, BOTTOM, rtol=0.02)


@pytest.mark.component
def test_recovers_003_from_noise_of_its_sensor() -> None:
    found = fit_transfer_function([record(1e-9, 1), record(1e-9, 2)])
    np.testing.assert_allclose(found.numerator, TOP, rtol=0.03)
    np.testing.assert_allclose(found.denominator, BOTTOM, rtol=0.03)
    assert found.gain == pytest.approx(TOP[-1] / BOTTOM[-1], rel=0.005)
    assert found.nrmse_percent < 0.3


@pytest.mark.component
def test_the_verb_writes_what_the_design_reads(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data, out = tmp_path / 'steps.csv', tmp_path / 'plant.yaml'
    write_csv(data, record(), unit='m')
    assert main(['linear', str(data), '--out', str(out)]) == 0
    assert 'pole -29.' in capsys.readouterr().out
    found = TransferFunction.load(out)
    plant = transfer_function(found.numerator, found.denominator)
    own = design(plant, HInfinityWeights(20.0), DT)
    known = design(transfer_function(TOP.tolist(), BOTTOM.tolist()), HInfinityWeights(20.0), DT)
    assert own.gamma == pytest.approx(known.gamma, rel=1e-3)


def test_refuses_what_is_no_linear_system(tmp_path: Path) -> None:
    for poles, zeros in ((0, 0), (2, 2), (9, 1)):
        with pytest.raises(IdentificationError, match='fewer zeros'):
            fit_transfer_function([record()], poles, zeros)
    still = Record('still', DT, np.zeros(500), np.zeros(500))
    with pytest.raises(IdentificationError, match='does not move'):
        fit_transfer_function([still])
    path = tmp_path / 'other.yaml'
    path.write_text('numerator: nothing')
    with pytest.raises(IdentificationError, match='no transfer function'):
        TransferFunction.load(path)
