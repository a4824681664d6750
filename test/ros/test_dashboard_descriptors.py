"""What the page makes of descriptors, and of the words of its command line."""

from __future__ import annotations

import pytest

from piezo_hysteresis.common.parameter_table import ParameterSpec
from piezo_hysteresis.dashboard.controls import ParameterState, reach
from piezo_hysteresis.nodes.dashboard.dashboard_node import dashboard_arguments
from piezo_hysteresis.nodes.dashboard.topic_collector import from_ros
from piezo_hysteresis.parameters import node_tables
from piezo_hysteresis.ros.parameters import describe
from piezo_sim.nodes.simulator_tables import plant_table, simulator_table
from piezo_sim.plant import Plant
from piezo_sim.presets import preset_names

pytestmark = pytest.mark.ros

SPECS = [
    *(spec for name in node_tables.__all__ for spec in getattr(node_tables, name).specs),
    *simulator_table().specs,
]


def told(spec: ParameterSpec) -> ParameterState:
    """Return a row as it comes back from the descriptor that a node gives of it."""
    return from_ros('node', spec.name, spec.default, describe(spec))


@pytest.mark.parametrize('spec', SPECS, ids=lambda spec: spec.name)
def test_the_page_reads_the_descriptors_of_the_nodes(spec: ParameterSpec) -> None:
    found = told(spec)
    assert found.sentence == spec.description
    assert found.unit == spec.unit
    assert found.choices == spec.choices
    assert found.read_only == spec.read_only
    assert found.value == spec.default
    if type(spec.default) is float:
        assert found.low == max(spec.low, spec.above)
        assert found.high == spec.high


@pytest.mark.parametrize('preset', preset_names())
def test_every_number_has_a_slider_that_can_be_moved(preset: str) -> None:
    own = [*SPECS, *plant_table(Plant.from_preset(preset)).specs]
    numbers = [p for p in map(told, own) if p.is_number]
    assert len(numbers) > 100
    for parameter in numbers:
        span = reach(parameter, numbers)
        assert isinstance(parameter.value, int | float)
        shown = parameter.value * parameter.factor
        assert span.start < span.end, parameter
        assert span.start <= shown <= span.end * (1 + 1e-9), parameter
        assert 0.0 < span.step <= span.end - span.start, parameter


def test_words_of_the_verb_become_parameters() -> None:
    assert dashboard_arguments([]) == ['--ros-args']
    words = ['--port', '0', '--folder', 'runs', '--namespace', '/stage_x']
    assert dashboard_arguments(words) == [
        '--ros-args', '-p', 'folder:=runs', '-p', 'port:=0', '-r', '__ns:=/stage_x',
    ]  # fmt: skip
    launched = ['--ros-args', '-r', '__ns:=/piezo', '--params-file', 'x.yaml']
    assert dashboard_arguments(launched) == launched
