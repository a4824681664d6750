"""Who else starts or compiles at this moment."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable

from piezo_hysteresis.ros.herald import WORKS, Readiness

# Who says nothing for so long is not taken to work any more [s]; everybody speaks every second.
FRESH = 5.0


class WorkBook:
    """Remembers what the nodes of a graph said of themselves last.

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

    def meet(self, names: Iterable[str]) -> None:
        """Take note of who is there and could speak; who has gone is forgotten."""
        now = self._now()
        self._met = {name: self._met.get(name, now) for name in (n.strip('/') for n in names)}

    def unheard(self) -> list[str]:
        """Return who came a moment ago and has not said a word yet: it is about to."""
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
