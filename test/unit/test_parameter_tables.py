"""What every parameter table must be so that the `ros2 param` tools can deal with it."""

from __future__ import annotations

import pytest
import yaml

from piezo_hysteresis.common.parameter_table import ParameterSpec, ParameterTable
from piezo_hysteresis.parameters import node_tables
from piezo_sim.nodes.simulator_tables import plant_table, simulator_table
from piezo_sim.plant import Plant

NODES = {
    name: table for name, table in vars(node_tables).items() if isinstance(table, ParameterTable)
}
SIMULATOR = ParameterTable(
    (*simulator_table().specs, *plant_table(Plant.from_preset('fdk_pzba_00030')).specs)
)
TABLES = {**NODES, 'SIMULATOR': SIMULATOR}


@pytest.mark.parametrize('name', sorted(TABLES))
def test_no_parameter_is_the_group_of_others(name: str) -> None:
    """`ros2 param dump` writes groups as nested mappings: `rate` and `rate.memory` clash."""
    names = {spec.name for spec in TABLES[name].specs}
    groups = {word[:k] for word in names for k, letter in enumerate(word) if letter == '.'}
    assert names & groups == set()


NUMBERS = [('5e-05', 5e-05), ('-1E3', -1000.0), ('2e+0', 2.0), ('1.4e5', 1.4e5), ('.5e1', 5.0)]


@pytest.mark.parametrize(('text', 'value'), NUMBERS)
def test_a_float_that_yaml_takes_for_a_text_is_a_float(text: str, value: float) -> None:
    assert isinstance(yaml.safe_load(text), str)  # else nothing would have to be done
    spec = ParameterSpec('x', 1.0, 'A number.')
    assert spec.coerce(text) == value
    assert spec.judge(spec.coerce(text)) == ''
    several = ParameterSpec('x', [1.0], 'Numbers.')
    assert several.coerce([1, text]) == several.coerce(f'[1,{text}]') == [1.0, value]


@pytest.mark.parametrize('text', ['fast', '5', '1e', 'e5', '1e5x', 'nan', '1_0e2', ''])
def test_other_texts_are_refused(text: str) -> None:
    spec = ParameterSpec('x', 1.0, 'A number.')
    assert 'float' in spec.judge(spec.coerce(text))


def test_a_text_stays_a_text() -> None:
    assert ParameterSpec('x', '', 'A text.').coerce('1e5') == '1e5'
