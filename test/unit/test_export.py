"""A model becomes a C library that stands alone, keeps its limits, and changes like the nodes."""

from __future__ import annotations

import ctypes
import os
import re
import shutil
import subprocess
from pathlib import Path
from subprocess import CompletedProcess
from typing import Any

import numpy as np
import pytest

from piezo_hysteresis.cli.main import main
from piezo_hysteresis.compensation.feedback.pid import Pid, PidGains
from piezo_hysteresis.compensation.inverses.inverse_choice import inverse_for
from piezo_hysteresis.compensation.link import Limits, Measured, ReferencePoint
from piezo_hysteresis.models import Model, ModelFile, named
from piezo_hysteresis.models.modelfile import Provenance

pytestmark = pytest.mark.slow

RATE = 20000.0
LIMITS = Limits(-1.2, 1.2, 2000.0)
GAINS = (100.0, 3e4, 1.0)
CROSS = 'aarch64-linux-gnu-gcc'


def saved(
    folder: Path, name: str | Model = 'bouc_wen_mode', rate: float | None = None, **changes: float
) -> Path:
    model = name if isinstance(name, Model) else named(name)
    values = {**model.defaults(), **changes}
    path = folder / 'model.yaml'
    ModelFile(model, values, provenance=Provenance(rate=rate)).save(path)
    return path


@pytest.fixture(scope='module')
def exported(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Export the model of the demo with everything on, once."""
    folder = tmp_path_factory.mktemp('export')
    out = folder / 'lib'
    model = saved(folder, natural_frequency=68.0)
    words = [
        'export',
        model,
        '--out',
        out,
        '--rate',
        RATE,
        '--set',
        'attenuation.orders=[0,1,2,3,5]',
    ]
    words += ['feedback.method=pid', 'feedback.pid.proportional=100', 'feedback.pid.derivative=1']
    assert main([str(word) for word in words]) == 0
    return out


def make(folder: Any, *words: str, **environment: str) -> CompletedProcess[str]:
    return subprocess.run(
        ['make', '-C', folder, *words],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, **environment},
    )


@pytest.fixture(scope='module')
def loaded(exported: Path) -> Any:
    """Load the library into this process."""
    shared = exported.parent / 'piezo.so'
    whole = ('-Wl,--whole-archive', exported / 'libpiezo.a', '-Wl,--no-whole-archive')
    subprocess.run(['gcc', '-shared', '-o', shared, *whole, '-lm'], check=True)
    return ctypes.CDLL(str(shared))


class Loop:
    """The functions and numbers of the library, by the names in its header."""

    def __init__(self, library: Any, header: Any, name: str = 'piezo') -> None:
        text = header.read_text()
        (struct,) = re.findall(rf'typedef struct {{([^}}]*)}} {name}_parameters;', text)
        self.names = re.findall(r'double (\w+);', struct)
        (rows,) = re.findall(rf'typedef struct {{([^}}]*)}} {name}_state;', text)
        self.memory = np.full(sum(map(int, re.findall(r'\[(\d+)\];', rows))), np.nan)
        self.numbers, self.voltage = np.zeros(len(self.names)), np.zeros(1)
        self._library, self._name = library, name
        self.call('defaults', self.numbers)

    def call(self, function: str, *arrays: np.ndarray) -> Any:
        return getattr(self._library, f'{self._name}_{function}')(
            *(each.ctypes.data_as(ctypes.c_void_p) for each in arrays)
        )

    def begin(self) -> Any:
        return self.call('init', self.memory, self.numbers)

    def change(self, **values: Any) -> Any:
        numbers = self.numbers.copy()
        for name, value in values.items():
            numbers[self.names.index(name)] = value
        code = self.call('set', self.memory, numbers)
        if code == 0:
            self.numbers = numbers
        return code

    def step(self, *row: Any, measured: Any = 0.0, age: Any = 1.0) -> Any:
        code = self.call('step', self.memory, np.array([*row, measured, age]), self.voltage)
        return code, float(self.voltage[0])


@pytest.fixture
def loop(loaded: Any, exported: Path) -> Loop:
    return Loop(loaded, exported / 'piezo.h')


def reference(k: int) -> Any:
    phase = 2 * np.pi * 23.0 * k / RATE
    omega = 2 * np.pi * 23.0
    d, v = 1e-4 * np.sin(phase), 1e-4 * omega * np.cos(phase)
    return d, v, -d * omega**2, 23.0, phase


def test_the_library_passes_its_own_test_and_tracks_the_plant(exported: Path) -> None:
    built = make(exported, 'selftest', 'example', CFLAGS='-Wall -Wextra -Werror -pedantic')
    assert built.returncode == 0, built.stderr
    # nothing is on the path: no Python, no shell
    test = subprocess.run(
        [exported / 'selftest', '--exact'], env={'PATH': ''}, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert test.returncode == 0, test.stdout
    assert 'self-test passed' in test.stdout
    run = make(exported, 'run')
    assert run.returncode == 0, run.stderr
    none, forward, both = (float(each) for each in re.findall(r'([\d.]+) um', run.stdout))
    assert none > 20.0
    assert 0.1 < forward < 0.1 * none
    assert both < 0.1 * forward


def test_nothing_is_needed_but_the_mathematical_functions(exported: Path) -> None:
    listed = subprocess.run(
        ['nm', exported / 'libpiezo.a'], capture_output=True, text=True, check=True
    ).stdout
    needed = set(re.findall(r' U (\w+)', listed))
    assert needed <= {
        'cosh', 'exp', 'expm1', 'floor', 'hypot', 'log1p', 'memcpy', 'memset', 'rint', 'round',
        'sincos', 'sin', 'cos', 'sinh', 'sqrt', 'ceil', 'pow', 'fmod',
    }  # fmt: skip
    defined = set(re.findall(r' T (\w+)', listed))
    parts = ('step', 'defaults', 'init', 'set', 'reset')
    assert defined == {f'{n}_{p}' for n in ('piezo', 'piezo_plant') for p in parts}
    assert b'site-packages' not in (exported / 'libpiezo.a').read_bytes()


def test_cmake_builds_and_tests_it(exported: Path, tmp_path: Any) -> None:
    for words in (['-S', exported, '-B', tmp_path], ['--build', tmp_path]):
        subprocess.run(['cmake', *words], check=True, capture_output=True)
    subprocess.run(['ctest', '--test-dir', tmp_path], check=True, capture_output=True)


def test_the_header_is_cpp_too(exported: Path, tmp_path: Path) -> None:
    (tmp_path / 'all.cpp').write_text(
        '#include "piezo.h"\nint main() { return PIEZO_RATE < 0; }\n'
    )
    subprocess.run(
        ['g++', '-Wall', '-Werror', '-I', exported, '-o', tmp_path / 'all', tmp_path / 'all.cpp'],
        check=True,
    )


@pytest.mark.skipif(
    not (shutil.which('qemu-aarch64') and shutil.which(CROSS)),
    reason='qemu-user or the compiler for aarch64 is not installed',
)
def test_the_same_on_aarch64(tmp_path: Path) -> None:
    out = tmp_path / 'lib'
    words = [saved(tmp_path), '--out', out, '--rate', RATE, '--set', 'attenuation.enabled=false']
    words += ['--target', 'aarch64-linux']
    assert main(['export', *map(str, words)]) == 0
    done = make(out, 'test', f'CC={CROSS} -static', 'RUN=qemu-aarch64')
    assert done.returncode == 0, done.stdout + done.stderr


def test_parameters_change_as_those_of_the_links_do(loop: Loop) -> None:
    model = named('bouc_wen_mode')
    values = {**model.defaults(), 'natural_frequency': 68.0}
    inverse = inverse_for(model, values, 1.0 / RATE, limits=LIMITS)
    pid = Pid(PidGains(*GAINS), 1.0 / RATE, limits=LIMITS)
    loop.numbers[loop.names.index('attenuation_on')] = 0.0
    loop.numbers[loop.names.index('start')] = 0.5
    assert loop.begin() == 0
    measured, given = None, 0.0
    for k in range(2000):
        if k == 500:
            inverse.set_parameters({'A': 3.5e-5, 'natural_frequency': 70.0, 'offset': 1e-6})
            pid.set_gains(PidGains(50.0, 1e4, 0.5))
            changed = loop.change(
                A=3.5e-5, natural_frequency=70.0, offset=1e-6, pid_proportional=50.0,
                pid_integral=1e4, pid_derivative=0.5,
            )  # fmt: skip
            assert changed == 0
        row = reference(k)
        point = ReferencePoint(k, *row)
        expected = pid.step(point, inverse.step(point, 0.0, measured), measured)
        reading = 1e-6 * np.sin(0.01 * k)
        code, voltage = loop.step(*row, measured=given, age=1.0)
        assert (code, voltage) == (0, expected)
        measured, given = Measured(k, expected, reading), reading


def test_links_are_switched_without_a_jump(loop: Loop) -> None:
    assert loop.begin() == 0
    voltages = []
    for k in range(12000):
        if k == 3000:
            assert loop.change(attenuation_on=0.0, feedback_on=0.0) == 0
        if k == 6000:
            assert loop.change(attenuation_on=1.0, feedback_on=1.0) == 0
        voltages.append(loop.step(*reference(k), measured=1e-6)[1])
    jumps = np.abs(np.diff(voltages, 2))
    assert jumps[2990:6100].max() < 1e-4  # V; a hard switch makes some mV


def test_what_is_impossible_is_refused_and_changes_nothing(loop: Loop) -> None:
    assert loop.step(*reference(0))[0] == -2
    assert loop.change() == -2
    assert loop.begin() == 0
    before = loop.memory.copy()
    place = loop.names.index
    assert loop.change(limits_low=2.0) == -3
    assert loop.change(A=1.6e-4) == loop.change(A1=-1e-4) == -3  # no inverse
    assert loop.change(pid_integral=np.nan) == -100 - place('pid_integral')
    assert loop.change(attenuation_step_size=0.0) == -100 - place('attenuation_step_size')
    np.testing.assert_array_equal(loop.memory, before)


def test_values_that_are_not_finite_give_a_safe_voltage_and_a_status(loop: Loop) -> None:
    assert loop.begin() == 0
    for k in range(300):
        code, last = loop.step(*reference(k), measured=1e-7)
    assert code == 0
    code, voltage = loop.step(np.nan, 0.0, 0.0, 23.0, 0.0, measured=1e-7)
    assert code & 1
    assert abs(voltage - last) <= LIMITS.slew / RATE + 1e-12
    code, voltage = loop.step(*reference(301), measured=np.inf)
    assert code & 2
    seen = 0
    for k in range(302, 9000):
        code, voltage = loop.step(1e-3, 0.0, 0.0, 0.0, 0.0, measured=1e-9 * k)
        assert LIMITS.low <= voltage <= LIMITS.high
        seen |= code
    assert voltage == LIMITS.high
    assert seen & 8


def test_states_are_independent_and_reset_clears_them(
    loop: Loop, loaded: Any, exported: Path
) -> None:
    other = Loop(loaded, exported / 'piezo.h')
    assert loop.begin() == other.begin() == 0
    first = [loop.step(*reference(k), measured=1e-7)[1] for k in range(500)]
    [other.step(*reference(k), measured=-5e-6) for k in range(700)]
    assert other.call('reset', other.memory) == 0
    assert [other.step(*reference(k), measured=1e-7)[1] for k in range(500)] == first


def refused(capsys: Any, *words: Any) -> Any:
    assert main(['export', *map(str, words)]) == 2
    printed = capsys.readouterr().err.strip()
    assert printed.startswith('error: ')
    assert len(printed.splitlines()) == 1
    return printed


def test_bad_input_is_one_line_and_nothing_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / 'out'
    path = saved(tmp_path)
    assert 'aarch64-linux' in refused(capsys, path, '--out', out, '--target', 'z80')
    assert 'no name' in refused(capsys, path, '--out', out, '--name', 'a b')
    assert 'positive' in refused(capsys, path, '--out', out, '--limits', -1, 1, 0)
    assert 'window' in refused(capsys, path, '--out', out, '--energy', 1, 1e-6, 1e-9)
    assert 'rate' in refused(capsys, path, '--out', out, '--rate', 10)
    assert 'one model' in refused(capsys, path, path, '--out', out)
    recursion = saved(tmp_path, 'extended', rate=1000.0)
    assert '1000 Hz' in refused(capsys, recursion, '--out', out, '--rate', 20000)
    falling = saved(tmp_path, A1=1e-5)
    text = refused(capsys, falling, '--out', out, '--set', 'attenuation.enabled=false')
    assert 'no inverse' in text
    assert not out.exists()
    assert not [each for each in tmp_path.iterdir() if each.name.startswith('.')]


def loaded_from(out: Any) -> Loop:
    shared = out.parent / f'{out.name}.so'
    whole = ('-Wl,--whole-archive', out / 'libpiezo.a', '-Wl,--no-whole-archive')
    subprocess.run(['gcc', '-shared', '-o', shared, *whole, '-lm'], check=True)
    return Loop(ctypes.CDLL(str(shared)), out / 'piezo.h')


@pytest.fixture(scope='module')
def with_power(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Export a loop with a limit of the mean power."""
    folder = tmp_path_factory.mktemp('power')
    words = ['export', saved(folder, natural_frequency=68.0)]
    words += ['--energy', 1e-4, 1e-6, 0.05, '--rate', 2000, '--out', folder / 'lib']
    assert main([str(word) for word in words]) == 0
    return folder / 'lib'


def test_a_small_power_limit_slows_the_voltage_down_and_is_reported(with_power: Path) -> None:
    loop = loaded_from(with_power)
    assert loop.begin() == 0
    assert loop.change(energy_window=1e-3) == -3  # less than eleven ticks
    assert loop.change(energy_limit=2e-5) == 0
    spent = count = last = 0.0
    for k in range(4000):
        phase, w = 2 * np.pi * 50.0 * k / 2000.0, 100 * np.pi
        row = 6e-5 * np.sin(phase), 6e-5 * w * np.cos(phase), -6e-5 * w * w * np.sin(phase)
        code, voltage = loop.step(*row, 50.0, phase)
        count += code == 32
        if k >= 2000:
            spent += 0.5e-6 * 2.4 * abs(voltage - last) * 2000.0 / 2000
        last = voltage
    assert count > 1000
    assert 1.5e-5 < spent <= 2e-5 * (1.0 + 1e-9)


def test_a_model_without_an_inverse_is_a_plant(tmp_path: Path) -> None:
    out = tmp_path / 'plant'
    words = ['export', saved(tmp_path, A1=1e-5), '--out', out, '--only', 'plant', '--name', 'mine']
    assert main([str(word) for word in words]) == 0
    assert make(out, 'test').returncode == 0
    assert 'mine_plant_step' in (out / 'mine.h').read_text()


def test_no_compiler_is_one_line(exported: Path, tmp_path: Path) -> None:
    shutil.copytree(exported, tmp_path / 'lib')
    (tmp_path / 'lib' / 'selftest').unlink(missing_ok=True)
    done = make(tmp_path / 'lib', 'test', 'CC=no-such-compiler')
    assert done.returncode == 2
    assert 'error: there is no C compiler no-such-compiler' in done.stderr


def test_what_is_worked_into_the_code_of_a_plant_cannot_be_set(tmp_path: Path) -> None:
    from piezo_hysteresis.blocks import BLOCKS

    chain = ('transport_delay', 'bouc_wen_exact', 'mode', 'creep')
    path = saved(tmp_path, Model('late', tuple(BLOCKS[each] for each in chain)), delay=1e-4)
    out = tmp_path / 'lib'
    words = ['export', path, '--out', out, '--only', 'plant', '--rate', 1000]
    assert main([str(word) for word in words]) == 0
    text = (out / 'piezo.h').read_text()
    assert re.search(r'double delay; .*only a new export changes it', text)
    assert not re.search(r'double beta; .*only a new export changes it', text)
