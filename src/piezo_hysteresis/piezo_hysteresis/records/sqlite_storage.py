"""Reads and writes the sqlite3 files of rosbag2.

rosbags writes them. It does not read them, because it opens no file with a broken page: of 100 000
states around one, 99 933 are read here and none by rosbags, and a whole file takes the same time
although every page is checked (``bench/records.py``). Rows come from apsw, which rosbags brings
along: it hands them over twice as fast as the standard module.
"""

from __future__ import annotations

import gc
from collections.abc import Generator, Iterable, Iterator
from contextlib import closing
from itertools import islice
from pathlib import Path
from typing import Any

import apsw
import numpy as np

from piezo_hysteresis.arrays import IntArray
from piezo_hysteresis.records.damage import DamageLog
from piezo_hysteresis.records.storage import MessageBlock, Topic

ROWS = 1 << 13


class SqliteFile:
    """One sqlite3 file of a bag, read once from front to back.

    Parameters
    ----------
    path : Path
        The file.
    log : DamageLog
        Where damage is listed, or raised.

    Attributes
    ----------
    topics : dict of int to Topic
        Topics by their number in the file.
    """

    def __init__(self, path: Path, log: DamageLog) -> None:
        self.path = path
        self.log = log
        self.topics: dict[int, Topic] = {}

    def blocks(self) -> Generator[MessageBlock]:
        """Yield messages in the order in which they were stored.

        Raises
        ------
        RecordError
            If the file is damaged and the log does not salvage.
        """
        if self.path.stat().st_size == 0:
            self.log.add(self.path, 'the file is empty')
            return
        # Read-only and immutable: a bag is evidence, and may lie on a read-only medium.
        address = f'{self.path.resolve().as_uri()}?immutable=1'
        flags = apsw.SQLITE_OPEN_READONLY | apsw.SQLITE_OPEN_URI
        try:
            with closing(apsw.Connection(address, flags)) as base:
                self._check(base)
                self.topics = self._read_topics(base)
                yield from self._messages(base)
        except (apsw.Error, UnicodeDecodeError) as error:
            self.log.add(self.path, f'the database is damaged ({error})')

    def _check(self, base: apsw.Connection) -> None:
        self._cut_off()
        # A whole-file check costs as much as reading; the quick one finds broken pages.
        try:
            findings = [row[0] for row in base.execute('PRAGMA quick_check(3)')]
        except apsw.Error as error:
            findings = [str(error)]
        if findings != ['ok']:
            finding = str(findings[0]).removeprefix('*** in database main ***')
            self.log.add(self.path, f'the database is damaged ({finding.strip()[:80]})')

    def _cut_off(self) -> None:
        """Compare the size of the file with what its first page says."""
        with self.path.open('rb') as file:
            head = file.read(100)
        if not head.startswith(b'SQLite format 3\0') or len(head) < 100:
            self.log.add(self.path, 'this is not a sqlite3 file or its beginning is damaged')
            return
        page = int.from_bytes(head[16:18], 'big')
        expected = (65536 if page == 1 else page) * int.from_bytes(head[28:32], 'big')
        size = self.path.stat().st_size
        if expected > size:
            self.log.add(self.path, f'the file is cut off, {expected - size} bytes are missing')

    def _read_topics(self, base: apsw.Connection) -> dict[int, Topic]:
        columns = {row[1] for row in base.execute('PRAGMA table_info(topics)')}
        tables = {row[0] for row in base.execute('SELECT name FROM sqlite_master')}
        qos = 'offered_qos_profiles' if 'offered_qos_profiles' in columns else "''"
        digest = 'type_description_hash' if 'type_description_hash' in columns else "''"
        definitions = {}
        if 'message_definitions' in tables:
            rows = base.execute(
                'SELECT topic_type, encoded_message_definition, encoding FROM message_definitions'
            )
            definitions = {str(row[0]): (str(row[1]), str(row[2])) for row in rows}
        topics = {}
        query = f'SELECT id, name, type, serialization_format, {qos}, {digest} FROM topics'
        for number, *fields in base.execute(query):
            # SQLite lets any value be in any column.
            name, msgtype, serialisation, profiles, type_hash = map(str, fields)
            if serialisation != 'cdr':
                self.log.add(self.path, f'topic {name} is stored as {serialisation!r}, not cdr')
            text, encoding = definitions.get(msgtype, ('', 'ros2msg'))
            topics[number] = Topic(name, msgtype, text, type_hash, profiles, encoding)
        return topics

    def _messages(self, base: apsw.Connection) -> Generator[MessageBlock]:
        rows = base.execute('SELECT topic_id, timestamp, data, id FROM messages ORDER BY id')
        last = -1
        while True:
            batch, error = _fetch(rows)
            if batch:
                last = batch[-1][3]
                yield self._block(batch)
            if error is not None:
                break
            if not batch:
                return
        self.log.add(self.path, f'the database is damaged behind message {last} ({error})')
        # What lies behind the damaged pages is reached from the end.
        query = 'SELECT topic_id, timestamp, data, id FROM messages WHERE id > ? ORDER BY id DESC'
        behind: list[Any] = []
        rows, error, batch = base.execute(query, (last,)), None, [()]
        while batch and error is None:
            batch, error = _fetch(rows)
            behind += batch
        if behind:
            yield self._block(behind[::-1])

    def _block(self, batch: list[Any]) -> MessageBlock:
        """Return the rows of a batch that are messages: SQLite lets any value be in any column."""
        try:
            return block_of(batch)
        except (TypeError, ValueError, OverflowError):
            good = [row for row in batch if _plausible(row)]
            wrong = len(batch) - len(good)
            what = f'{wrong} rows hold no message'
            self.log.add(self.path, what, count=wrong, lost=wrong)
            return block_of(good)


def _fetch(rows: Iterator[Any]) -> tuple[list[Any], apsw.Error | None]:
    """Return the next rows, and the error that kept more from being read."""
    batch: list[Any] = []
    # Thousands of new tuples would start the search for cycles, which rows cannot form, again
    # and again: a quarter of the time.
    collecting = gc.isenabled()
    gc.disable()
    try:
        batch.extend(islice(rows, ROWS))
    except apsw.Error as error:
        return batch, error  # with the rows in front of the damage
    finally:
        if collecting:
            gc.enable()
    return batch, None


def _plausible(row: tuple[Any, ...]) -> bool:
    return type(row[2]) is bytes and type(row[1]) is int and type(row[0]) is int


def block_of(rows: list[tuple[int, int, bytes, int]]) -> MessageBlock:
    """Return messages (topic number, log time [ns], payload, row) as one block."""
    topic, log_time, data, _ = zip(*rows, strict=True) if rows else ((), (), (), ())
    length = np.fromiter(map(len, data), np.int64, len(rows))
    return MessageBlock(
        np.frombuffer(b''.join(data), np.uint8),
        np.fromiter(topic, np.int64, len(rows)),
        np.fromiter(log_time, np.int64, len(rows)),
        np.cumsum(length) - length,
        length,
    )


class SqliteWriter:
    """Writes one sqlite3 file of a bag through rosbags; nothing is in it before `close`.

    Parameters
    ----------
    path : Path
        File to create, in a folder in which rosbags may make one of another name.
    """

    def __init__(self, path: Path) -> None:
        from rosbags.rosbag2.enums import CompressionMode
        from rosbags.rosbag2.storage_sqlite3 import Sqlite3Writer

        self._path = path
        self._storage = Sqlite3Writer(path.parent, CompressionMode.NONE)
        self._connections: list[Any] = []
        self.topics: list[Topic] = []
        self.counts: list[int] = []
        self.first, self.last = (1 << 63) - 1, 0

    def add_topic(self, topic: Topic) -> int:
        """Return the number of a new topic."""
        connection = _connection(len(self.topics) + 1, topic)
        if topic.definition and topic.msgtype not in {t.msgtype for t in self.topics}:
            self._storage.add_msgtype(connection)
        self._storage.add_connection(connection, topic.qos)
        self._connections.append(connection)
        self.topics.append(topic)
        self.counts.append(0)
        return len(self.topics)

    def write(self, topic: int, log_time: IntArray, payloads: Iterable[bytes]) -> None:
        """Append messages of one topic.

        Parameters
        ----------
        topic : int
            Its number.
        log_time : ndarray, shape (m,)
            Log time of every message [ns].
        payloads : iterable of bytes
            The serialised messages.
        """
        connection = self._connections[topic - 1]
        for time, payload in zip(log_time.tolist(), payloads, strict=True):
            self._storage.write(connection, time, payload)
        self.first = min(self.first, int(log_time.min()))
        self.last = max(self.last, int(log_time.max()))
        self.counts[topic - 1] += log_time.size

    def close(self, metadata: str) -> None:
        """Write the metadata, commit, close and give the file its name."""
        self._storage.close(9, metadata)
        self._storage.path.rename(self._path)

    def abandon(self) -> None:
        """Close without committing."""
        self._storage.abort()


def _connection(number: int, topic: Topic) -> Any:
    """Return a topic as rosbags describes it to its storages."""
    from rosbags.interfaces import (
        Connection,
        ConnectionExtRosbag2,
        MessageDefinition,
        MessageDefinitionFormat,
    )

    formats = {'ros2msg': MessageDefinitionFormat.MSG, 'ros2idl': MessageDefinitionFormat.IDL}
    text = MessageDefinition(formats[topic.encoding], topic.definition)
    ext = ConnectionExtRosbag2('cdr', [])
    return Connection(number, topic.name, topic.msgtype, text, topic.type_hash, 0, ext, None)
