"""Content of every bag storage: topics, and blocks of serialised messages."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from piezo_hysteresis.arrays import BoolArray, IntArray


@dataclass(frozen=True)
class Topic:
    """One topic of a bag."""

    name: str  # topic name
    msgtype: str  # ``package/msg/Name``
    definition: str = ''  # message definition with all dependencies; empty if unknown
    type_hash: str = ''  # RIHS01 hash of the type; empty if unknown
    qos: str = ''  # offered QoS profiles as YAML text, as rosbag2 stores them
    encoding: str = 'ros2msg'  # format of the definition: ``ros2msg`` or ``ros2idl``


@dataclass(frozen=True)
class MessageBlock:
    """Serialised messages that lie in one buffer."""

    buffer: np.ndarray[Any, Any]  # (b,)
    topic: IntArray  # number of each message's topic in the storage, shape (m,)
    log_time: IntArray  # when each message was recorded [ns], shape (m,)
    offset: IntArray  # where each payload begins [byte], shape (m,)
    length: IntArray  # how long it is [byte], shape (m,)

    def take(self, mask: BoolArray) -> MessageBlock:
        """Return some of the messages; the bytes are shared."""
        if mask.all():
            return self
        return MessageBlock(
            self.buffer,
            self.topic[mask],
            self.log_time[mask],
            self.offset[mask],
            self.length[mask],
        )

    def payload(self, index: int) -> bytes:
        """Return the serialised message number `index` of this block."""
        first = int(self.offset[index])
        return bytes(self.buffer[first : first + int(self.length[index])].data)


class Storage(Protocol):
    """A storage file that can be read block by block."""

    path: Path
    topics: dict[int, Topic]  # topics by their number in the file

    def blocks(self) -> Generator[MessageBlock]:
        """Yield blocks in file order; `topics` is complete when the last one was read."""
        ...
