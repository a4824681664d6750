"""Parameter files and launch files against the tables; needs neither ROS nor launch."""

from __future__ import annotations

import re
import runpy
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
import yaml

from piezo_hysteresis.common.parameter_table import ParameterTable
from piezo_hysteresis.common.registry import package_of
from piezo_hysteresis.models import ModelFile, Provenance
from piezo_hysteresis.models.schedule import OperatingRange
from piezo_hysteresis.parameters import node_tables
from piezo_sim.nodes.simulator_tables import plant_table, simulator_table
from piezo_sim.plant import Plant
from piezo_sim.presets import preset_names

ROOT = Path(__file__).parents[2]
SCENARIOS = sorted((ROOT / 'config' / 'scenarios').glob('*.yaml'))
CONFIG = ROOT / 'src' / 'piezo_hysteresis'  # as installed: `config` and `launch` are there
LAUNCH = sorted(ROOT.glob('src/*/launch/*.launch.py'))

USUAL = ['simulator', 'excitation', 'feedforward', 'attenuation', 'identification']
OTHER = {
    'simulator': 'false', 'correction': 'feedback', 'identification': 'false',
    'gap_monitor': 'true', 'dashboard': 'true', 'model_file': 'model.yaml', 'enclaves': 'true',
}  # fmt: skip
EXTRA = ['excitation', 'feedforward', 'feedback', 'gap_monitor', 'dashboard']


def table_of(node: str, values: dict[str, Any]) -> ParameterTable:
    if node != 'simulator':
        found: ParameterTable = getattr(node_tables, node.upper())
        return found
    own = simulator_table()
    preset = values.get('preset', own.defaults()['preset'])
    return ParameterTable((*own.specs, *plant_table(Plant.from_preset(preset)).specs))


def refused(table: ParameterTable, values: dict[str, Any]) -> list[str]:
    """Return why values of a parameter file would be refused or ignored."""
    unknown = [f'{name} is no parameter' for name in values if table.spec(name) is None]
    known = {name: spec.coerce(v) for name, v in values.items() if (spec := table.spec(name))}
    return unknown + list(filter(None, [table.judge(table.defaults(), known)]))


def faults(content: dict[str, Any]) -> list[str]:
    """Return everything in a parameter file that a node would refuse or ignore."""
    found = []
    for key, section in content.items():
        node = key.removeprefix('/**/')
        values = section['ros__parameters']
        table = table_of(node, values)
        found += [f'{node}: {reason}' for reason in refused(table, values)]
        if node == 'simulator':
            plain = {name: v for name, v in values.items() if '.' in name}
            Plant.from_preset('fdk_pzba_00030', overrides=plain)
    return found


def test_there_are_scenarios_and_launch_files() -> None:
    assert len(SCENARIOS) >= 4
    assert {file.name for file in LAUNCH} == {
        'loop.launch.py',
        'record.launch.py',
        'stages.launch.py',
    }


@pytest.mark.parametrize('file', SCENARIOS, ids=lambda file: file.stem)
def test_a_scenario_sets_only_known_parameters_in_range(file: Path) -> None:
    text = file.read_text(encoding='utf-8')
    assert text.startswith('# ')
    content = yaml.safe_load(text)
    assert all(key.startswith('/**/') for key in content)
    assert faults(content) == []


@pytest.mark.parametrize(
    ('node', 'values'),
    [
        ('feedforward', {'gian': 1e-4}),
        ('feedforward', {'limits.low': 2.0}),
        ('attenuation', {'orders': [-2]}),
        ('attenuation', {'method': 'magic'}),
        ('simulator', {'structure.damping_ratio': -1.0}),
        ('identification', {'publish_every': 1.5}),
    ],
)
def test_mistakes_in_a_scenario_are_found(node: str, values: dict[str, Any]) -> None:
    table = table_of(node, values)
    assert refused(table, values)


def test_the_loop_of_a_scenario_runs_at_one_rate() -> None:
    for file in SCENARIOS:
        sections = yaml.safe_load(file.read_text(encoding='utf-8')).values()
        rates = {section['ros__parameters'].get('rate', 1000.0) for section in sections}
        assert len(rates) == 1, file


def stage_model() -> ModelFile:
    """Return a model of 40 µm between 0 and 100 V, of records at 10 kHz."""
    model = ModelFile.from_name('linear_mode', A1=4e-7, natural_frequency=500.0, damping_ratio=0.1)
    voltage = OperatingRange(0.0, 100.0, 1e4, 0.0)
    return ModelFile(
        model.model, model.values, provenance=Provenance(rate=10000.0, voltage=voltage)
    )


@pytest.fixture
def launched(monkeypatch: pytest.MonkeyPatch) -> list[dict[str, Any]]:
    """Stand in for the packages of launch; return what launch files say of each node."""
    nodes: list[dict[str, Any]] = []

    class Stub:
        def __init__(self, *words: Any, **known: Any) -> None:
            self.words, self.known = words, known

        def perform(self, context: dict[str, str]) -> str:
            return context.get(self.words[0], str(CONFIG))

    def node(**known: Any) -> Stub:
        nodes.append(known)
        return Stub()

    for name, members in {
        'launch': ('LaunchDescription',),
        'launch.actions': (
            'DeclareLaunchArgument', 'GroupAction', 'IncludeLaunchDescription', 'OpaqueFunction'
        ),
        'launch.launch_description_sources': ('PythonLaunchDescriptionSource',),
        'launch.substitutions': ('LaunchConfiguration', 'PathJoinSubstitution'),
        'launch_ros': (),
        'launch_ros.substitutions': ('FindPackageShare',),
    }.items():  # fmt: skip
        module = ModuleType(name)
        for member in members:
            setattr(module, member, Stub)
        monkeypatch.setitem(sys.modules, name, module)
    actions = ModuleType('launch_ros.actions')
    vars(actions)['Node'] = node
    monkeypatch.setitem(sys.modules, actions.__name__, actions)
    return nodes


@pytest.mark.parametrize('changed', [{}, OTHER], ids=['defaults', 'other'])
@pytest.mark.parametrize('file', LAUNCH, ids=lambda file: file.stem)
def test_a_launch_file_names_what_there_is(
    file: Path, changed: dict[str, str], launched: list[dict[str, Any]], tmp_path: Path
) -> None:
    if changed:
        stage_model().save(tmp_path / 'model.yaml')
        changed = {**changed, 'model_file': str(tmp_path / 'model.yaml')}
    source = runpy.run_path(str(file))
    arguments = source['ARGUMENTS']
    used = set(re.findall(r"values\['(\w+)'\]", file.read_text())) | set(
        source.get('SWITCHES', ())
    )
    assert used == set(arguments)
    source['generate_launch_description']()
    if '_nodes' in source:
        source['_nodes']({name: default for name, (default, _) in arguments.items()} | changed)
        names = [node['executable'] for node in launched]
        assert names == (EXTRA if changed else USUAL)
    assert launched or file.stem.startswith('stages')
    for node in launched:
        name = node['executable']
        assert node['package'] == package_of(name)
        for part in node['parameters']:
            if isinstance(part, dict):
                table = table_of(name, {})
                for key, value in part.items():
                    spec = table.spec(key)
                    assert spec is not None
                    assert not isinstance(value, str | float | int) or spec.judge(value) == ''
            else:
                assert Path(part).is_file()
    if 'scenario' in arguments:
        assert arguments['scenario'][0] in {file.stem for file in SCENARIOS}
        assert arguments['preset'][0] in preset_names()
        for name in ('preset', 'clock', 'model_file'):
            spec = simulator_table().spec(name) or node_tables.FEEDFORWARD.spec(name)
            assert spec is not None
            assert spec.judge(arguments[name][0]) == ''


def test_a_model_of_100_volts_sets_rate_limits_and_reference(
    launched: list[dict[str, Any]], tmp_path: Path
) -> None:
    stage_model().save(tmp_path / 'model.yaml')
    (tmp_path / 'own.yaml').write_text('{}')
    source = runpy.run_path(str(CONFIG / 'launch' / 'loop.launch.py'))
    usual = {name: default for name, (default, _) in source['ARGUMENTS'].items()}
    given = usual | {'model_file': str(tmp_path / 'model.yaml')}

    def of(node: str) -> dict[str, Any]:
        parts = next(each['parameters'] for each in launched if each['executable'] == node)
        return {k: v for part in parts if isinstance(part, dict) for k, v in part.items()}

    source['_nodes'](given)
    assert {of(node)['rate'] for node in USUAL} == {10000.0}
    assert of('excitation')['reference.offset'] == pytest.approx(20e-6, rel=0.1)
    assert of('excitation')['reference.amplitude'] == pytest.approx(10e-6, rel=0.1)
    assert of('identification')['voltage_range'] == 100.0
    for file in SCENARIOS:  # limits that a file gives would replace those of the model
        assert 'limits' not in file.read_text(encoding='utf-8').replace('# limits', '')
    launched.clear()
    source['_nodes'](given | {'scenario': str(tmp_path / 'own.yaml')})
    implied, own, _ = launched[1]['parameters']  # a file of one's own has the last word
    assert (implied['rate'], own) == (10000.0, str(tmp_path / 'own.yaml'))


def test_setup_installs_scenarios_and_launch_files(monkeypatch: pytest.MonkeyPatch) -> None:
    metadata: dict[str, Any] = {}
    monkeypatch.chdir(ROOT / 'src' / 'piezo_hysteresis')
    monkeypatch.setattr('setuptools.setup', lambda **known: metadata.update(known))
    runpy.run_path('setup.py')
    installed = {Path(file).name for _, files in metadata['data_files'] for file in files}
    assert {file.name for file in (*SCENARIOS, *LAUNCH)} <= installed
