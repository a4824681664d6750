"""Every parameter of every node over its service, while the loop runs."""

from __future__ import annotations

import itertools
import math
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from listening import Listener
from live_nodes import LiveNodes
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import DescribeParameters, ListParameters, SetParameters
from rclpy.parameter import Parameter

from piezo_hysteresis.common.parameter_table import ParameterSpec, ParameterTable
from piezo_hysteresis.common.registry import package_of
from piezo_hysteresis.parameters import node_tables
from piezo_hysteresis.records import Record, write_bag
from piezo_hysteresis.ros.processes import NodeProcess
from piezo_interfaces.msg import ActuatorState
from piezo_sim.nodes.simulator_tables import plant_table, simulator_table
from piezo_sim.plant import Plant

pytestmark = pytest.mark.ros

# Of real time: ten nodes and a test share the cores of a small machine.
SPEED = 0.2

# Nodes whose parameters are walked while the loop runs at 1 kHz.
AT_FULL_SPEED = {'attenuation'}

OWN = 'use_sim_time', 'qos_overrides', 'start_type_description_service'

TABLES: dict[str, ParameterTable] = {
    'simulator': ParameterTable(
        (*simulator_table().specs, *plant_table(Plant.from_preset('fdk_pzba_00030')).specs)
    ),
    'excitation': node_tables.EXCITATION,
    'feedforward': node_tables.FEEDFORWARD,
    'attenuation': node_tables.ATTENUATION,
    'feedback': node_tables.FEEDBACK,
    'identification': node_tables.IDENTIFICATION,
    'gap_monitor': node_tables.GAP_MONITOR,
    'recorder': node_tables.RECORDER,
    'player': node_tables.PLAYER,
}


class Everything:
    """All nodes at once, tracking a sinusoid in real time."""

    def __init__(self, processes: LiveNodes, listener: Listener, folder: Path) -> None:
        self.listener, self.processes, self.folder = listener, processes, folder
        self.states = listener.listen(ActuatorState, 'actuator/state')
        time = np.arange(500) * 1e-3
        write_bag(folder / 'bag', [Record('r', 1e-3, np.sin(30 * time), 1e-4 * np.sin(30 * time))])
        settings: dict[str, dict[str, Any]] = {
            'simulator': {'speed_factor': SPEED},
            'excitation': {'mode': 'reference', 'frequency': 10.0},
            'recorder': {'out': str(folder / 'recorded')},
            'player': {'bag': str(folder / 'bag'), 'loop': True},
        }
        remap = {
            'attenuation': {'voltage/command': 'voltage/attenuated'},
            'feedback': {'voltage/feedforward': 'voltage/attenuated'},
        }
        self.nodes: dict[str, NodeProcess] = {}
        self.kept_up: int | None = None
        for name in TABLES:
            self.nodes[name] = processes.start(
                package_of(name), name, settings.get(name), remap=remap.get(name)
            )
        listener.until(lambda: self.states and abs(self.states[-1].voltage) > 0.0, 90.0)

    def run_at(self, speed: float) -> None:
        """Let the actuator run at `speed` times 1 kHz, and wait until it does."""
        if speed > SPEED and self.kept_up is None:
            self.kept_up = len(self.states)
        assert self.listener.set_one('simulator', 'speed_factor', speed) == ''
        count = len(self.states)
        self.listener.until(lambda: len(self.states) > count + 20)

    def put(self, node: str, name: str, values: list[Any]) -> list[str]:
        """Set a parameter to one value after another; return '' or the reason of each refusal."""
        messages = [
            Parameter(name, value=value).to_parameter_msg()
            if value is not None
            else ParameterMessage(name=name)
            for value in values
        ]
        request = SetParameters.Request(parameters=messages)
        results = self.listener.call(SetParameters, f'{node}/set_parameters', request).results
        assert all(result.successful or result.reason for result in results)
        return ['' if result.successful else result.reason for result in results]


@pytest.fixture(scope='module')
def everything(
    shared_processes: LiveNodes,
    shared_listener: Listener,
    tmp_path_factory: pytest.TempPathFactory,
) -> Everything:
    return Everything(shared_processes, shared_listener, tmp_path_factory.mktemp('nodes'))


def impossible(spec: ParameterSpec) -> list[Any]:
    """Return values that must be refused; None takes the parameter away."""
    default = spec.default
    wrong: list[Any] = [None]
    if isinstance(default, list):
        wrong += [1.5, 'words', True]
        wrong += [[math.nan]] if isinstance(default[0], float) else []
        wrong += [[int(spec.high) + 1]] if isinstance(default[0], int) else []
    elif isinstance(default, bool):
        wrong += [1, 1.0, 'true']
    elif isinstance(default, str):
        wrong += [1, 2.5, False, *(['no such word'] if spec.choices else [])]
    else:
        wrong += ['1', True, [1.0]]
        if isinstance(default, float):
            wrong += [math.nan, math.inf, -math.inf]
        else:
            wrong += [1.5]
        wrong += [beyond(spec, spec.high, 1)] if math.isfinite(spec.high) else []
        lowest = max(spec.low, spec.above)
        wrong += [beyond(spec, lowest, -1)] if math.isfinite(lowest) else []
    return wrong


def beyond(spec: ParameterSpec, edge: float, way: int) -> Any:
    if isinstance(spec.default, int):
        return int(edge) + way
    if way < 0 and edge == spec.above:
        return edge
    return edge + way * max(abs(edge), 1.0)


def possible(spec: ParameterSpec) -> list[Any]:
    """Return values that the table allows; other rules may still refuse them, with a reason."""
    default = spec.default
    if isinstance(default, bool):
        return [not default]
    if isinstance(default, str):
        return list(spec.choices)
    if isinstance(default, list):
        return [[int(spec.low), 5]] if isinstance(default[0], int) else []
    edges: list[Any] = [edge for edge in (spec.low, spec.high) if math.isfinite(edge)]
    return [type(default)(edge) for edge in edges]


@pytest.mark.parametrize('node', list(TABLES))
def test_every_parameter_is_described_and_guarded(everything: Everything, node: str) -> None:
    full = node in AT_FULL_SPEED or 'PIEZO_WALK_AT_FULL_SPEED' in os.environ
    everything.run_at(1.0 if full else SPEED)
    call = everything.listener.call
    specs = {spec.name: spec for spec in TABLES[node].specs}
    listed = call(ListParameters, f'{node}/list_parameters', ListParameters.Request()).result.names
    own = {name for name in listed if not name.startswith((*OWN, 'model.'))}
    assert own == specs.keys()
    request = DescribeParameters.Request(names=list(specs))
    described = call(DescribeParameters, f'{node}/describe_parameters', request).descriptors
    refused = 0
    for spec, descriptor in zip(specs.values(), described, strict=True):
        assert spec.description in descriptor.description
        assert descriptor.read_only == spec.read_only
        before = everything.listener.get_parameter(node, spec.name)
        wrong = impossible(spec)
        for value, reason in zip(wrong, everything.put(node, spec.name, wrong), strict=True):
            assert reason, f'{spec.name} = {value!r} was accepted'
            assert '\n' not in reason
        assert same(everything.listener.get_parameter(node, spec.name), before)
        allowed = [*possible(spec), before]
        reasons = everything.put(node, spec.name, allowed)
        if spec.read_only:
            assert all('read-only' in reason for reason in reasons)
            continue
        refused += sum(bool(reason) for reason in reasons)
        assert not reasons[-1], reasons[-1]
        assert same(everything.listener.get_parameter(node, spec.name), before)
    # Edges that do not go together with the other values; more would be a wrong table.
    assert refused <= 0.2 * len(specs)
    assert everything.nodes[node].returncode is None


def same(a: Any, b: Any) -> bool:
    return list(a) == list(b) if isinstance(b, list) or hasattr(b, 'tolist') else a == b


def test_the_loop_ran_on_without_a_gap(everything: Everything) -> None:
    count = len(everything.states)
    everything.listener.until(lambda: len(everything.states) > count + 50)
    samples = [state.sample for state in everything.states]
    assert all(b > a for a, b in itertools.pairwise(samples))
    # At 1 kHz this listener, not the loop, may lose some on a busy machine.
    slow = samples[: everything.kept_up]
    assert all(b - a == 1 for a, b in itertools.pairwise(slow))
    numbers = np.array([(state.voltage, state.displacement) for state in everything.states])
    assert np.isfinite(numbers).all()
