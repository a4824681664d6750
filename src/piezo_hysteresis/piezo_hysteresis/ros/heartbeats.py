"""Heartbeats of the nodes that start or compile."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable

from piezo_hysteresis.ros.readiness import WORKS, Readiness

# Heartbeat timeout [s]; the heartbeat period is 1 s.
FRESH = 5.0


class Heartbeats:
    """The last heartbeat of every node of a graph.

    Parameters
    ----------
    now : callable, optional
        Clock [s].
    """

    def __init__(self, now: Callable[[], float] = time.monotonic) -> None:
        self._now = now
        self._said: dict[str, tuple[str, str, float]] = {}
        self._met: dict[str, float] = {}
        self.newest = float('-inf')

    def note(self, name: str, state: str, words: str) -> None:
        """Take note that the node `name` is in `state`.

        `newest` becomes the time at which a node last said that it works [s].
        """
        now = self._now()
        self._said[name.strip('/')] = (state, words, now)
        if state in WORKS:
            self.newest = now

    def update_discovered(self, names: Iterable[str]) -> None:
        """Update the discovered nodes; those that are gone are removed."""
        now = self._now()
        self._met = {name: self._met.get(name, now) for name in (n.strip('/') for n in names)}

    def awaiting_first_heartbeat(self) -> list[str]:
        """Return newly discovered nodes without a first heartbeat."""
        now = self._now()
        return sorted(
            name for name, met in self._met.items() if name not in self._said and now - met < FRESH
        )

    def quiet(self) -> float:
        """Return how long no node has said that it works [s]; infinite where none ever did."""
        return self._now() - self.newest

    def is_ready(self, name: str) -> bool:
        """Return whether the node `name` has said that it can answer."""
        return self._said.get(name.strip('/'), ('',))[0] == Readiness.READY

    def working(self) -> str:
        """Return who works and at what, empty where nobody does."""
        now = self._now()
        return ', '.join(
            f'{name}: {work}'
            for name, (state, work, received) in sorted(self._said.items())
            if state in WORKS and now - received < FRESH
        )
