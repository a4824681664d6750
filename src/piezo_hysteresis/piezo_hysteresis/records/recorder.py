"""Records serialized messages of any topics into a bag that is readable at every instant.

Messages are queued by the receiving thread and written by a second thread, one chunk every 0.25 s.
Flushed data survive a crash and a full disk: see `mcap_writer`. This module does not depend on
ROS; the node passes the received bytes.
"""

from __future__ import annotations

import struct
import threading
import time
from collections import deque
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
import yaml

from piezo_hysteresis.common import plain_yaml
from piezo_hysteresis.common.plain_yaml import write_atomically
from piezo_hysteresis.common.wording import reason_of
from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records import mcap_format as mcap
from piezo_hysteresis.records.bag_content import DROPPED_KEY, RECORDING, STATE_KEY
from piezo_hysteresis.records.mcap_writer import RESERVE, McapWriter
from piezo_hysteresis.records.metadata import FileSummary, Metadata
from piezo_hysteresis.records.storage import Topic

FLUSH_INTERVAL = 0.25
METADATA_INTERVAL = 1.0
CHUNK = 1 << 22
QUEUE = 1 << 26
HEAD = struct.Struct('<BQHIQQ')


@dataclass(frozen=True)
class RecorderStatus:
    """Counters of a recorder."""

    received: int  # messages passed to the recorder
    written: int  # messages that are in the bag
    dropped: int  # messages lost because the disk was full or too slow
    problem: str  # reason why writing fails at present; empty without a problem


@dataclass(frozen=True)
class _Message:
    topic: int
    sequence: int
    log_time: int
    payload: bytes


class Recorder:
    """Writes one bag; a context manager, or `close` it."""

    def __init__(
        self,
        path: str | Path,
        *,
        flush_interval: float = FLUSH_INTERVAL,  # [s]
        split: int = RESERVE,  # [byte]
        queue: int = QUEUE,  # [byte]
    ) -> None:
        self.path = Path(path)
        self._interval, self._split, self._room = flush_interval, split, queue
        self._queue: deque[_Message] = deque()
        self._lock = threading.Lock()
        self._wake = threading.Event()
        self._closing = False
        self._topics: list[Topic] = []
        self._received: list[int] = []
        self._counts: list[int] = []
        self._dropped = 0
        self._waiting = 0
        self._problem = ''
        self._metadata_due = 0.0
        self._listed = (0, 0)  # files and topics that the metadata name
        self._files: list[FileSummary] = []
        self._create()
        self._thread = threading.Thread(target=self._run, name='recorder', daemon=True)
        self._thread.start()

    def _create(self) -> None:
        """Make the folder with its first file and metadata; it appears complete or not at all."""
        final = self.path
        try:
            if final.exists():
                raise RecordError(f'{final} exists already; remove it or choose another name')
            with write_atomically(final) as self.path:
                self.path.mkdir()
                self._writer = self._next_file(final.name)
                self._write_metadata(RECORDING)
        except OSError as error:
            reason = reason_of(error)
            raise RecordError(f'{final}: the bag cannot be created ({reason})') from None
        self.path = final

    def _next_file(self, stem: str, size: int = 0) -> McapWriter:
        name = f'{stem}_{len(self._files)}.mcap'
        writer = McapWriter(self.path / name, reserve=max(self._split, 4 * size))
        self._files.append(FileSummary(name))
        for topic in self._topics:
            writer.add_topic(topic)
        return writer

    def add_topic(
        self, name: str, msgtype: str, *, definition: str = '', type_hash: str = '', qos: str = ''
    ) -> int:
        """Return the number of a new topic."""
        topic = Topic(name, msgtype, definition, type_hash, qos)
        try:
            plain_yaml.load(qos)
        except yaml.YAMLError:
            raise RecordError(f'topic {name}: its QoS profiles are no YAML') from None
        with self._lock:
            if any(other.name == name for other in self._topics):
                raise RecordError(f'topic {name} is recorded already; record each topic once')
            self._topics.append(topic)
            self._received.append(0)
            self._counts.append(0)
            return len(self._topics)

    def write(self, topic: int, payload: bytes, log_time: int) -> bool:  # log_time [ns]
        """Queue a serialized message as received; return False if it had to be dropped."""
        with self._lock:
            sequence = self._received[topic - 1]
            self._received[topic - 1] += 1
            if self._closing or self._waiting + len(payload) > self._room:
                self._dropped += 1
                return False
            self._queue.append(_Message(topic, sequence & 0xFFFFFFFF, log_time, payload))
            self._waiting += len(payload)
            if self._waiting > CHUNK:
                self._wake.set()
            return True

    @property
    def status(self) -> RecorderStatus:
        """Counters at this instant."""
        with self._lock:
            return RecorderStatus(
                sum(self._received), sum(self._counts), self._dropped, self._problem
            )

    def close(self) -> RecorderStatus:
        """Write the queue, close the bag and return the counters.

        Only `written` messages can be read: the first ones of those that `write` accepted. If the
        disk is full, the others are lost.
        """
        with self._lock:
            self._closing = True
        self._wake.set()
        self._thread.join()
        return self.status

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _run(self) -> None:
        try:
            while not self._closing:
                self._wake.wait(self._interval)
                self._wake.clear()
                self._drain()
            self._drain()
        except Exception as error:  # what is in the bag stays; all else counts as dropped
            self._problem = f'{type(error).__name__}: {error}'
        self._finish()

    def _drain(self) -> None:
        """Write the queue chunk by chunk; what cannot be written stays for the next time."""
        try:
            while batch := self._batch():
                self._add_new_topics()
                self._append(batch)  # counted below only where a reader finds it
                with self._lock:
                    for message in batch:
                        self._queue.popleft()
                        self._waiting -= len(message.payload)
                        self._counts[message.topic - 1] += 1
            if time.monotonic() >= self._metadata_due:
                self._add_new_topics()
                self._write_metadata(RECORDING)
            self._problem = ''
        except OSError as error:
            self._problem = reason_of(error)

    def _batch(self) -> list[_Message]:
        batch, size = [], 0
        with self._lock:
            for message in self._queue:
                batch.append(message)
                size += len(message.payload)
                if size > min(CHUNK, self._split // 8):
                    break
        return batch

    def _append(self, batch: list[_Message]) -> None:
        parts, offsets, at = [], [], 0
        for m in batch:
            size = 22 + len(m.payload)
            parts.append(
                HEAD.pack(mcap.MESSAGE, size, m.topic, m.sequence, m.log_time, m.log_time)
            )
            parts.append(m.payload)
            offsets.append(at)
            at += mcap.PREFIX.size + size
        data = b''.join(parts)
        columns = (
            np.array([m.topic for m in batch], np.int64),
            np.array([m.log_time for m in batch], np.int64),
            np.array(offsets, np.int64),
        )
        if not self._writer.write_chunk(data, *columns):
            full, self._writer = self._writer, self._next_file(self.path.name, len(data))
            self._close_file(full)
            self._name_new_parts()
            self._writer.write_chunk(data, *columns)
        self._sum_up()

    def _add_new_topics(self) -> None:
        with self._lock:
            topics = self._topics[len(self._writer.topics) :]
        for topic in topics:
            self._writer.add_topic(topic)
        self._name_new_parts()

    def _name_new_parts(self) -> None:
        """Name new topics and files in the metadata: rosbags finds no others."""
        if self._listed != (len(self._files), len(self._writer.topics)):
            self._write_metadata(RECORDING)

    def _sum_up(self) -> None:
        writer, summary = self._writer, self._files[-1]
        summary.first, summary.last = writer.first, writer.last
        summary.count = sum(writer.counts)

    def _metadata(self, state: str) -> Metadata:
        counts = zip(self._topics, self._counts, strict=True)
        topics = {topic.name: (topic, count) for topic, count in counts}
        custom = {STATE_KEY: state, DROPPED_KEY: str(self._dropped)}
        return Metadata('mcap', list(self._files), topics, custom)

    def _write_metadata(self, state: str) -> None:
        with self._lock:
            metadata = self._metadata(state)
        metadata.write(self.path)
        self._listed = (len(metadata.files), len(metadata.topics))
        self._metadata_due = time.monotonic() + METADATA_INTERVAL

    def _close_file(self, writer: McapWriter) -> None:
        with self._lock:
            text = self._metadata(RECORDING).text()
        try:
            writer.close(text)
        except OSError as error:
            # A file without its index is as readable as before.
            self._problem = reason_of(error)
            writer.abandon()

    def _finish(self) -> None:
        with self._lock:
            self._closing = True
            self._dropped += len(self._queue)
            self._queue.clear()
        self._close_file(self._writer)
        try:
            self._write_metadata('closed')
        except OSError as error:
            self._problem = reason_of(error)  # the older metadata serve
