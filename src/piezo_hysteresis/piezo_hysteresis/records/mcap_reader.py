"""Reads MCAP files chunk by chunk, with or without a usable index.

The index is not required: chunks are found by a scan of the records, their checksums are verified,
and the counts of the index are compared with the content.
"""

from __future__ import annotations

import struct
from collections.abc import Generator
from pathlib import Path
from typing import BinaryIO
from zlib import crc32

import numpy as np

from piezo_hysteresis.common.wording import counted
from piezo_hysteresis.records import mcap_format as mcap
from piezo_hysteresis.records.damage import DamageLog
from piezo_hysteresis.records.storage import RATIO, SMALL, MessageBlock, Topic, inflated

WINDOW = 1 << 22
WANTED = (mcap.SCHEMA, mcap.CHANNEL, mcap.MESSAGE, mcap.CHUNK)


class McapFile:
    """One MCAP file, read once from front to back."""

    def __init__(self, path: Path, log: DamageLog) -> None:
        self.path = path
        self.log = log.at(path)
        self.topics: dict[int, Topic] = {}
        self.finished = False
        self._schemas: dict[int, tuple[str, str, str]] = {}
        self._size = path.stat().st_size
        self._messages = self._total = 0
        self._expected: int | None = None
        self._chunk_starts: list[int] = []
        self._data_end = 0

    def blocks(self) -> Generator[MessageBlock]:
        """Yield the messages of every chunk (and of every stretch without chunks)."""
        if self._size == 0:
            self.log.add('the file is empty')
            return
        with self.path.open('rb') as file:
            if file.read(len(mcap.MAGIC)) != mcap.MAGIC:
                self.log.add('this is not an MCAP file or its beginning is damaged')
            self._read_summary(file)
            for block in self._data(file):
                self._messages += block.topic.size
                yield block
        if self._expected is not None and self._expected != self._messages:
            self.log.add(
                f'the index counts {counted(self._expected, "message")} but '
                f'{self._messages} can be read',
                count=abs(self._expected - self._messages),
                lost=max(self._expected - self._messages, 0),
            )

    def _read_summary(self, file: BinaryIO) -> None:
        """Read topics, counts and offsets of chunks from the index, if there is one."""
        file.seek(max(self._size - 37, 0))
        ending = file.read()
        if len(ending) != 37 or not ending.endswith(mcap.MAGIC) or ending[0] != mcap.FOOTER:
            self.log.add('the file ends early, so its writer was stopped or it was cut')
            return
        start, _, crc = struct.unpack('<QQI', ending[9:29])
        if start == 0:
            self._data_end = self._size - 37
            self.log.note('the recording was not closed; all that was flushed is read')
            return
        if not 8 < start < self._size - 37:
            self.log.add('its footer points to no index')
            return
        self._data_end = start
        file.seek(start)
        summary = file.read(self._size - 37 - start)
        if crc and crc32(summary + ending[:25]) != crc:
            self.log.add('the checksum of its index is wrong')
            return
        walk = mcap.walk(np.frombuffer(summary, np.uint8))
        if walk.stop != len(summary):
            self.log.add('its index is broken')
        for opcode, offset, length in walk.others.tolist():
            self._take(opcode, summary[offset : offset + length])
        self.finished = True

    def _take(self, opcode: int, content: bytes) -> None:
        """Take schemas, channels and statistics; a field that cannot be read is damage."""
        try:
            self._take_fields(opcode, mcap.Cursor(content))
        except ValueError as error:
            self.log.add(f'a record cannot be read ({error})')

    def _take_fields(self, opcode: int, cursor: mcap.Cursor) -> None:
        if opcode == mcap.SCHEMA:
            number = cursor.number('H')
            name, encoding = cursor.text(), cursor.text()
            self._schemas[number] = (name, encoding, cursor.text())
        elif opcode == mcap.CHANNEL:
            number = cursor.number('H')
            name, encoding, definition = self._schemas.get(cursor.number('H'), ('', '', ''))
            topic, serialisation, extra = cursor.text(), cursor.text(), cursor.map()
            if serialisation != 'cdr':
                what = f'topic {topic} is stored as {serialisation!r}, not cdr: it is left out'
                self.log.guess(what)
            self.topics[number] = Topic(
                topic,
                name,
                definition,
                extra.get('topic_type_hash', ''),
                extra.get('offered_qos_profiles', ''),
                encoding,
            )
        elif opcode == mcap.STATISTICS:
            self._expected = cursor.number('Q')
        elif opcode == mcap.CHUNK_INDEX:
            cursor.take(16)
            self._chunk_starts.append(cursor.number('Q'))

    def _data(self, file: BinaryIO) -> Generator[MessageBlock]:
        """Walk over the data section in windows; yield its messages."""
        at, size = len(mcap.MAGIC), WINDOW
        while at < self._size:
            file.seek(at)
            window = file.read(size)
            walk = mcap.walk(np.frombuffer(window, np.uint8))
            chunks, ended = [], False
            for opcode, offset, length in walk.others.tolist():
                ended = opcode in (mcap.DATA_END, mcap.FOOTER)
                if ended:
                    self._check_end(at + offset + length)
                    break
                if opcode == mcap.CHUNK:
                    chunks.append((offset, length))
                else:
                    self._take(opcode, window[offset : offset + length])
            if walk.messages.size:
                yield self._block(window, walk)
            for offset, length in chunks:
                yield from self._chunk(window[offset : offset + length], at + offset)
            if ended:
                return
            size = WINDOW
            if walk.stop:
                at += walk.stop
                continue
            opcode, length = _prefix(window)
            if mcap.PREFIX.size + length <= self._size - at and length >= 0:
                if opcode in WANTED:
                    size = mcap.PREFIX.size + length
                else:
                    at += mcap.PREFIX.size + length
                continue
            if opcode == mcap.PADDING and self.finished:
                return  # the writer stopped between truncation and padding
            if opcode == mcap.CHUNK:
                yield from self._chunk(window[mcap.PREFIX.size :], at, cut=True)
            at = self._resume(at)

    def _check_end(self, end: int) -> None:
        """Compare where the data end with where the index, or the footer, begins."""
        if self._data_end not in (0, end):
            what = f'its data end at byte {end}, {self._data_end - end} bytes too early'
            self.log.add(what)

    def _resume(self, at: int) -> int:
        """Return the start of the next chunk in the index after a damaged record."""
        later = [start for start in self._chunk_starts if start > at]
        self.log.add(f'the record at byte {at} is broken or cut off')
        return min(later, default=self._size)

    def _block(self, data: bytes, walk: mcap.Walk) -> MessageBlock:
        channel, log_time, offset, length = walk.messages.T
        return MessageBlock(np.frombuffer(data, np.uint8), channel, log_time, offset, length)

    def _chunk(self, content: bytes, at: int, *, cut: bool = False) -> Generator[MessageBlock]:
        """Yield the messages of one chunk if its checksum holds.

        A chunk that was cut off has no checksum to hold, but complete messages in its front part
        are what the writer wrote.
        """
        try:
            cursor = mcap.Cursor(content)
            cursor.take(16)
            size, crc = cursor.number('Q'), cursor.number('I')
            compression, stored = cursor.text(), cursor.number('Q')
            packed = content[cursor.at : cursor.at + stored] if cut else cursor.take(stored)
            self._total += size
            if compression and self._total > max(SMALL, RATIO * self._size):
                raise ValueError(f'the file states more than {RATIO} times its size')
            data = inflated(packed, compression, size)
            cut = cut and len(data) < size
        except (ValueError, struct.error, RuntimeError, EOFError) as error:
            self.log.add(f'the chunk at byte {at} cannot be read ({error})')
            return
        if not cut and (len(data) != size or (crc and crc32(data) != crc)):
            self.log.add(f'the checksum of the chunk at byte {at} is wrong')
            return
        walk = mcap.walk(np.frombuffer(data, np.uint8))
        if not cut and walk.stop != len(data):
            self.log.add(f'the chunk at byte {at} ends within a record')
        for opcode, offset, length in walk.others.tolist():
            self._take(opcode, data[offset : offset + length])
        if walk.messages.size:
            yield self._block(data, walk)


def _prefix(window: bytes) -> tuple[int, int]:
    if len(window) < mcap.PREFIX.size:
        return 0, 1 << 62
    opcode, length = mcap.PREFIX.unpack_from(window)
    return int(opcode), int(length)
