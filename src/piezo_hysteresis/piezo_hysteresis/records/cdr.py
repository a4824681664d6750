"""CDR codec for whole topics of messages with a fixed size after their header.

``std_msgs/Header`` contains a string, so the offsets after it depend on the length of
``frame_id``: messages are decoded in groups of equal length. Alignment padding is ignored, because
rclpy does not initialise it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from piezo_hysteresis.arrays import BoolArray, IntArray
from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records.definitions import store_of
from piezo_hysteresis.records.storage import Topic

Rows = np.ndarray[Any, Any]
Fields = tuple[tuple[str, str], ...]

ENCAPSULATION = 4  # bytes in front of the body: representation (2) and options (2)
FRAME_ID = 12  # place of the length of frame_id, behind encapsulation, seconds and nanoseconds
NUMPY_CODES = {
    'bool': 'u1', 'byte': 'u1', 'octet': 'u1', 'char': 'u1', 'int8': 'i1', 'uint8': 'u1',
    'int16': 'i2', 'uint16': 'u2', 'int32': 'i4', 'uint32': 'u4', 'int64': 'i8', 'uint64': 'u8',
    'float32': 'f4', 'float64': 'f8',
}  # fmt: skip


@cache
def fixed_fields(topic: Topic) -> Fields:
    """Return name and NumPy type of the fields after the header of a topic."""
    from rosbags.interfaces import Nodetype

    msgtype = topic.msgtype
    fields = store_of(topic).fielddefs[msgtype][1]
    kinds = [(name, node[0], node[1]) for name, node in fields]
    if not kinds or kinds[0][2] != 'std_msgs/msg/Header':
        raise RecordError(f'the stored definition of {msgtype} does not begin with a header')
    result = []
    for name, kind, detail in kinds[1:]:
        base = str(detail[0] if isinstance(detail, tuple) else detail)
        if kind != Nodetype.BASE or base not in NUMPY_CODES:
            raise RecordError(
                f'{msgtype}: field {name} in the stored definition has no fixed size'
            )
        result.append((name, NUMPY_CODES[base]))
    return tuple(result)


def row_type(fields: Fields, frame_length: int, byte_order: str = '<') -> np.dtype[np.void]:
    """Return the layout of one message, padding included."""
    # frame_length [byte]
    names = ['encapsulation', 'sec', 'nanosec', 'frame_length', 'frame_id']
    formats = ['>u4', byte_order + 'i4', byte_order + 'u4', byte_order + 'u4', f'S{frame_length}']
    offsets = [0, 4, 8, FRAME_ID, FRAME_ID + 4]
    end = FRAME_ID + 4 + frame_length
    for name, code in fields:
        size = int(code[1:])
        # Alignment counts from the start of the body, not of the encapsulation.
        end = (end - ENCAPSULATION + size - 1) // size * size + ENCAPSULATION
        names.append(name)
        formats.append(byte_order + code)
        offsets.append(end)
        end += size
    layout: Any = {'names': names, 'formats': formats, 'offsets': offsets, 'itemsize': end}
    kind: np.dtype[np.void] = np.dtype(layout)
    return kind


def encode(fields: Fields, stamps: IntArray, columns: dict[str, Any], frame_id: str = '') -> Rows:
    """Return one serialised message per row."""
    # stamps [ns] (n,)
    text = frame_id.encode() + b'\0'
    kind = row_type(fields, len(text))
    # Written from zeroed bytes, so that equal records give equal files.
    rows = np.zeros(stamps.size * kind.itemsize, np.uint8).view(kind)
    rows['encapsulation'] = 0x00010000
    rows['sec'], rows['nanosec'] = np.divmod(stamps, 1_000_000_000)
    rows['frame_length'] = len(text)
    rows['frame_id'] = text
    for name, _ in fields:
        rows[name] = columns[name]
    return rows


@dataclass(frozen=True)
class Decoded:
    """Messages of one topic."""

    stamps: IntArray  # header stamps [ns], shape (n,)
    columns: dict[str, Any]  # values of every field, shape (n,)
    good: BoolArray  # which of the given messages could be decoded (n of m), shape (m,)


def decode(fields: Fields, buffer: Rows, offset: IntArray, length: IntArray) -> Decoded:
    """Decode messages that lie anywhere in one buffer."""
    # buffer (b,); offset, length [byte] (m,)
    stamps = np.zeros(offset.size, np.int64)
    columns: dict[str, Any] = {name: np.zeros(offset.size, code) for name, code in fields}
    good = np.zeros(offset.size, np.bool_)
    readable = np.flatnonzero(length >= FRAME_ID + 5)
    if readable.size:
        head = _gather(buffer, offset[readable], FRAME_ID + 4)
        for order, members in _groups(head):
            where = readable[members]
            frame_length = int(head[members[0], FRAME_ID:].view(order + 'u4')[0])
            if frame_length > int(length[where].max()):
                continue
            kind = row_type(fields, frame_length, order)
            spare = length[where] - kind.itemsize
            where = where[(spare >= 0) & (spare < 8)]  # payloads may be padded at the end
            if not where.size:
                continue
            rows = _gather(buffer, offset[where], kind.itemsize).view(kind)[:, 0]
            stamps[where] = rows['sec'].astype(np.int64) * 1_000_000_000 + rows['nanosec']
            for name, column in columns.items():
                column[where] = rows[name]
            good[where] = rows['nanosec'] < 1_000_000_000
    if not good.all():
        stamps = stamps[good]
        columns = {name: column[good] for name, column in columns.items()}
    return Decoded(stamps, columns, good)


def _gather(buffer: Rows, offset: IntArray, size: int) -> Rows:
    """Return the `size` bytes from each offset, shape (m, size), without an index matrix."""
    step = int(offset[1] - offset[0]) if offset.size > 1 else size
    if step >= size and np.all(np.diff(offset) == step):
        window = buffer[int(offset[0]) :]
        rows = np.lib.stride_tricks.as_strided(window, (offset.size, size), (step, 1))
        return np.ascontiguousarray(rows)
    return np.lib.stride_tricks.sliding_window_view(buffer, size)[offset]


def _groups(head: Rows) -> list[tuple[str, IntArray]]:
    """Split messages by byte order and length of ``frame_id``; other encodings are left out."""
    key = np.ascontiguousarray(head[:, FRAME_ID : FRAME_ID + 4]).view('<u4')[:, 0].astype(np.int64)
    key += head[:, 1].astype(np.int64) << 32
    plain = (head[:, 0] == 0) & (head[:, 1] <= 1)
    if plain.all() and np.all(key == key[0]):
        return [('<' if head[0, 1] else '>', np.arange(key.size))]
    return [
        ('<' if head[members[0], 1] else '>', members)
        for value in np.unique(key[plain])
        for members in [np.flatnonzero(plain & (key == value))]
    ]
