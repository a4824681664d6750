"""One file of parameters gives the same voltages as nodes, in a study and as a C library."""

from __future__ import annotations

import ctypes
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.common import plain_yaml
from piezo_hysteresis.compensation.controllers import Controllers
from piezo_hysteresis.compensation.limiter import EnergyLimits, Limiter
from piezo_hysteresis.compensation.link import Measured
from piezo_hysteresis.compensation.offline_loop import LoopResult, reference_points
from piezo_hysteresis.compensation.study import track
from piezo_hysteresis.export.library import Drive, Request, files_of
from piezo_hysteresis.models import ModelFile, named
from piezo_hysteresis.parameters.links import ATTENUATION, FEEDBACK, FEEDFORWARD
from piezo_hysteresis.runtime.laws import (
    FeedbackLaws,
    HarmonicLaws,
    Inversion,
    chain_settings,
    forward_settings,
)
from piezo_hysteresis.waveforms import Sine

DT, TICKS = 1e-3, 1500
WAVE = Sine(6e-5, 11.0, TICKS * DT, ramp=0.2)
TIME = np.arange(TICKS, dtype=np.float64) * DT
FILE = """
feedforward: &limits {limits.low: -0.9, limits.high: 1.0, limits.slew: 500.0, start: 0.1}
attenuation: {<<: *limits, orders: [0, 1, 3], settle: 0.3, plant.gain: 1.15e-4,
  plant.natural_frequency: 68.0, plant.damping_ratio: 0.015}
feedback: {<<: *limits, plant.gain: 1.15e-4, plant.natural_frequency: 68.0,
  plant.damping_ratio: 0.015}
"""
METHODS = {
    'pid': {'pid.integral': 2000.0, 'pid.derivative': 1.0},
    'fuzzy_pid': {'pid.integral': 2000.0, 'fuzzy.error_scale': 2e-6},
    'h_infinity': {'h_infinity.bandwidth': 5.0},
}
TABLES = {'feedforward': FEEDFORWARD, 'attenuation': ATTENUATION, 'feedback': FEEDBACK}
MODEL = named('bouc_wen_mode')


def parameters(method: str) -> dict[str, dict[str, Any]]:
    """Return what the file says of each node, with the defaults of the rest."""
    content = plain_yaml.load(FILE)
    content['feedback'] |= {'method': method, **METHODS[method]}
    return {node: {**table.defaults(), **content[node]} for node, table in TABLES.items()}


def inverted() -> ModelFile:
    return ModelFile(MODEL, {**MODEL.defaults(), 'natural_frequency': 68.0})


def settings(values: dict[str, dict[str, Any]]) -> Controllers:
    """Return the one settings object of the file."""
    return chain_settings(values, DT, inverted())


def studied(method: str) -> LoopResult:
    """Return the run of a study with attenuation and feedback."""
    chain = settings(parameters(method))
    plant = ModelFile(MODEL, {**inverted().values, 'A': 3e-5, 'natural_frequency': 66.0})
    limits = chain.limits
    _, runs = track(
        chain, plant, WAVE, low=limits.low, high=limits.high, slew=limits.slew, together=True
    )
    assert runs[-1].name == 'with both'
    return runs[-1].result


@pytest.mark.component
@pytest.mark.parametrize('method', METHODS)
def test_laws_of_nodes_give_the_bits_of_a_study(method: str) -> None:
    run, values = studied(method), parameters(method)
    inversion = Inversion(forward_settings(values['feedforward'], DT))
    inversion.take(inverted())
    laws = (
        HarmonicLaws().build(values['attenuation'], DT),
        FeedbackLaws().build(values['feedback'], DT),
    )
    limiter, answers = Limiter(settings(values).limits, DT), np.empty(TICKS)
    measured = None
    for k, point in enumerate(reference_points(WAVE.sample(TIME))):
        voltage = inversion.voltage(point)
        assert voltage is not None
        for law in laws:
            assert law is not None
            voltage = law.step(point, voltage, measured)
        answers[k] = limiter.apply(voltage)
        measured = Measured(k, answers[k], float(run.displacement[k]))
    np.testing.assert_array_equal(answers, run.voltage)
    assert np.ptp(run.link_voltages[1] - run.link_voltages[0]) > 1e-3
    assert np.ptp(run.link_voltages[2] - run.link_voltages[1]) > 1e-4


@pytest.mark.slow
@pytest.mark.parametrize('method', METHODS)
def test_an_exported_library_gives_the_bits_of_a_study(method: str, tmp_path: Path) -> None:
    run, chain = studied(method), settings(parameters(method))
    loaded, limits = inverted(), chain.limits
    asked = Request(
        'piezo', loaded, lambda: chain.links(by_mode=True), limits,
        EnergyLimits(0.0, 1e-6, 1.0, limits.high - limits.low), DT, 'x86_64-linux',
        Drive(11.0, 5e-5, 0.0, 1e-4, 0.0),
    )  # fmt: skip
    for name, content in files_of(asked).items():
        (tmp_path / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    whole = ('-Wl,--whole-archive', 'libpiezo.a', '-Wl,--no-whole-archive', '-lm')
    subprocess.run(['gcc', '-shared', '-o', 'piezo.so', *whole], check=True, cwd=tmp_path)
    np.testing.assert_array_equal(answered(tmp_path / 'piezo.so', run), run.voltage)


def answered(path: Path, run: LoopResult) -> FloatArray:
    """Return the voltages of a library for the reference and the measurements of a run."""
    library = ctypes.CDLL(str(path))
    memory, numbers = (ctypes.c_double * 100_000)(), (ctypes.c_double * 1000)()
    given, voltage = (ctypes.c_double * 7)(), ctypes.c_double()
    assert library.piezo_defaults(numbers) == 0
    assert library.piezo_init(memory, numbers) == 0
    answers, last = np.empty(TICKS), 0.0
    for k, point in enumerate(reference_points(WAVE.sample(TIME))):
        given[:] = [*point[1:], last, 1.0]
        assert library.piezo_step(memory, given, ctypes.byref(voltage)) >= 0
        answers[k], last = voltage.value, float(run.displacement[k])
    return answers
