"""Health of a node: level, sentence, and the numbers behind them."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from enum import IntEnum

# How long something that happened still counts as present [s].
HOLD = 5.0


class Level(IntEnum):
    """The levels of diagnostic_msgs/DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2


@dataclass(frozen=True)
class Health:
    """Health report of a node."""

    level: Level  # OK, warning or error
    message: str  # one sentence
    values: Mapping[str, object] = field(default_factory=dict)


Finding = tuple[Level, str]


def judge(findings: Iterable[Finding], fine: str, values: Mapping[str, object]) -> Health:
    """Return the health from `findings`: the worst level with its sentences."""
    found = list(findings)
    level = max((each for each, _ in found), default=Level.OK)
    worst = [sentence for each, sentence in found if each == level > Level.OK]
    return Health(level, '; '.join(worst) or fine, values)


class CounterWatch:
    """Converts recently increased counters to findings."""

    def __init__(
        self, sentences: Mapping[str, Finding], now: Callable[[], float] = time.monotonic
    ) -> None:  # now [s]
        #: Meaning of an increase of each counter; may be replaced at any time.
        self.sentences = sentences
        self._now = now
        self._before: dict[str, int] = {}
        self._grown: dict[str, float] = {}

    def findings(self, counts: Mapping[str, int]) -> list[Finding]:
        """Return what the growth of `counts` within the last `HOLD` seconds means."""
        now = self._now()
        for name, count in counts.items():
            if count > self._before.get(name, 0):
                self._grown[name] = now
            self._before[name] = count
        return [
            (level, f'{sentence} ({name} {self._before[name]})')
            for name, (level, sentence) in self.sentences.items()
            if now - self._grown.get(name, -HOLD) < HOLD
        ]
