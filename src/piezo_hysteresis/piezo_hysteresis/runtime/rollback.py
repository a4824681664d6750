"""Rollback buffer for samples that were used before their marker arrived."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from itertools import islice
from typing import Generic, NamedTuple, TypeVar

# Samples between two memories, and how many memories are kept: seconds of a loop at 1 kHz.
EVERY = 1024
KEPT = 6

State = TypeVar('State')


class Sample(NamedTuple):
    """A sample of an actuator as received."""

    number: int
    nanoseconds: int
    voltage: float
    displacement: float


@dataclass(frozen=True)
class Checkpoint(Generic[State]):
    """The state of a recursion before the sample with arrival number `count`."""

    count: int
    nanoseconds: int
    state: State


class RollbackBuffer(Generic[State]):
    """Remembers the last samples, and now and then the state that they acted on."""

    def __init__(self, remember: Callable[[], State]) -> None:
        self._remember = remember
        self._memories: deque[Checkpoint[State]] = deque(maxlen=KEPT)
        self._samples: deque[Sample] = deque(maxlen=EVERY * KEPT)
        self._count = 0

    @property
    def newest(self) -> int:
        """Time of the newest sample [ns], -1 if there is none."""
        return self._samples[-1].nanoseconds if self._samples else -1

    def note(self, sample: Sample) -> None:
        """Remember a sample; call it before the sample acts."""
        if self._count % EVERY == 0:
            self._memories.append(Checkpoint(self._count, self.newest, self._remember()))
        self._samples.append(sample)
        self._count += 1

    def clear(self) -> None:
        """Clear the buffer; earlier samples cannot be rolled back."""
        self._memories.clear()
        self._samples.clear()
        self._count = 0

    def back_to(self, nanoseconds: int) -> tuple[Checkpoint[State], list[Sample]] | None:
        """Return the newest checkpoint before a time and the samples since; None if too old.

        Later checkpoints are discarded with their samples; store the samples again.
        """
        while self._memories and self._memories[-1].nanoseconds >= nanoseconds:
            self._memories.pop()
        if not self._memories:
            self.clear()
            return None
        memory = self._memories.pop()
        first = len(self._samples) - (self._count - memory.count)
        since = list(islice(self._samples, first, None))
        for _ in since:
            self._samples.pop()
        self._count = memory.count
        return memory, since
