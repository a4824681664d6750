"""No node compiles a kernel: set-up has done that, for every law, method and model."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from listening import Listener
from live_nodes import LiveNodes

from piezo_hysteresis.common.parameter_table import ParameterTable
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.models import NAMES, ModelFile, named
from piezo_hysteresis.parameters.node_tables import ATTENUATION, FEEDBACK, IDENTIFICATION
from piezo_interfaces.msg import ActuatorState
from piezo_interfaces.srv import LoadModel

pytestmark = pytest.mark.ros


def choices(table: ParameterTable, name: str) -> tuple[str, ...]:
    return next(spec.choices for spec in table.specs if spec.name == name)


def compiled(folder: Path) -> list[str]:
    return sorted({path.name.rpartition('-')[0] for path in folder.rglob('*.nbc')})


# The first tick in a new state runs its kernels; those of an estimate or a report come later.
@pytest.mark.parametrize('long', [100, pytest.param(300, marks=pytest.mark.slow)])
def test_a_loop_that_changes_everything_compiles_nothing(
    processes: LiveNodes, listener: Listener, tmp_path: Path, long: int
) -> None:
    kernels = tmp_path / 'kernels'
    processes.environment.update(NUMBA_CACHE_DIR=str(kernels), XDG_CACHE_HOME=str(tmp_path))
    states = listener.listen(ActuatorState, 'actuator/state')
    processes.start('piezo_sim', 'simulator', {'clock': 'lock_step', 'wait_for': 3})
    drive = {'mode': 'reference', 'reference.amplitude': 2e-5, 'frequency': 23.0}
    settings = {f'excitation:{name}': value for name, value in drive.items()}
    processes.start('piezo_hysteresis', 'control_loop', {**settings, 'attenuation:orders': [1, 3]})
    processes.start('piezo_hysteresis', 'identification')
    processes.start('piezo_hysteresis', 'gap_monitor')

    def go_on(ticks: int = long) -> None:
        wanted = len(states) + ticks
        listener.until(lambda: len(states) >= wanted)

    go_on()
    assert not listener.set_one('attenuation', 'orders', [1, 3])  # what every method can
    for method in choices(ATTENUATION, 'method'):
        for fit in choices(ATTENUATION, 'fit'):
            assert not listener.set_one('attenuation', 'method', method)
            assert not listener.set_one('attenuation', 'fit', fit)
            go_on(700)
    for method in choices(FEEDBACK, 'method'):
        listener.set_one('feedback', 'method', method)  # one needs more than a default
        go_on()
    for method in choices(IDENTIFICATION, 'method'):
        assert not listener.set_one('identification', 'method', method)
        go_on()
    for name in NAMES:
        model = named(name)
        file = tmp_path / f'{name}.yaml'
        try:
            ModelFile(model, model.defaults()).save(file)
        except PiezoError:
            continue  # its defaults are no actuator
        for node in ('feedforward', 'gap_monitor'):
            listener.call(LoadModel, f'{node}/load_model', LoadModel.Request(path=str(file)))
        go_on()
    for name in ('effects.creep', 'effects.drift'):
        assert not listener.set_one('simulator', name, True)
        go_on()
    assert compiled(kernels) == [], 'let a call of tools/compile_kernels.py run these'


@pytest.mark.parametrize('discovers', [False, pytest.param(True, marks=pytest.mark.slow)])
def test_verbs_compile_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, discovers: bool
) -> None:
    kernels = tmp_path / 'kernels'
    monkeypatch.setenv('NUMBA_CACHE_DIR', str(kernels))
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path))

    def verb(*words: object) -> None:
        done = subprocess.run([sys.executable, '-m', *map(str, words)], capture_output=True)
        assert done.returncode == 0, done.stderr

    sweep, model = tmp_path / 'sweep', tmp_path / 'model'
    verb('piezo_sim', 'sweep', '--frequencies', '5,20', '--seconds', '1', '--out', sweep)
    verb('piezo_hysteresis', 'identify', sweep, '--model', 'bouc_wen_mode', '--out', model)
    verb('piezo_hysteresis', 'validate', sweep, '--model', model / 'model.yaml',
         '--out', tmp_path / 'validated')  # fmt: skip
    if discovers:
        verb('piezo_hysteresis', 'discover', sweep, '--baseline', 'classical',
             '--out', tmp_path / 'found')  # fmt: skip
    assert compiled(kernels) == [], 'let a call of tools/compile_kernels.py run these'
