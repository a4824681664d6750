"""Readiness of a node, its diagnostics and its neighbours."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterable
from enum import StrEnum

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.duration import Duration
from rclpy.node import Node

from piezo_hysteresis.common.node_sheet import HOLD, Health, Level
from piezo_hysteresis.kernels import watch
from piezo_hysteresis.ros.guarded import Guarded
from piezo_hysteresis.ros.running import wall_timer

# Period of heartbeats, and the longest time between two messages of diagnostics [s].
PERIOD = 1.0

# Shorter compilations are not reported [s].
SHORT = 0.3


class Readiness(StrEnum):
    """Whether a node can respond."""

    STARTING = 'starting'
    COMPILING = 'compiling'
    READY = 'ready'


WORKS = (Readiness.STARTING, Readiness.COMPILING)


class HeartbeatPublisher:
    """Publishes that a node starts, until `ready` is called, and later compilations."""

    def __init__(
        self,
        publish: Callable[[Readiness, str], None],
        compiles: Callable[[], None] = lambda: None,
    ) -> None:
        self._publish_state = publish
        self._compiles = compiles
        self._reported = self._closed = self._ready = False
        self._wake = threading.Event()
        self._thread: threading.Thread | None = None
        self._started = time.monotonic()
        watch.LISTENERS.append(self._start)
        self._publish()
        self._start()

    def ready(self) -> None:
        """Mark the node as ready."""
        self._ready = True
        self._wake.set()

    def close(self) -> None:
        """Stop publishing."""
        self._closed = True
        if self._start in watch.LISTENERS:
            watch.LISTENERS.remove(self._start)
        self._wake.set()

    def _start(self) -> None:
        thread = self._thread
        if not self._closed and (thread is None or not thread.is_alive()):
            self._started = time.monotonic() if self._ready else self._started
            self._wake.clear()
            self._thread = threading.Thread(target=self._run, name='herald', daemon=True)
            self._thread.start()

    def _run(self) -> None:
        self._wake.wait(SHORT)
        while not self._closed and (watch.compiling() or not self._ready):
            # the publisher may be destroyed before this thread ends
            with contextlib.suppress(Exception):
                self._publish()
            self._wake.clear()
            self._wake.wait(PERIOD)

    def _publish(self) -> None:
        compiles, seconds = watch.compiling(), time.monotonic() - self._started
        if compiles and not self._reported:
            self._reported = True
            # rclpy searches all modules for the caller of a logger: while another
            # thread compiles, this takes seconds and must not delay the heartbeats
            threading.Thread(target=self._log, name='heartbeat log', daemon=True).start()
        state = Readiness.COMPILING if self._ready else Readiness.STARTING
        values = [state.value] if state is Readiness.STARTING else []
        values += ['compiles its kernels (first start only)'] if compiles else []
        self._publish_state(state, f'{": ".join(values)} ({seconds:.0f} s)')

    def _log(self) -> None:
        with contextlib.suppress(Exception):  # the node may be destroyed
            self._compiles()


# Heartbeat timeout [s]; the heartbeat period is 1 s.
FRESH = 5.0


class Heartbeats:
    """The last heartbeat of every node of a graph."""

    def __init__(self, now: Callable[[], float] = time.monotonic) -> None:  # now [s]
        self._now = now
        self._reported_states: dict[str, tuple[str, str, float]] = {}
        self._met: dict[str, float] = {}
        self.newest = float('-inf')

    def note(self, name: str, state: str, words: str) -> None:
        """Record the heartbeat of the node `name`.

        `newest` is the time of the last heartbeat with a working state [s].
        """
        now = self._now()
        self._reported_states[name.strip('/')] = (state, words, now)
        if state in WORKS:
            self.newest = now

    def update_discovered(self, names: Iterable[str]) -> None:
        """Update the discovered nodes; nodes that have ended are removed."""
        now = self._now()
        self._met = {name: self._met.get(name, now) for name in (n.strip('/') for n in names)}

    def awaiting_first_heartbeat(self) -> list[str]:
        """Return newly discovered nodes without a first heartbeat."""
        now = self._now()
        return sorted(
            name
            for name, met in self._met.items()
            if name not in self._reported_states and now - met < FRESH
        )

    def silence(self) -> float:
        """Return the time since the last heartbeat of a working node [s], infinite without one."""
        return self._now() - self.newest

    def is_ready(self, name: str) -> bool:
        """Return whether the node `name` has reported that it is ready."""
        return self._reported_states.get(name.strip('/'), ('',))[0] == Readiness.READY

    def working(self) -> str:
        """Return the working nodes and their tasks, empty if there are none."""
        now = self._now()
        return ', '.join(
            f'{name}: {work}'
            for name, (state, work, received) in sorted(self._reported_states.items())
            if state in WORKS and now - received < FRESH
        )


TOPIC = '/diagnostics'

# Period of the check for a change of level [s].
LOOK = 0.2

# Timeout for the delivery of the final status of a node.
FINAL_STATUS_TIMEOUT = Duration(seconds=1)


# Key of the value that states whether the node can respond.
STATE = 'state'


class Diagnostics:
    """Publishes the health of a node; create it before any slow initialization."""

    def __init__(self, node: Guarded, ask: Callable[[], Health]) -> None:
        self._node = node
        self._ask = ask
        self._level: Level | None = None
        self._reported = 0.0
        # That of a managed node would be mute while the node is inactive.
        self._publisher = Node.create_publisher(node, DiagnosticArray, TOPIC, 10)
        self._heartbeat = HeartbeatPublisher(self._starts, self._compiles)
        node.context.on_shutdown(self._heartbeat.close)
        wall_timer(node, LOOK, self.look)

    def look(self) -> None:
        """Publish if the level has changed or one second has elapsed."""
        self._heartbeat.ready()
        now = time.monotonic()
        health = self._with_failures(self._ask(), now)
        if health.level == self._level and now - self._reported < PERIOD - 0.5 * LOOK:
            return
        self._level, self._reported = health.level, now
        self._publish(Readiness.READY, health)

    def _with_failures(self, health: Health, now: float) -> Health:
        """Add failures of callbacks: an error for a while, then a count."""
        node = self._node
        if not node.callback_failures:
            return health
        values = {**health.values, 'callback_failures': node.callback_failures}
        if now - node.last_failed > HOLD:
            return Health(health.level, health.message, values)
        return Health(Level.ERROR, f'a callback failed: {node.last_failure}', values)

    def _starts(self, state: Readiness, message: str) -> None:
        self._publish(state, Health(Level.OK, message))

    def _compiles(self) -> None:
        self._node.get_logger().info(
            'compiles its kernels (first start only); waiting nodes extend their timeouts'
        )

    def _publish(self, state: Readiness, health: Health) -> None:
        values = {STATE: state.value, **health.values}
        status = DiagnosticStatus(
            level=bytes([health.level]),
            name=self._node.get_fully_qualified_name(),
            message=health.message,
            hardware_id=self._node.get_namespace().strip('/'),
            values=[KeyValue(key=key, value=_text(v)) for key, v in values.items()],
        )
        array = DiagnosticArray(status=[status])
        array.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(array)

    def publish_final_status(self) -> None:
        """Publish the final status and wait until it is delivered."""
        self._level = None
        self.look()
        self._publisher.wait_for_all_acked(FINAL_STATUS_TIMEOUT)


def state_of(status: DiagnosticStatus) -> str:
    """Return the reported state of a node, empty if there is none."""
    return next((str(each.value) for each in status.values if each.key == STATE), '')


def _text(value: object) -> str:
    return f'{value:.6g}' if isinstance(value, float) else str(value)


class Neighbours(Heartbeats):
    """The other nodes of a namespace."""

    def __init__(self, node: Node, *, everywhere: bool = False) -> None:
        super().__init__()
        self._node = node
        self._own = node.get_fully_qualified_name()
        self._place = None if everywhere else node.get_namespace().strip('/')
        node.create_subscription(DiagnosticArray, TOPIC, self._on_diagnostics, 10)

    def look(self) -> None:
        """Update the discovered nodes: each node publishes a heartbeat once it is created."""
        there = {
            f'{info.node_namespace.rstrip("/")}/{info.node_name}'
            for info in self._node.get_publishers_info_by_topic(TOPIC)
            if self._place is None or info.node_namespace.strip('/') == self._place
        }
        self.update_discovered(there - {self._own})

    def _on_diagnostics(self, array: DiagnosticArray) -> None:
        for status in array.status:
            there = self._place is None or status.hardware_id == self._place
            if there and status.name != self._own:
                self.note(status.name, state_of(status), status.message)
