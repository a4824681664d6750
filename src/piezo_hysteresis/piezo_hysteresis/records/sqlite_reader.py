"""Reads the sqlite3 files of rosbag2 through rosbags; this suite writes mcap only."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import closing
from pathlib import Path
from urllib.parse import quote

import numpy as np
from rosbags.interfaces import ConnectionExtRosbag2
from rosbags.rosbag2.errors import ReaderError
from rosbags.rosbag2.metadata import dump_qos_v8
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records.damage import DamageLog
from piezo_hysteresis.records.storage import MessageBlock, Topic

ROWS = 1 << 13


class SqliteFile:
    """One sqlite3 file of a bag, read once in the order of its log times."""

    def __init__(self, path: Path, log: DamageLog) -> None:
        self.path = path
        self.log = log
        self.topics: dict[int, Topic] = {}

    def blocks(self) -> Generator[MessageBlock]:
        """Yield messages; of a damaged file those in front of the damage."""
        if self.path.stat().st_size == 0:
            self.log.add(self.path, 'the file is empty')
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
                self.path, f'the database is damaged ({error})',
                remedy='repair it with `sqlite3 FILE .recover`',
            )  # fmt: skip

    def _check(self, reader: Sqlite3Reader) -> None:
        """Take the topics over, and compare the pages of the file with one another."""
        for each in reader.connections:
            definition, about = each.msgdef, each.ext
            assert isinstance(about, ConnectionExtRosbag2)
            kind, qos = about.serialization_format, about.offered_qos_profiles
            if kind != 'cdr':
                self.log.add(self.path, f'topic {each.topic} is stored as {kind!r}, not cdr')
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
    topic, log_time, data = zip(*rows, strict=True)
    length = np.fromiter(map(len, data), np.int64, len(rows))
    return MessageBlock(
        np.frombuffer(b''.join(data), np.uint8),
        np.fromiter(topic, np.int64, len(rows)),
        np.fromiter(log_time, np.int64, len(rows)),
        np.cumsum(length) - length,
        length,
    )
