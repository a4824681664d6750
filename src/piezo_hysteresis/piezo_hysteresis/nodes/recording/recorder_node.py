"""Records serialized messages into a bag; flushed data survive a crash."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from piezo_hysteresis.common import topics
from piezo_hysteresis.common.node_sheet import CounterWatch, Finding, Health, Level, judge
from piezo_hysteresis.common.wording import counted
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.nodes.recording.listeners import matching, message_type, offered_as_yaml
from piezo_hysteresis.parameters.node_tables import RECORDER
from piezo_hysteresis.records.definitions import MARKER, REFERENCE, STATE, definition_of
from piezo_hysteresis.records.recorder import Recorder
from piezo_hysteresis.ros.guarded import GuardedNode
from piezo_hysteresis.ros.parameters import NodeParameters
from piezo_hysteresis.ros.processes import ros_arguments
from piezo_hysteresis.ros.qos import LATCHED, LOOP
from piezo_hysteresis.ros.readiness import Diagnostics
from piezo_hysteresis.ros.running import run_node, wall_timer
from piezo_hysteresis.ros.starting import refuse_start
from piezo_hysteresis.runtime.consumer_progress import MARKED, TAKEN
from piezo_interfaces.msg import LoopStatus

# Samples between two reports, and the longest time to the next one [s]: a player waits for them.
REPORT_EVERY, REPORT_AFTER = 64, 0.05


class RecorderReport:
    """Counts the recorded messages and publishes the counts."""

    def __init__(self, node: Node) -> None:
        self._publisher = node.create_publisher(LoopStatus, '~/status', LATCHED)
        self._recorder: Recorder | None = None
        self._taken: dict[str, int] = {}
        self._reported: dict[str, int] = {}
        # a player waits for the first report of every consumer
        self._publisher.publish(LoopStatus())

    def begin(self, recorder: Recorder, counts: bool) -> None:
        """Start the reports; `counts` states whether it records states and markers."""
        self._recorder = recorder
        self._taken = {TAKEN: 0, MARKED: 0} if counts else {}
        self.publish_counts()

    def on_state(self) -> None:
        """Count a state."""
        self._taken[TAKEN] += 1
        if self._taken[TAKEN] % REPORT_EVERY == 0:
            self.publish_counts()

    def on_marker(self) -> None:
        """Count a marker."""
        self._taken[MARKED] += 1
        self.publish_counts()

    def publish_if_changed(self) -> None:
        """Publish if the counts have changed since they were last published."""
        if self._taken != self._reported:
            self.publish_counts()

    def publish_counts(self) -> None:
        """Publish the numbers of received and of stored messages."""
        if self._recorder is None:
            return
        status = self._recorder.status
        self._reported = dict(self._taken)
        counts = {
            'received': status.received,
            'written': status.written,
            'dropped': status.dropped,
            **self._taken,
        }
        message = LoopStatus(sample=status.written, missed=status.dropped)
        message.names, message.counts = list(counts), list(counts.values())
        self._publisher.publish(message)


# Topics that are recorded by default.
DEFAULT_TOPICS = (topics.STATE, topics.REFERENCE, topics.MARKER)


SENTENCES: dict[str, Finding] = {
    'dropped': (Level.ERROR, 'messages are lost: the disk is full or too slow')
}

# The bag is closed once no earlier message has arrived for this time [s].
QUIET = 0.1
LONGEST_DRAIN = 5.0

# Types of the topics whose first message must not be missed.
KNOWN_TYPES = {topics.STATE: STATE, topics.REFERENCE: REFERENCE, topics.MARKER: MARKER}


class RecorderNode(GuardedNode):
    """Subscribes to the given topics at its start, and writes all messages.

    Parameters
    ----------
    wired : bool
        Whether states and references come from topics; False if the same process calls `take`.
    """

    def __init__(self, *, wired: bool = True) -> None:
        super().__init__('recorder')
        self.exit_code = 0
        self._called = () if wired else (topics.STATE, topics.REFERENCE)
        self._take: dict[str, Callable[[bytes], None]] = {}
        Diagnostics(self, self._judge)
        self._report = RecorderReport(self)
        self._params = NodeParameters(self, RECORDER)
        out = self._params.text('out')
        if not out:
            refuse_start('give the bag to create: -p out:=FOLDER')
        try:
            self._recorder = Recorder(out)
        except PiezoError as error:
            refuse_start(str(error))
        names = [str(name) for name in self._params.values['topics'] if name]  # type: ignore[union-attr]
        self._missing = {self.resolve_topic_name(name) for name in names or DEFAULT_TOPICS}
        self._inlets: list[tuple[Subscription, Callable[[bytes], None]]] = []
        self._problem = ''
        self._watch = CounterWatch(SENTENCES)
        self._counted = self._topics_counted()
        # Announced before the subscription, so that a node that sees it can read the progress.
        self._report.begin(self._recorder, counts=len(self._counted) == 2)
        self._subscribe_ahead()
        self._look()
        wall_timer(self, 0.1, self._look)
        wall_timer(self, REPORT_AFTER, self._report.publish_if_changed)
        wall_timer(self, 1.0, self._publish_progress)

    def _topics_counted(self) -> dict[str, Callable[[], None]]:
        """Return the counter of states and markers, if both are recorded."""
        counted = {topics.STATE: self._report.on_state, topics.MARKER: self._report.on_marker}
        resolved = {self.resolve_topic_name(name): count for name, count in counted.items()}
        return resolved if resolved.keys() <= self._missing else {}

    def _subscribe_ahead(self) -> None:
        """Subscribe to the topics of the suite before their publishers start."""
        for short, kind in KNOWN_TYPES.items():
            name = self.resolve_topic_name(short)
            if name in self._missing:
                self._missing.discard(name)
                self._record(name, kind, LOOP)

    def _look(self) -> None:
        """Subscribe to wanted topics that have appeared."""
        if not self._missing:
            return
        present = dict(self.get_topic_names_and_types())
        for name in sorted(self._missing & present.keys()):
            publishers = self.get_publishers_info_by_topic(name)
            if publishers:
                self._missing.discard(name)
                self._record(name, present[name][0], matching(publishers))

    def _record(self, name: str, kind: str, qos: QoSProfile) -> None:
        try:
            definition, type_hash = definition_of(kind)
        except PiezoError as error:
            self.get_logger().warning(f'{name} is recorded without its definition: {error}')
            definition = type_hash = ''
        number = self._recorder.add_topic(
            name, kind, definition=definition, type_hash=type_hash, qos=offered_as_yaml(qos)
        )
        writer = self._writer(number, self._counted.get(name))
        self.get_logger().info(f'recording {name}')
        for short in self._called:
            if self.resolve_topic_name(short) == name:
                self._take[short] = writer
                return
        subscription = self.create_subscription(message_type(kind), name, writer, qos, raw=True)
        self._inlets.append((subscription, writer))

    def take(self, topic: str, payload: bytes) -> None:
        """Write a message of ``topics.STATE`` or ``topics.REFERENCE``, if that is recorded."""
        write = self._take.get(topic)
        if write is not None:
            write(payload)

    def _writer(self, number: int, count: Callable[[], None] | None) -> Callable[[bytes], None]:
        write, now = self._recorder.write, time.time_ns

        def on_message(payload: bytes) -> None:
            write(number, payload, now())
            if count is not None:
                count()

        return on_message

    def _publish_progress(self) -> None:
        self._report.publish_counts()
        status = self._recorder.status
        if status.problem != self._problem:
            self._problem = status.problem
            if status.problem:
                self.get_logger().error(f'nothing can be written: {status.problem}')
        for name in self._missing:
            self.get_logger().warning(f'no node publishes {name} yet', throttle_duration_sec=10.0)

    def _judge(self) -> Health:
        status = self._recorder.status
        counts = {'received': status.received, 'written': status.written}
        counts['dropped'] = status.dropped
        findings = self._watch.findings(counts)
        if status.problem:
            findings.append((Level.ERROR, f'nothing can be written: {status.problem}'))
        findings += [(Level.WARN, f'no node publishes {name} yet') for name in self._missing]
        fine = f'{counted(status.written, "message", "is")} in {self._recorder.path}'
        return judge(findings, fine, counts)

    def _drain(self) -> None:
        """Write the published messages that are still in the middleware.

        They are complete once no message has arrived for a moment, or a newer one arrives.
        """
        asked, last = time.time_ns(), time.monotonic()
        end = last + LONGEST_DRAIN  # a publisher may have a late clock
        while time.monotonic() < min(last + QUIET, end):
            for subscription, write in self._inlets:
                with subscription.handle:
                    while got := subscription.handle.take_message(subscription.msg_type, True):
                        payload, info = got
                        if info['source_timestamp'] > asked:
                            break
                        write(payload)
                        last = time.monotonic()
            time.sleep(0.1 * QUIET)

    def close(self) -> None:
        """Write all received messages and close the bag."""
        self._drain()
        status = self._recorder.close()
        text = (
            f'{self._recorder.path}: {counted(status.written, "message")}, '
            f'{status.dropped} dropped'
        )
        if status.dropped or status.problem:
            self.exit_code = 1
            problem = status.problem or 'the disk is too slow'
            self.get_logger().error(f'{text} ({problem}); what is written can be read')
        else:
            self.get_logger().info(text)


def create(*, wired: bool = True) -> RecorderNode:
    """Return the node, ready to record from its first appearance on."""
    # A client that sees the node in the graph may start immediately: slow tasks are done before.
    for kind in KNOWN_TYPES.values():
        definition_of(kind)
        message_type(kind)
    return RecorderNode(wired=wired)


def is_requested() -> bool:
    """Return whether the arguments of the process, or a parameter file, give a recorder a bag."""
    probe = Node('recorder', enable_rosout=False, start_parameter_services=False)
    out = probe._parameter_overrides.get('out')
    probe.destroy_node()
    return out is not None and bool(out.value)


def run(out: str, names: Sequence[str], namespace: str) -> int:
    """Run the recorder for the verb ``record``."""
    values = {'out': out, 'topics': list(names) or ['']}
    return run_node(create, ros_arguments(values, namespace=namespace))


def main() -> None:
    """Run the node as a process."""
    sys.exit(run_node(create))
