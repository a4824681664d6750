"""Parameter files and launch files against the tables; needs neither ROS nor launch."""

from __future__ import annotations

import ast
import re
import runpy
from pathlib import Path
from typing import Any

import pytest
import yaml

from piezo_hysteresis.common.table import ParameterTable
from piezo_hysteresis.parameters import tables
from piezo_sim.nodes.tables import plant_table, simulator_table
from piezo_sim.plant import Plant
from piezo_sim.presets import preset_names

ROOT = Path(__file__).parents[2]
SCENARIOS = sorted((ROOT / 'config' / 'scenarios').glob('*.yaml'))
LAUNCH = sorted(ROOT.glob('src/*/launch/*.launch.py'))


def table_of(node: str, values: dict[str, Any]) -> ParameterTable:
    if node != 'simulator':
        found: ParameterTable = getattr(tables, node.upper())
        return found
    own = simulator_table()
    preset = values.get('preset', own.defaults()['preset'])
    return ParameterTable((*own.specs, *plant_table(Plant.from_preset(preset)).specs))


def faults(content: dict[str, Any]) -> list[str]:
    """Return everything in a parameter file that a node would refuse or ignore."""
    found = []
    for key, section in content.items():
        node = key.removeprefix('/**/')
        values = section['ros__parameters']
        table = table_of(node, values)
        found += [f'{node}: {reason}' for reason in table.check_file(values)]
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
def test_a_scenario_says_only_what_nodes_know_and_allow(file: Path) -> None:
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
        ('attenuation', {'orders': [-1]}),
        ('attenuation', {'method': 'magic'}),
        ('simulator', {'structure.damping_ratio': -1.0}),
        ('identification', {'publish_every': 1.5}),
    ],
)
def test_mistakes_in_a_scenario_are_found(node: str, values: dict[str, Any]) -> None:
    table = table_of(node, values)
    assert table.check_file(values)


def test_the_loop_of_a_scenario_runs_at_one_rate() -> None:
    for file in SCENARIOS:
        sections = yaml.safe_load(file.read_text(encoding='utf-8')).values()
        rates = {section['ros__parameters'].get('rate', 1000.0) for section in sections}
        assert len(rates) == 1, file


def executables(package: str) -> set[str]:
    """Return the names in the list `nodes` of a setup.py."""
    tree = ast.parse((ROOT / 'src' / package / 'setup.py').read_text(encoding='utf-8'))
    (nodes,) = (
        statement.value
        for statement in tree.body
        if isinstance(statement, ast.Assign) and ast.unparse(statement.targets[0]) == 'nodes'
    )
    return set(ast.literal_eval(nodes))


def keywords(call: ast.Call) -> dict[str, ast.expr]:
    return {word.arg: word.value for word in call.keywords if word.arg}


@pytest.mark.parametrize('file', LAUNCH, ids=lambda file: file.stem)
def test_a_launch_file_names_what_there_is(file: Path) -> None:
    tree = ast.parse(file.read_text(encoding='utf-8'))
    (arguments,) = (
        ast.literal_eval(statement.value)
        for statement in tree.body
        if isinstance(statement, ast.Assign) and ast.unparse(statement.targets[0]) == 'ARGUMENTS'
    )
    used = set(re.findall(r"values\['(\w+)'\]", ast.unparse(tree)))
    assert used == set(arguments)
    nodes = [
        keywords(call)
        for call in ast.walk(tree)
        if isinstance(call, ast.Call) and ast.unparse(call.func) == 'Node'
    ]
    assert nodes or 'loop.launch.py' in ast.unparse(tree)
    for node in nodes:
        package = ast.literal_eval(node['package'])
        name = ast.literal_eval(node['executable'])
        assert name in executables(package)
        table = table_of(name, {})
        for part in getattr(node['parameters'], 'elts', []):
            for key in getattr(part, 'keys', []):
                assert table.spec(ast.literal_eval(key)) is not None
    if 'scenario' in arguments:
        assert arguments['scenario'][0] in {file.stem for file in SCENARIOS}
        assert arguments['preset'][0] in preset_names()
        for name in ('preset', 'clock', 'model_file'):
            spec = simulator_table().spec(name) or tables.FEEDFORWARD.spec(name)
            assert spec is not None
            assert spec.judge(arguments[name][0]) == ''


def test_setup_installs_scenarios_and_launch_files(monkeypatch: pytest.MonkeyPatch) -> None:
    metadata: dict[str, Any] = {}
    folder = ROOT / 'src' / 'piezo_hysteresis'
    monkeypatch.chdir(folder)
    monkeypatch.setattr('setuptools.setup', lambda **known: metadata.update(known))
    runpy.run_path(str(folder / 'setup.py'))
    installed = {Path(file).name for _, files in metadata['data_files'] for file in files}
    assert {'tracking.yaml', 'symmetric.yaml', 'loop.launch.py'} <= installed
