"""Content of every bag storage: topics, and blocks of serialised messages."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Generator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol
from urllib.parse import quote

import numpy as np
from rosbags.interfaces import ConnectionExtRosbag2
from rosbags.rosbag2.errors import ReaderError
from rosbags.rosbag2.metadata import dump_qos_v8
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

from piezo_hysteresis.arrays import BoolArray, IntArray
from piezo_hysteresis.common.wording import counted
from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records.damage import DamageLog


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


PIECE = 1 << 20

# Largest decompressed block: chunks of `ros2 bag record` contain 768 kB, the largest of others
# some 10 MB. In memory a chunk takes about four times its size.
LARGEST = 1 << 28

# A whole file may be this much larger than it was packed, whatever its size; black pictures are
# 10 000 times as large, but the states of an actuator that does nothing only 40 times.
RATIO, SMALL = 1000, 1 << 30


def inflated(data: bytes, compression: str, size: int = LARGEST) -> bytes:
    """Return the content of a chunk or message, at most `size` + 1 bytes."""
    if size > LARGEST:
        raise ValueError(f'it would take {size} bytes, at most {LARGEST} are read at once')
    if compression == '':
        return data
    if compression == 'lz4':
        from lz4.frame import LZ4FrameDecompressor

        return bytes(LZ4FrameDecompressor().decompress(data, max_length=size + 1))
    if compression == 'zstd':
        # rosbags brings this module, the standard one of Python 3.14, along.
        from backports import zstd

        try:
            return bytes(zstd.ZstdDecompressor().decompress(data, max_length=size + 1))
        except zstd.ZstdError as error:
            raise ValueError(str(error)) from None
    raise ValueError(f'compression {compression!r} is not known')


class CompressedFile:
    """A storage file compressed as a whole (``.mcap.zstd``, ``.db3.zstd``)."""

    def __init__(
        self, path: Path, log: DamageLog, reader: Callable[[Path, DamageLog], Storage]
    ) -> None:
        self.path = path
        self.log = log.at(path)
        self.topics: dict[int, Topic] = {}
        self._reader = reader

    def blocks(self) -> Generator[MessageBlock]:
        """Yield the blocks of the uncompressed file, which is in a temporary folder."""
        from backports import zstd

        with tempfile.TemporaryDirectory() as folder:
            plain = Path(folder) / self.path.stem
            most = max(SMALL, RATIO * self.path.stat().st_size)
            try:
                with zstd.open(self.path, 'rb') as source, plain.open('wb') as target:
                    while piece := source.read(PIECE):
                        if target.tell() > most:
                            raise EOFError(f'it holds more than {most} bytes')
                        target.write(piece)
            except (zstd.ZstdError, EOFError) as error:
                self.log.add(f'it cannot be decompressed to its end ({error})')
            storage = self._reader(plain, self.log)
            for block in storage.blocks():
                self.topics = storage.topics
                yield block


def decompressed(block: MessageBlock, log: DamageLog) -> MessageBlock:
    """Return a block of individually compressed messages."""
    rows, bad, left = [], 0, LARGEST
    for index in range(block.topic.size):
        try:
            payload = inflated(block.payload(index), 'zstd')
        except ValueError:
            bad += 1
            continue
        left -= len(payload)
        if left < 0:
            log.add(f'its messages are larger than {LARGEST} bytes, decompressed')
            bad += block.topic.size - index
            break
        rows.append((int(block.topic[index]), int(block.log_time[index]), payload))
    if bad:
        log.add(f'{counted(bad, "message")} cannot be decompressed', count=bad, lost=bad)
    return block_of(rows)


ROWS = 1 << 13


class SqliteFile:
    """One sqlite3 file of a bag, read once in the order of its log times."""

    def __init__(self, path: Path, log: DamageLog) -> None:
        self.path = path
        self.log = log.at(path)
        self.topics: dict[int, Topic] = {}

    def blocks(self) -> Generator[MessageBlock]:
        """Yield messages; of a damaged file those in front of the damage."""
        if self.path.stat().st_size == 0:
            self.log.add('the file is empty')
            return
        rows: list[tuple[int, int, bytes]] = []
        try:
            # rosbags inserts the path into a URI without escaping.
            reader = Sqlite3Reader(Path(quote(str(self.path.resolve()))))
            reader.open()
            with closing(reader):
                self._check(reader)
                for connection, time, data in reader.messages(reader.connections):
                    rows.append((connection.id, time, data))
                    if len(rows) == ROWS:
                        yield block_of(rows)
                        rows = []
                if rows:
                    yield block_of(rows)
        except RecordError:
            raise
        except Exception as error:  # SQLite allows any value in any column, unchecked
            self.log.add(
                f'the database is damaged ({error})',
                remedy='repair it with `sqlite3 FILE .recover`',
            )  # fmt: skip

    def _check(self, reader: Sqlite3Reader) -> None:
        """Take the topics over, and compare the pages of the file with one another."""
        for each in reader.connections:
            definition, about = each.msgdef, each.ext
            assert isinstance(about, ConnectionExtRosbag2)
            kind, qos = about.serialization_format, about.offered_qos_profiles
            if kind != 'cdr':
                self.log.add(f'topic {each.topic} is stored as {kind!r}, not cdr')
            self.topics[each.id] = Topic(
                each.topic, each.msgtype, definition.data, each.digest or '',
                dump_qos_v8(qos) if qos else '',
                'ros2idl' if definition.format.name == 'IDL' else 'ros2msg',
            )  # fmt: skip
        assert reader.dbconn is not None
        findings = [row[0] for row in reader.dbconn.execute('PRAGMA quick_check(1)')]
        if findings != ['ok']:
            raise ReaderError(str(findings[0]).removeprefix('*** in database main ***')[:80])


def block_of(rows: list[tuple[int, int, bytes]]) -> MessageBlock:
    """Return messages (topic number, log time [ns], payload) as one block."""
    topic, log_time, data = zip(*rows, strict=True) if rows else ((), (), ())
    length = np.fromiter(map(len, data), np.int64, len(rows))
    return MessageBlock(
        np.frombuffer(b''.join(data), np.uint8),
        np.fromiter(topic, np.int64, len(rows)),
        np.fromiter(log_time, np.int64, len(rows)),
        np.cumsum(length) - length,
        length,
    )
