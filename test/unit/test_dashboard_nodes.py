"""How long the live page waits for the answer of a node."""

from __future__ import annotations

from typing import Any

import pytest

pytest.importorskip('rclpy', reason='the workspace is not built: run "make setup"')

from piezo_hysteresis.dashboard.backend import Answer
from piezo_hysteresis.dashboard.live_state import Live, NodeState
from piezo_hysteresis.nodes.dashboard import topic_collector as dashboard_nodes
from piezo_hysteresis.nodes.dashboard.topic_collector import TIMEOUT, NodeRegistry


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
    live.nodes['attenuation'] = NodeState('attenuation', True, 0.0)
    directory, answer = NodeRegistry(None, live), Answer()
    directory.set('attenuation', {'method': 'rls'}, answer)
    return directory, answer


def test_a_node_that_does_not_answer_is_named(now: list[float]) -> None:
    directory, answer = asked(Live('', lambda: now[0]))
    now[0] += TIMEOUT
    directory.look({'attenuation'})
    assert not answer.done
    now[0] += 0.1
    directory.look({'attenuation'})
    assert answer.reason.startswith('attenuation did not answer within 5 s')


def test_a_node_that_compiles_is_waited_for(now: list[float]) -> None:
    live = Live('', lambda: now[0])
    directory, answer = asked(live)
    for _ in range(20):
        now[0] += 1.0
        live.working['attenuation'] = now[0]
        directory.look({'attenuation'})
        assert not answer.done
    now[0] += TIMEOUT + 0.1
    directory.look({'attenuation'})
    assert answer.done
