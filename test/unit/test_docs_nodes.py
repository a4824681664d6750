"""Page, tables and ``--help`` of every node agree."""

from __future__ import annotations

import argparse
import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

from piezo_hysteresis.cli import loop
from piezo_hysteresis.common.node_sheet import NodeSheet
from piezo_hysteresis.common.parameter_table import ParameterSpec, ParameterTable
from piezo_hysteresis.common.registry import NODES, package_of
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.parameters.sheets import SHEETS
from piezo_sim.nodes.simulator_tables import SHEETS as SIMULATOR_SHEETS

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / 'docs' / 'nodes.md'


@pytest.mark.component
def test_the_page_is_up_to_date() -> None:
    done = subprocess.run(
        [sys.executable, 'tools/write_docs.py', '--check'],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr


def test_every_node_has_a_section() -> None:
    assert set(re.findall(r'^## (\w+)$', PAGE.read_text(), re.MULTILINE)) == set(NODES)


@pytest.mark.parametrize('launch', ['loop', 'record', 'stages'])
def test_every_launch_argument_is_documented(launch: str) -> None:
    source = (ROOT / f'src/piezo_hysteresis/launch/{launch}.launch.py').read_text()
    values = next(
        node.value
        for node in ast.parse(source).body
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == 'ARGUMENTS'
    )
    arguments = ast.literal_eval(values)
    page = (ROOT / 'docs/ros2.md').read_text()
    for name, (default, _) in arguments.items():
        assert f'`{name}`' in page
        if launch == 'loop' and default:
            assert f'| `{name}` | `{default}` |' in page


ALL = {**SHEETS, **SIMULATOR_SHEETS}
# What makes the start of a node slow.
SLOW = {'rclpy', 'bokeh', 'piezo_hysteresis.models'}


def flat(text: str) -> str:
    return ' '.join(text.split())


@pytest.mark.component
@pytest.mark.parametrize('name', ALL)
@pytest.mark.parametrize('words', [['--help'], ['--ros-args', '-p', 'rate:=5.0', '-h']])
def test_an_executable_lists_its_parameters(name: str, words: list[str]) -> None:
    code = (
        f'import sys; from piezo_hysteresis.ros.starting import {name} as run; run();'
        f' print("loaded:", *(set(sys.modules) & {SLOW}))'
    )
    done = subprocess.run(
        [sys.executable, '-c', code, *words],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ''
    text, _, loaded = done.stdout.rpartition('loaded:')
    assert loaded.split() == []
    assert text.startswith('usage: ')
    said = flat(text)
    for table in (ALL[name].table, *ALL[name].more().values()):
        for spec in table.specs:
            assert re.search(rf'^  {re.escape(spec.name)}( \*)?$', text, re.MULTILINE), spec.name
            assert flat(spec.description) in said


def test_every_node_has_a_module_and_a_sheet() -> None:
    assert set(NODES) == set(ALL)
    for name, sheet in ALL.items():
        assert sheet.executable == name
        assert (ROOT / 'src' / package_of(name) / f'{NODES[name].replace(".", "/")}.py').is_file()
    assert set(SIMULATOR_SHEETS) == {name for name in NODES if package_of(name) == 'piezo_sim'}


def test_the_help_is_as_wide_as_the_screen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv('COLUMNS', '70')
    for sheet in ALL.values():
        assert max(map(len, sheet.help_text().splitlines())) <= 70


def test_a_row_states_the_allowed_values() -> None:
    specs = (
        ParameterSpec('speed', 2.0, 'How fast.', 'm/s', above=0.0, high=5.0, read_only=True),
        ParameterSpec('kind', 'a', 'Which.', choices=('a', 'b')),
        ParameterSpec('on', True, 'Whether.'),
    )
    text = flat(NodeSheet('x', 'See [that](that.md).', ParameterTable(specs)).help_text())
    assert 'See docs/that.' in text
    assert 'speed * How fast. (2; above 0 .. 5 m/s)' in text
    assert 'kind Which. (a; one of a, b)' in text
    assert 'on Whether. (true; true or false)' in text


@pytest.mark.parametrize('model', ['', 'model.yaml'])
def test_the_loop_gives_no_node_an_empty_text(model: str) -> None:
    parser = argparse.ArgumentParser()
    loop.configure(parser)
    found = loop.nodes(parser.parse_args([]), model, 8000.0, (0.0, 1e-5))
    for name in ('simulator', 'identification'):
        assert found[name]['rate'] == 8000.0
    assert found['control_loop']['attenuation:rate'] == 8000.0
    assert not [name for name, values in found.items() if '' in values.values()]
    for link in ('feedforward', 'attenuation', 'feedback'):  # each limits the voltage
        assert found['control_loop'].get(f'{link}:model_file', '') == model
    assert ('gap_monitor' in found) == bool(model)


def test_the_loop_of_several_axes_excites_each_and_needs_limits() -> None:
    model = str(ROOT / 'test' / 'ros' / 'xy_scanner.yaml')
    parser = argparse.ArgumentParser()
    loop.configure(parser)
    given = ['--preset', 'xy_scanner', '--limits', '-50', '40', '1e5']
    found = loop.nodes_of_axes(parser.parse_args(given), model)
    control = found['control_loop']
    assert control['coupled:model_file'] == model
    assert control['limits.low'] == -50.0
    assert (control['excitation_1:frequency'], control['excitation_2:frequency']) == (23.0, 28.75)
    # half of 40 V, the nearer end, times 0.17 um/V
    assert control['reference.amplitude'] == pytest.approx(3.4e-6, rel=0.1)
    assert found['simulator']['rate'] == control['rate'] == pytest.approx(1e4)
    with pytest.raises(PiezoError, match='give --preset and --limits'):
        loop.nodes_of_axes(parser.parse_args(given[:2]), model)
    for words, reason in (
        (['--amplitude', '1000'], 'reach 6.* µm'),
        (['--limits', '10', '50', '1e5'], 'rests at 0 V'),
        (['--limits', 'nan', '50', '1e5'], 'not finite'),
    ):
        with pytest.raises(PiezoError, match=reason):
            loop.nodes_of_axes(parser.parse_args([*given, *words]), model)


@pytest.mark.parametrize('word', ['--seconds=nan', '--seconds=0', '--frequency=-3'])
def test_a_loop_refuses_numbers_before_a_node_starts(word: str) -> None:
    parser = argparse.ArgumentParser()
    loop.configure(parser)
    with pytest.raises(PiezoError, match='must be a number above 0'):
        loop.run(parser.parse_args([word]))
