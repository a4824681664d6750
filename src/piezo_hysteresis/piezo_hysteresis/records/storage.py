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
    """One topic of a bag.

    Attributes
    ----------
    name, msgtype : str
        Topic name and ``package/msg/Name``.
    definition : str
        Message definition with all dependencies; empty if unknown.
    type_hash : str
        RIHS01 hash of the type; empty if unknown.
    qos : str
        Offered QoS profiles as YAML text, as rosbag2 stores them.
    encoding : str
        Format of the definition: ``ros2msg`` or ``ros2idl``.
    """

    name: str
    msgtype: str
    definition: str = ''
    type_hash: str = ''
    qos: str = ''
    encoding: str = 'ros2msg'


@dataclass(frozen=True)
class MessageBlock:
    """Serialised messages that lie in one buffer.

    Attributes
    ----------
    buffer : ndarray of uint8, shape (b,)
        The bytes.
    topic : ndarray, shape (m,)
        Number of each message's topic in the storage.
    log_time : ndarray, shape (m,)
        When each message was recorded [ns].
    offset, length : ndarray, shape (m,)
        Where each payload begins and how long it is [byte].
    """

    buffer: np.ndarray[Any, Any]
    topic: IntArray
    log_time: IntArray
    offset: IntArray
    length: IntArray

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
    """A storage file that can be read block by block.

    Attributes
    ----------
    path : Path
        The file.
    topics : dict of int to Topic
        Topics by their number in the file.
    """

    path: Path
    topics: dict[int, Topic]

    def blocks(self) -> Generator[MessageBlock]:
        """Yield blocks in file order; `topics` is complete when the last one was read."""
        ...
