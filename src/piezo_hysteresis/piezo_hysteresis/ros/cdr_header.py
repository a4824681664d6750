"""Codec of messages with a header, a tick index and floats: direct conversion from and to bytes.

All messages that a loop exchanges at every tick have this form. A Python message converted by
rclpy costs five times as much as packing its numbers. The serialized bytes are identical, so other
nodes receive ordinary messages.
"""

from __future__ import annotations

import struct
from typing import Any

from rclpy.serialization import deserialize_message

from piezo_hysteresis.common.stamps import NANOSECONDS

# CDR, little endian: what every middleware on every common machine sends.
_LITTLE = b'\x00\x01'

# Encapsulation, seconds, nanoseconds, and the empty frame_id up to the next multiple of 8.
_HEAD = struct.Struct('<2s2xiII4x')
_LENGTH = struct.Struct('<I')
_LENGTH_AT = 12


class FlatCodec:
    """Packs and unpacks one type of message."""

    def __init__(self, kind: Any) -> None:
        fields = kind.get_fields_and_field_types()
        first, second, *rest = fields.values()
        if first != 'std_msgs/Header' or second != 'uint64' or {*rest} != {'double'}:
            raise TypeError(f'{kind.__name__} is not a header, a uint64 and float64 fields')
        self.kind = kind
        self._names = tuple(fields)[1:]
        self._numbers = struct.Struct(f'<Q{len(rest)}d')
        self.pack = self._numbers.pack

    def decode(self, payload: bytes) -> tuple[bytes, tuple[Any, ...]]:
        """Return the header bytes of `payload`, which are forwarded unchanged, and its numbers."""
        if payload[:2] != _LITTLE:
            payload = self._converted(payload)
        (length,) = _LENGTH.unpack_from(payload, _LENGTH_AT)
        start = 4 + (19 + length) // 8 * 8
        return payload[:start], self._numbers.unpack_from(payload, start)

    def _converted(self, payload: bytes) -> bytes:
        """Return the message of another encoding in ours."""
        message = deserialize_message(payload, self.kind)
        stamp = message.header.stamp
        numbers = (getattr(message, name) for name in self._names)
        return head_of(stamp.sec, stamp.nanosec) + self.pack(*numbers)


def with_floats(message: Any) -> Any:
    """Return a message with its numbers of type float64, alone or in arrays, made floats.

    Without its checks (``python -O``) rclpy 7.1 sends the integer 1 as 5e-324, and an
    ``np.float32`` as another number.
    """
    for name, kind in message.get_fields_and_field_types().items():
        if kind == 'double':
            setattr(message, name, float(getattr(message, name)))
        elif kind == 'sequence<double>':
            setattr(message, name, [float(each) for each in getattr(message, name)])
    return message


def head_of(sec: int, nanosec: int) -> bytes:
    """Return the head of a message with this stamp and no frame."""
    return _HEAD.pack(_LITTLE, sec, nanosec, 1)


def stamp_of(head: bytes) -> tuple[int, int]:
    """Return seconds and nanoseconds of a head that `FlatCodec.decode` returned."""
    _, sec, nanosec, _ = _HEAD.unpack_from(head)
    return sec, nanosec


def nanoseconds_of_head(head: bytes) -> int:
    """Return the time since the epoch of a head that `FlatCodec.decode` returned [ns]."""
    sec, nanosec = stamp_of(head)
    return sec * NANOSECONDS + nanosec
