"""Who takes in what a player plays, and how far each of them is."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from rclpy.node import Node
from rclpy.publisher import Publisher

from piezo_hysteresis.errors import PiezoError
from piezo_interfaces.msg import LoopStatus
from piezo_ros_common.qos import LATCHED


@dataclass
class Progress:
    """How many samples and markers a node says it has received since it was started."""

    taken: int = -1
    marked: int = -1
    first: int = 0


class Listeners:
    """The nodes that report on ``~/status`` how many samples they have taken in.

    Parameters
    ----------
    node : Node
        That plays; its executor must be served by another thread than the one that waits here.
    topic : str
        Topic of the samples.
    patience : callable
        Returns the longest wait [s].

    Attributes
    ----------
    awaited : str
        Whose word is waited for at this moment; empty for nobody's.
    since : float
        Since when [s], on the monotonic clock.
    """

    def __init__(self, node: Node, topic: str, patience: Callable[[], float]) -> None:
        self._node = node
        self._topic = topic
        self._patience = patience
        self.awaited = ''
        self.since = 0.0
        self._condition = threading.Condition()
        self._progress: dict[str, Progress] = {}

    def find(self) -> None:
        """Wait until somebody reports.

        Raises
        ------
        PiezoError
            If nobody does.
        """
        end = time.monotonic() + self._patience()
        while not self._known():
            self._subscribe()
            if time.monotonic() > end or not self._node.context.ok():
                raise PiezoError(
                    'lock-step needs a listener that reports how far it is: start the '
                    'identification node first, or play without --lock-step'
                )
            time.sleep(0.02)

    def wait_matched(self, publishers: Sequence[Publisher]) -> None:
        """Wait until everybody is connected to every publisher.

        Raises
        ------
        PiezoError
            If somebody is not.
        """
        end = time.monotonic() + self._patience()
        wanted = len(self._known())
        while any(each.get_subscription_count() < wanted for each in publishers):
            if time.monotonic() > end or not self._node.context.ok():
                raise PiezoError('the listeners could not be connected; start them and play again')
            time.sleep(0.02)

    def wait_marked(self, publish: Callable[[], None]) -> None:
        """Publish a marker and wait until everybody has received it."""
        with self._condition:
            wanted = {name: known.marked + 1 for name, known in self._known().items()}
        publish()
        self._wait(lambda name, known: known.marked >= wanted.get(name, 0), 'a marker')

    def begin(self) -> None:
        """Count samples from here on."""
        with self._condition:
            for known in self._known().values():
                known.first = known.taken

    def wait_taken(self, sent: int, window: int = 0) -> None:
        """Wait until everybody has received all but `window` of the `sent` samples."""
        self._wait(lambda _, known: sent - (known.taken - known.first) <= window, f'sample {sent}')

    def _known(self) -> dict[str, Progress]:
        return {name: known for name, known in self._progress.items() if known.taken >= 0}

    def _wait(self, reached: Callable[[str, Progress], bool], what: str) -> None:
        def behind() -> list[str]:
            return [name for name, known in self._known().items() if not reached(name, known)]

        begun = time.monotonic()

        def patient() -> bool:
            return time.monotonic() - begun < self._patience() and self._node.context.ok()

        with self._condition:
            # In short steps, so that a node that is shut down meanwhile ends too.
            while (late := behind()) and patient():
                self.awaited, self.since = ', '.join(late), begun
                self._condition.wait(0.1)
            self.awaited = ''
        if late and self._node.context.ok():
            raise PiezoError(
                f'{", ".join(late)} did not take {what} within {self._patience():g} s: it died or '
                'is overloaded; restart it and play again'
            )

    def _subscribe(self) -> None:
        present = {name for name, _ in self._node.get_topic_names_and_types()}
        for info in self._node.get_subscriptions_info_by_topic(self._topic):
            name = f'{info.node_namespace.rstrip("/")}/{info.node_name}'
            if name not in self._progress and f'{name}/status' in present:
                known = self._progress[name] = Progress()
                self._node.create_subscription(
                    LoopStatus, f'{name}/status', self._noted(known), LATCHED
                )

    def _noted(self, known: Progress) -> Callable[[LoopStatus], None]:
        def on_status(message: LoopStatus) -> None:
            counts = dict(zip(message.names.split(','), message.counts, strict=False))
            with self._condition:
                known.taken = counts.get('taken', -1)
                known.marked = counts.get('marked', -1)
                self._condition.notify_all()

        return on_status
