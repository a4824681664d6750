"""Topics, services and actions in docs/nodes.md are those of running nodes."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import pytest
from listening import Listener
from live_nodes import LiveNodes

from piezo_hysteresis.common import topics
from piezo_hysteresis.common.node_sheet import NodeSheet
from piezo_hysteresis.common.registry import package_of

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / 'tools'))

from write_docs import NODES, TYPES

pytestmark = pytest.mark.ros

# What ROS itself gives to every node, or to every managed one.
STANDARD = ('/rosout', '/parameter_events', '/_action/', '/transition_event')
STANDARD_SERVICES = (
    'parameter', 'get_type_description', 'change_state', 'get_state', 'get_available_',
    'get_transition_graph', '/_action/',
)  # fmt: skip


# Executables that hold several nodes, each with names of its own.
INSIDE = {'control_loop': ('excitation', 'feedforward', 'attenuation', 'feedback')}
# What a node hears only while something else is missing, see test_security_live.py.
AT_TIMES = {'feedforward': {'/' + topics.STATE}}


def own(names: Iterable[tuple[str, list[str]]], standard: tuple[str, ...]) -> dict[str, str]:
    return {name: types[0] for name, types in names if not any(word in name for word in standard)}


def resolved(names: Iterable[str], node: str) -> set[str]:
    return {'/' + name.replace('~', node).lstrip('/') for name in names}


@pytest.mark.parametrize(
    'page', [n for n in NODES if n.executable != 'player'], ids=lambda n: n.executable
)
def test_the_page_lists_the_interfaces_of_a_node(
    processes: LiveNodes, listener: Listener, tmp_path: Path, page: NodeSheet
) -> None:
    name = page.executable
    settings: dict[str, dict[str, object]] = {
        'recorder': {'out': str(tmp_path / 'bag')},
        'dashboard': {'port': 0},
        'gcs_driver': {'controller': 'gcs://127.0.0.1:1', 'timeout': 0.2},  # not there yet
    }
    processes.start(package_of(name), name, settings.get(name))
    graph = listener.node
    nodes = INSIDE.get(name, (name,))
    private = [n for n in NODES if n.executable in INSIDE.get(name, ())]

    def all_of(what: str) -> set[str]:
        own_names = resolved(getattr(page, what), name)
        return own_names.union(
            *(resolved((t for t in getattr(n, what) if '~' in t), n.executable) for n in private)
        )

    def offered(ask: Callable[[str, str], list[tuple[str, list[str]]]]) -> list[Any]:
        return [pair for node in nodes for pair in ask(node, '/')]

    def there() -> bool:
        present = set(nodes) <= set(graph.get_node_names())
        return present and bool(offered(graph.get_service_names_and_types_by_node))

    listener.until(there)
    at_times = AT_TIMES.get(name, set())
    wanted = all_of('publishes'), all_of('subscribes') - at_times

    def published() -> dict[str, str]:
        return own(offered(graph.get_publisher_names_and_types_by_node), STANDARD)

    def received() -> dict[str, str]:
        return own(offered(graph.get_subscriber_names_and_types_by_node), STANDARD)

    def services() -> set[str]:
        found = offered(graph.get_service_names_and_types_by_node)
        return set(own(found, STANDARD_SERVICES))

    # Announcements come one by one: wait for all, then nothing else may be there.
    listener.until(lambda: wanted[0] <= published().keys() and wanted[1] <= received().keys())
    listener.until(lambda: all_of('services') <= services())
    assert set(published()) == wanted[0]
    assert set(received()) - at_times == wanted[1]
    assert at_times <= all_of('subscribes')
    assert services() == all_of('services')
    for short in (*page.publishes, *page.subscribes):
        full = '/' + short.replace('~', name).lstrip('/')
        if full not in at_times:
            assert {**published(), **received()}[full] == TYPES[short]
    for action in page.actions:
        kinds = dict(offered(graph.get_service_names_and_types_by_node))
        assert f'/{action}/_action/send_goal' in kinds
