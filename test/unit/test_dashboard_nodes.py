"""How long the live page waits for the answer of a node."""

from __future__ import annotations

from typing import Any

import pytest

pytest.importorskip('rclpy', reason='the workspace is not built: run "make setup"')

from piezo_hysteresis.common.topics import nodes_of
from piezo_hysteresis.dashboard.backend import Answer
from piezo_hysteresis.dashboard.live_state import Live
from piezo_hysteresis.nodes.dashboard import topic_collector as dashboard_nodes
from piezo_hysteresis.nodes.dashboard.topic_collector import TIMEOUT, NodeRegistry

PRESENT = {'attenuation': '/attenuation'}


class Silent:
    """A client whose node never answers."""

    def __init__(self, *_: Any) -> None:
        pass

    def services_are_ready(self) -> bool:
        return False

    def set_parameters(self, *_: Any, **__: Any) -> None:
        pass


@pytest.fixture
def now(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    monkeypatch.setattr(dashboard_nodes, 'AsyncParameterClient', Silent)
    return [100.0]


def asked(live: Live) -> tuple[NodeRegistry, Answer]:
    directory, answer = NodeRegistry(None, live), Answer()
    directory.look(PRESENT)
    directory.set('attenuation', {'method': 'rls'}, answer)
    return directory, answer


def test_a_node_that_does_not_answer_is_named(now: list[float]) -> None:
    directory, answer = asked(Live('', lambda: now[0]))
    now[0] += TIMEOUT
    directory.look(PRESENT)
    assert not answer.done
    now[0] += 0.1
    directory.look(PRESENT)
    assert answer.reason.startswith('attenuation did not answer within 5 s')


def test_a_node_that_compiles_is_waited_for(now: list[float]) -> None:
    live = Live('', lambda: now[0])
    directory, answer = asked(live)
    for _ in range(20):
        now[0] += 1.0
        live.working['attenuation'] = now[0]
        directory.look(PRESENT)
        assert not answer.done
    now[0] += TIMEOUT + 0.1
    directory.look(PRESENT)
    assert answer.done


def test_an_axis_has_its_own_nodes_and_those_of_all_axes() -> None:
    every = [
        '/lab/excitation_1',
        '/lab/excitation_2',
        '/lab/coupled',
        '/simulator',
        '/lab/axis_1/x',
    ]
    found = nodes_of('lab/axis_2', every)
    assert found == {'excitation': '/lab/excitation_2', 'coupled': '/lab/coupled'}
    assert nodes_of('axis_1', every) == {'simulator': '/simulator'}
    assert nodes_of('', every) == {'simulator': '/simulator'}
    assert nodes_of('lab', every)['excitation_2'] == '/lab/excitation_2'
