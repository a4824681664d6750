"""The live page: ROS in this thread, the web server in another, `Live` as interface."""

from __future__ import annotations

import argparse
import queue
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from rcl_interfaces.msg import ParameterEvent
from rclpy.node import Node

from piezo_hysteresis.common import topics
from piezo_hysteresis.common.node_sheet import CounterWatch, Health, Level, judge
from piezo_hysteresis.dashboard.backend import Answer, DiscoveryOrder, Order, SweepOrder
from piezo_hysteresis.dashboard.controls import Value
from piezo_hysteresis.dashboard.live_state import BackgroundJob, Live
from piezo_hysteresis.dashboard.page_server import DashboardServer
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.nodes.dashboard.jobs import Jobs
from piezo_hysteresis.nodes.dashboard.topic_collector import (
    NodeRegistry,
    SharedTopics,
    TopicCollector,
    shown,
)
from piezo_hysteresis.parameters.node_tables import DASHBOARD, configure
from piezo_hysteresis.ros.guarded import GuardedNode
from piezo_hysteresis.ros.parameters import NodeParameters
from piezo_hysteresis.ros.processes import ros_arguments
from piezo_hysteresis.ros.readiness import Diagnostics
from piezo_hysteresis.ros.running import run_node, wall_timer
from piezo_hysteresis.ros.starting import refuse_start

LISTEN_EVERY = 0.03
LAG = 1.0  # time without polling after which it is counted [s]
LOOK_EVERY = 1.0
MOST_ACTUATORS = 100
STATE_TYPE = 'piezo_interfaces/msg/ActuatorState'


class ActuatorSession:
    """Topics, nodes and jobs of one actuator."""

    def __init__(self, node: Node, live: Live, folder: Path) -> None:
        self.live = live
        self._node = silent_node(node, 'dashboard_listener', live.actuator)
        self.collector = TopicCollector(self._node, live)
        self.directory = NodeRegistry(node, live)
        self.jobs = Jobs(node, live, folder)

    def watch(self) -> None:
        """Update nodes and services; called about once a second."""
        self.jobs.watch()

    def close(self) -> None:
        """End the verbs that run, and all subscriptions."""
        self.jobs.close()
        self._node.destroy_node()


def silent_node(node: Node, name: str, namespace: str = '') -> Node:
    """Return a node in no executor: its subscriptions are served by the caller."""
    return Node(
        name,
        namespace=namespace,
        context=node.context,
        start_parameter_services=False,
        enable_rosout=False,
        use_global_arguments=False,
    )


class Dashboard(GuardedNode):
    """Serves the page and implements its `Backend`; callable from any thread."""

    def __init__(self) -> None:
        super().__init__('dashboard')
        self._params = NodeParameters(self, DASHBOARD)
        self._folder = Path(self._params.text('folder')).expanduser()
        self._requests: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._due: list[tuple[float, Callable[[], None]]] = []
        self._sessions: dict[str, ActuatorSession] = {}
        self._lives: dict[str, Live] = {}
        self._found: list[str] = []
        self._collector_node = silent_node(self, 'dashboard_ear')
        self._common = SharedTopics(self._collector_node, self._lives_of, self._on_event)
        self._look()
        self._server = self._serve()
        self._ticked, self._lags = self._now(), 0
        self._watch = CounterWatch(
            {'lags': (Level.WARN, 'the page lags: the machine is too slow')}
        )
        Diagnostics(self, self._health)
        wall_timer(self, LISTEN_EVERY, self._tick)
        wall_timer(self, LOOK_EVERY, self._look)

    def _serve(self) -> DashboardServer:
        try:
            server = DashboardServer(
                self,
                address=self._params.text('address'),
                port=self._params.integer('port'),
                folder=str(self._folder.resolve()),
                origins=self._words('origins'),
                token=self._params.text('token'),
                refresh=self._params.number('refresh'),
            )
        except PiezoError as error:
            refuse_start(error)
        if not server.local and not self._params.text('token'):
            self.get_logger().warning(
                f'anyone who reaches port {server.port} of this machine can move the actuator: '
                'set token, or leave address at 127.0.0.1'
            )
        server.start()
        self.get_logger().info(f'open {server.url}')
        return server

    def _words(self, name: str) -> list[str]:
        return [str(text) for text in self._params.values[name] if text]  # type: ignore[union-attr]

    # --- in the thread of ROS ------------------------------------------------------------------

    def _tick(self) -> None:
        while not self._requests.empty():
            self._requests.get()()
        now = self._now()
        self._lags += now - self._ticked > LAG
        self._ticked = now
        for entry in [entry for entry in self._due if entry[0] <= now]:
            self._due.remove(entry)
            entry[1]()
        self._common.poll()
        for session in self._sessions.values():
            session.collector.poll()

    def _health(self) -> Health:
        findings = self._watch.findings({'lags': self._lags})
        if not self._server.running:
            findings.append((Level.ERROR, 'the web server has ended: start the dashboard again'))
        fine = f'serves {self._server.url}'
        values = {
            'actuators': ', '.join(self._found),
            'looked_at': len(self._sessions),
            'lags': self._lags,
        }
        return judge(findings, fine, values)

    def _now(self) -> float:
        return time.monotonic()

    def _later(self, seconds: float, what: Callable[[], None]) -> None:
        self._due.append((self._now() + seconds, what))

    def _look(self) -> None:
        self._found = self._find_actuators()
        every = [
            f'{space.rstrip("/")}/{name}'
            for name, space in self.get_node_names_and_namespaces()
            if shown(name)
        ]
        for actuator, session in self._sessions.items():
            publishers = self.get_publishers_info_by_topic(session.collector.topic(topics.STATE))
            session.live.published = bool(publishers)
            if publishers:
                session.collector.counting = publishers[0].node_name
            session.directory.look(topics.nodes_of(actuator, every))
            session.watch()

    def _wanted(self) -> list[str]:
        """Return the configured namespaces, empty if all are shown."""
        own = self.get_namespace().strip('/')
        named = [name.strip('/') for name in self._words('actuators')]
        return named or ([own] if own else [])

    def _find_actuators(self) -> list[str]:
        names = self._wanted()
        return names or sorted(
            name.removesuffix(topics.STATE).strip('/')
            for name, types in self.get_topic_names_and_types()
            if STATE_TYPE in types
            and name.endswith(f'/{topics.STATE}')
            and self.count_publishers(name)
        )

    def _lives_of(self, full: str) -> list[tuple[Live, str]]:
        """Return the actuators to which a node belongs, with its name there."""
        return [
            (live, name)
            for actuator, live in list(self._lives.items())  # a page may add one
            for name in topics.nodes_of(actuator, [full])
        ]

    def _on_event(self, event: ParameterEvent) -> None:
        for live, name in self._lives_of(event.node):
            session = self._sessions.get(live.actuator)
            if session is not None:
                session.directory.follow(name, event)

    def _open(self, live: Live) -> None:
        self._sessions[live.actuator] = ActuatorSession(self, live, self._folder)
        self._look()

    # --- from the threads of the page ----------------------------------------------------------

    def actuators(self) -> list[str]:
        """Return the discovered namespaces, never an empty list."""
        return self._found or ['']

    def allows(self, actuator: str) -> bool:
        """Return whether a requested namespace may be shown."""
        names = self._wanted()
        return actuator in names if names else len(self._lives) < MOST_ACTUATORS

    def live(self, actuator: str) -> Live:
        """Return the state of an actuator."""
        if actuator not in self._lives:
            live = self._lives[actuator] = Live(actuator)
            self._requests.put(lambda: self._open(live))
        return self._lives[actuator]

    def set_parameters(self, actuator: str, node: str, values: Mapping[str, Value]) -> Answer:
        """Set parameters of a node."""
        answer = Answer()
        self._request(actuator, lambda session: session.directory.set(node, values, answer))
        return answer

    def start(self, actuator: str, order: Order) -> None:
        """Start a job; a sweep first ends the running experiment."""
        setattr(self.live(actuator), order.kind, BackgroundJob('asked', 0.0, 'starts'))
        self._request(actuator, lambda session: self._begin(session, order))

    def _begin(self, session: ActuatorSession, order: Order) -> None:
        if isinstance(order, SweepOrder):
            self._rest_then_sweep(session, order)
        elif isinstance(order, DiscoveryOrder):
            session.jobs.run_discovery(order)
        else:
            session.jobs.run_investigation(order)

    def _rest_then_sweep(self, session: ActuatorSession, order: SweepOrder) -> None:
        mode = session.live.parameter('excitation', 'mode')
        answer = Answer()
        if mode is None or mode.value == 'idle':
            answer.give()
        else:
            session.directory.set('excitation', {'mode': 'idle'}, answer)

        def go_on() -> None:
            if not answer.done:
                self._later(LISTEN_EVERY, go_on)
            elif answer.reason:
                session.live.sweep = BackgroundJob('failed', 0.0, answer.reason)
            else:
                session.jobs.run_sweep(order)

        go_on()

    def cancel(self, actuator: str, kind: str) -> None:
        """Cancel a job; a driven actuator returns to rest."""
        self._request(actuator, lambda session: session.jobs.by_kind[kind].cancel())

    def bags(self, actuator: str) -> list[str]:
        """Return the recorded bags, the newest first."""
        session = self._sessions.get(actuator)
        return session.jobs.bags() if session is not None else []

    def _request(self, actuator: str, what: Callable[[ActuatorSession], None]) -> None:
        self.live(actuator)
        self._requests.put(lambda: what(self._sessions[actuator]))

    def close(self) -> None:
        """End the server and close open recordings."""
        self._server.stop()
        for session in self._sessions.values():
            session.close()
        self._collector_node.destroy_node()


def dashboard_arguments(arguments: Sequence[str]) -> list[str]:
    """Return the arguments for ROS: options of the verb, and those after ``--ros-args``."""
    options = list(arguments)
    cut = options.index('--ros-args') if '--ros-args' in options else len(options)
    parser = argparse.ArgumentParser(prog='dashboard')
    configure(parser)
    given = parser.parse_args(options[:cut])
    values = {name: getattr(given, name) for name in ('folder', 'port', 'address')}
    known = {name: value for name, value in values.items() if value is not None}
    return [*ros_arguments(known, namespace=given.namespace or ''), *options[cut + 1 :]]


def run(arguments: Sequence[str]) -> int:
    """Run the page for the verb ``dashboard``."""
    return run_node(Dashboard, dashboard_arguments(arguments))


def main() -> None:
    """Run the node as a process."""
    sys.exit(run(sys.argv[1:]))
