"""Plays the messages of a bag in the order of their log times, at any rate."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records.bag_content import blocks_of
from piezo_hysteresis.records.damage import Damage, DamageLog
from piezo_hysteresis.records.storage import MessageBlock, Topic


@dataclass(frozen=True)
class Played:
    """A message that is due."""

    topic: Topic  # name, type and definition
    payload: bytes  # the serialised message as it was recorded
    log_time: int  # time of recording, which is the time of ``/clock`` [ns]
    lap: int  # rounds played before, with ``loop``
    late: float  # delay of the message; 0 in lock-step [s]


class Player:
    """Iterates over the messages of a bag, waiting until each is due."""

    def __init__(
        self,
        path: str | Path,
        *,
        rate: float = 1.0,
        loop: bool = False,
        topics: Collection[str] | None = None,
        salvage: bool = False,
        clock: Callable[[], float] = time.monotonic,  # [s]
        wait: Callable[[float], object] | None = None,
    ) -> None:
        if not rate > 0:
            raise RecordError(f'the rate of playing must be positive, got {rate}')
        self.path = Path(path)
        self._rate, self._loop, self._salvage = rate, loop, salvage
        self._clock = clock
        self._stop = threading.Event()
        self._held = 0.0
        self._wait = wait or self._stop.wait
        self._wanted = None if topics is None else {'/' + name.strip('/') for name in topics}
        self.topics: dict[str, Topic] = {}
        self.count = 0
        starts: list[int] = []
        ends: list[int] = []
        log = DamageLog(salvage)
        for own, block in self._blocks(log):
            if block.topic.size:
                self.topics |= {
                    own[number].name: own[number] for number in set(block.topic.tolist())
                }
                self.count += block.topic.size
                ends.append(int(block.log_time.max()))
            starts.append(int(block.log_time.min()) if block.topic.size else 1 << 62)
        self.damage: list[Damage] = log.findings
        if not self.count:
            held = 'it holds no messages' if topics is None else 'none of the topics is in it'
            raise RecordError(f'{self.path}: {held}; see what it holds with `info {self.path}`')
        self.first, self.last = min(starts), max(ends)
        # A message is due when no later block can hold an earlier one.
        self._later = np.minimum.accumulate([*starts[1:], 1 << 62][::-1])[::-1].tolist()

    def hold(self, seconds: float) -> None:
        """Delay the remaining messages by the time of a wait [s]."""
        self._held += seconds

    def stop(self) -> None:
        """Stop playing, from any thread; a running wait is aborted."""
        self._stop.set()

    @property
    def stopped(self) -> bool:
        """Whether `stop` was called."""
        return self._stop.is_set()

    def __iter__(self) -> Iterator[Played]:
        lap = 0
        while not self._stop.is_set():
            began, self._held = self._clock(), 0.0
            for topic, payload, log_time in self._in_order():
                due = began + self._held + (log_time - self.first) * 1e-9 / self._rate
                while (left := due - self._clock()) > 0 and not self._stop.is_set():
                    self._wait(left)
                if self._stop.is_set():
                    return
                late = 0.0 if math.isinf(self._rate) else self._clock() - due
                yield Played(topic, payload, log_time, lap, late)
            if not self._loop:
                return
            lap += 1

    def _blocks(self, log: DamageLog) -> Iterator[tuple[dict[int, Topic], MessageBlock]]:
        """Yield every block cut down to the topics that are to be played."""
        for topics, block in blocks_of(self.path, log):
            names = {
                number
                for number, topic in topics.items()
                if self._wanted is None or '/' + topic.name.strip('/') in self._wanted
            }
            yield topics, block.take(np.isin(block.topic, list(names)))

    def _in_order(self) -> Iterator[tuple[Topic, bytes, int]]:
        held: list[tuple[dict[int, Topic], MessageBlock]] = []
        for later, entry in zip(self._later, self._blocks(DamageLog(salvage=True)), strict=False):
            held.append(entry)
            times = np.concatenate([block.log_time for _, block in held])
            owner = np.repeat(range(len(held)), [block.topic.size for _, block in held])
            inner = np.concatenate([np.arange(block.topic.size) for _, block in held])
            order = np.argsort(times, kind='stable')
            due = order[times[order] <= later]
            for which, index, log_time in zip(
                owner[due].tolist(), inner[due].tolist(), times[due].tolist(), strict=True
            ):
                topics, block = held[which]
                yield topics[int(block.topic[index])], block.payload(index), log_time
            held = [(topics, block.take(block.log_time > later)) for topics, block in held]
            held = [(topics, block) for topics, block in held if block.topic.size]
