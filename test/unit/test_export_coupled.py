"""The loop of several axes as a C library: the bits of the laws in Python, and its limits."""

from __future__ import annotations

import ctypes
import math
import subprocess
from pathlib import Path

import numpy as np
import pytest

from piezo_hysteresis.axes import modal_file
from piezo_hysteresis.axes.modal_model import ModalLayout, ModalModel
from piezo_hysteresis.cli.main import main
from piezo_hysteresis.compensation.coupled.axes_chain import AxesChain, axes_chain
from piezo_hysteresis.compensation.coupled.matrix_settings import MatrixSettings
from piezo_hysteresis.compensation.limiter import Limiter
from piezo_hysteresis.compensation.link import Limits, Measured, ReferencePoint
from piezo_hysteresis.export.compensator import compensator_doors
from piezo_hysteresis.export.coupled_library import coupled_component
from piezo_hysteresis.export.native import object_code

pytestmark = pytest.mark.slow

RATE, MICRO, MARK = 4000.0, 1e-6, 7.0
LIMITS = Limits(-20.0, 25.0, 1e5)


def model(axes: int) -> ModalModel:
    """Return axes with hysteresis of voltage and elongation, products, and a late sensor."""
    layout = ModalLayout(axes, axes, axes, (0.3, 1.0), (3,), (0.5,), products=True)
    vector = layout.zeros()
    found = layout.named(vector)
    found['log_omega'][:] = np.log(2.0 * np.pi * np.linspace(310.0, 520.0, axes))
    found['log_damping'][:] = np.log(0.02)
    found['shape'][...] = np.eye(axes) + 0.1 * np.eye(axes, k=1) - 0.1 * np.eye(axes, k=-1)
    found['delay'][0] = 1.5 / RATE
    found['voltage_weights'][:2] = 0.1
    found['voltage_weights'][2] = 1e-3
    found['elongation_weights'][...] = 0.05
    found['square'][...] = 1e-3
    rng = np.random.default_rng(axes)
    output = 1e-9 * rng.standard_normal((len(layout.signal_names), axes))
    output[:axes] = MICRO * (np.eye(axes) + 0.1 * rng.standard_normal((axes, axes)))
    output[axes : 2 * axes] = 0.0
    return ModalModel(layout, vector, output, 3.0, 1.0 / RATE)


def test_the_command_writes_a_library_whose_own_test_finds_the_same_bits(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, out = tmp_path / 'model.yaml', tmp_path / 'lib'
    modal_file.save(model(2), file)
    words = ['export', str(file), '--out', str(out), '--name', 'stage']
    assert main(words) == 2
    assert '--limits LOW HIGH SLEW' in capsys.readouterr().err
    words += ['--limits', '-20', '25', '1e5']
    assert main([*words, '--rate', '1000']) == 2
    assert main([*words, '--set', 'feedback.method=pid']) == 2
    assert main(words) == 0
    subprocess.run(['make', '-C', str(out), 'selftest'], check=True, capture_output=True)
    done = subprocess.run(
        [out / 'selftest', '--exact'], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout
    assert '4000 of 4000 ticks have the same bits' in done.stdout


def at(array: np.ndarray) -> ctypes.c_void_p:
    return array.ctypes.data_as(ctypes.c_void_p)


def built(chain: AxesChain, axes: int, folder: Path) -> tuple[ctypes.CDLL, int]:
    part = coupled_component(chain, [LIMITS] * axes, MARK)
    (folder / 'all.o').write_bytes(
        object_code(compensator_doors('piezo', part, axes), 'x86_64-linux')
    )
    files = [str(folder / 'all.so'), str(folder / 'all.o')]
    subprocess.run(['gcc', '-shared', '-o', *files, '-lm'], check=True, capture_output=True)
    return ctypes.CDLL(files[0]), part.size


@pytest.mark.parametrize(('axes', 'attenuated'), [(2, True), (3, True), (2, False)])
def test_references_lost_sensors_and_changed_frequencies_have_the_same_bits(
    tmp_path: Path, axes: int, attenuated: bool
) -> None:
    settings = MatrixSettings(orders=(0, 1, 2, 3)) if attenuated else None
    limits = [LIMITS] * axes
    chain = axes_chain(model(axes), limits, settings, RATE)
    library, size = built(axes_chain(model(axes), limits, settings, RATE), axes, tmp_path)
    fields = np.zeros(3 * axes + 2 * attenuated)
    state = np.zeros(size)
    library.piezo_defaults(at(fields))
    assert library.piezo_init(at(state), at(fields)) == 0

    rng = np.random.default_rng(axes)
    limiters = [Limiter(each, 1.0 / RATE) for each in limits]
    phase, u, y = np.zeros(axes), np.zeros(axes), np.full(axes, np.nan)
    answer, largest = np.zeros(axes), 0.0
    for k in range(6000):
        frequency = (20.0 + 7.0 * np.arange(axes)) * (1.0 if k < 4000 else 1.3)
        omega = 2.0 * np.pi * frequency
        size_of = 2.0 * MICRO * min(1.0, k / 400.0)
        columns = [
            size_of * np.sin(phase), size_of * omega * np.cos(phase),
            -size_of * omega**2 * np.sin(phase), frequency, phase,
        ]  # fmt: skip
        rows = np.stack([*columns, y, np.ones(axes)], 1)
        points = [ReferencePoint(k, *(float(v) for v in row[:5])) for row in rows]
        read = [Measured(k - 1, float(u[i]), float(y[i])) for i in range(axes)]
        asked = chain.step(points, read if k else [None] * axes)
        expected = [each.apply(v) for each, v in zip(limiters, asked, strict=True)]
        code = library.piezo_step(at(state), at(np.ascontiguousarray(rows)), at(answer))
        assert code in (0, 2, 4, 8, 10, 12)
        assert answer.tolist() == expected
        u = np.array(expected)
        y = MICRO * (u + 0.1 * np.roll(u, 1) + 1e-3 * u**2) + 1e-9 * rng.standard_normal(axes)
        if 2000 <= k < 2050:
            y[0] = math.nan
        phase = phase + omega / RATE
        largest = max(largest, float(np.abs(u).max()))
    assert largest > 1.0
    if chain.attenuation is not None:
        assert np.abs(chain.attenuation.lines).max() > 1e-3
