"""The MCAP container (mcap.dev/spec): opcodes, and the walk over records within a buffer."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Any

import numpy as np

from piezo_hysteresis.arrays import IntArray
from piezo_hysteresis.jit import jit

MAGIC = b'\x89MCAP0\r\n'
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK = 0x01, 0x02, 0x03, 0x04, 0x05, 0x06
MESSAGE_INDEX, CHUNK_INDEX, STATISTICS, METADATA = 0x07, 0x08, 0x0B, 0x0C
METADATA_INDEX, SUMMARY_OFFSET, DATA_END = 0x0D, 0x0E, 0x0F
PADDING = 0x80  # opcodes from here on are private; every reader steps over them

PREFIX = struct.Struct('<BQ')  # opcode and length in front of every record
MOST_OTHERS = 1 << 17  # records that are no messages in one buffer: two for each channel there is
MESSAGE_HEAD = 31  # prefix, channel (2), sequence (4), log time (8), publish time (8)


def record(opcode: int, *parts: bytes) -> bytes:
    """Return one record."""
    content = b''.join(parts)
    return PREFIX.pack(opcode, len(content)) + content


def text(value: str) -> bytes:
    """Return a string as MCAP stores it."""
    data = value.encode()
    return struct.pack('<I', len(data)) + data


def tail(summary_start: int = 0, summary_offset_start: int = 0, crc: int = 0) -> bytes:
    """Return the footer and the closing magic."""
    return record(FOOTER, struct.pack('<QQI', summary_start, summary_offset_start, crc)) + MAGIC


class Cursor:
    """Reads the fields of one record; running over its end raises ValueError."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.at = 0

    def take(self, size: int) -> bytes:
        """Return the next `size` bytes."""
        if size > len(self.data) - self.at:
            raise ValueError('a record is shorter than its fields')
        self.at += size
        return self.data[self.at - size : self.at]

    def number(self, code: str) -> int:
        """Return one integer; `code` as in struct."""
        layout = struct.Struct('<' + code)
        return int(layout.unpack(self.take(layout.size))[0])

    def text(self) -> str:
        """Return one string."""
        return self.take(self.number('I')).decode()

    def map(self) -> dict[str, str]:
        """Return a map from string to string."""
        inner = Cursor(self.take(self.number('I')))
        result = {}
        while inner.at < len(inner.data):
            key = inner.text()
            result[key] = inner.text()
        return result


@jit
def _walk(buffer: Any, fields: Any, others: Any) -> tuple[int, int, int]:
    """Note messages and other records; return both counts and where the walk stopped."""
    messages, rest, end = 0, 0, buffer.size
    at = np.int64(0)
    while at + 9 <= end and messages < fields.shape[0] and rest < others.shape[0]:
        size = np.int64(0)
        for k in range(8):
            size |= np.int64(buffer[at + 1 + k]) << (8 * k)
        if size < 0 or size > end - at - 9:
            break
        if buffer[at] == 5 and size >= 22:
            log_time = np.int64(0)
            for k in range(8):
                log_time |= np.int64(buffer[at + 15 + k]) << (8 * k)
            fields[messages, 0] = np.int64(buffer[at + 9]) | np.int64(buffer[at + 10]) << 8
            fields[messages, 1] = log_time
            fields[messages, 2] = at + 31
            fields[messages, 3] = size - 22
            messages += 1
        else:
            others[rest, 0] = buffer[at]
            others[rest, 1] = at + 9
            others[rest, 2] = size
            rest += 1
        at += 9 + size
    return messages, rest, int(at)


@dataclass(frozen=True)
class Walk:
    """Records found in a buffer."""

    messages: IntArray  # channel, log time [ns], offset and length of each payload, shape (m, 4)
    others: IntArray  # (r, 3)
    stop: int  # where the walk stopped: behind the last complete record, or at `MOST_OTHERS`


def walk(buffer: np.ndarray[Any, Any]) -> Walk:
    """Walk over the records that lie completely within a buffer of uint8, shape (b,)."""
    fields = np.empty((buffer.size // MESSAGE_HEAD + 1, 4), np.int64)
    others = np.empty((min(buffer.size // PREFIX.size + 1, MOST_OTHERS), 3), np.int64)
    messages, rest, stop = _walk(buffer, fields, others)
    return Walk(fields[:messages].copy(), others[:rest].copy(), stop)
