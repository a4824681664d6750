"""All that a bag holds: our topics decoded a block at a time, the others counted."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from piezo_hysteresis.arrays import IntArray
from piezo_hysteresis.common.wording import counted
from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records import cdr
from piezo_hysteresis.records.damage import DamageLog
from piezo_hysteresis.records.definitions import MARKER, MESSAGES, REFERENCE, STATE
from piezo_hysteresis.records.markers import Marker, decode_markers
from piezo_hysteresis.records.mcap_reader import McapFile
from piezo_hysteresis.records.metadata import Metadata, read_metadata
from piezo_hysteresis.records.storage import (
    CompressedFile,
    MessageBlock,
    SqliteFile,
    Storage,
    Topic,
    decompressed,
)

READERS: dict[str, Callable[[Path, DamageLog], Storage]] = {'.mcap': McapFile, '.db3': SqliteFile}
DROPPED_KEY = 'piezo_hysteresis.dropped'
STATE_KEY = 'piezo_hysteresis.state'
RECORDING = 'recording'


@dataclass
class TopicContent:
    """What a bag holds of one topic."""

    topic: Topic  # name, type and definition
    count: int = 0  # messages
    first: int = (1 << 63) - 1  # [ns]
    last: int = 0  # [ns]
    stamps: list[IntArray] = field(default_factory=list)
    log_times: list[IntArray] = field(default_factory=list)
    columns: dict[str, list[Any]] = field(default_factory=dict)  # fields block by block
    messages: list[Marker] = field(default_factory=list)  # decoded markers

    def stamp(self) -> IntArray:
        """Return the header stamps [ns], shape (n,)."""
        return np.concatenate([np.zeros(0, np.int64), *self.stamps])

    def log_time(self) -> IntArray:
        """Return when each message was recorded [ns], shape (n,)."""
        return np.concatenate([np.zeros(0, np.int64), *self.log_times])

    def column(self, name: str) -> Any:
        """Return one field, shape (n,)."""
        return np.concatenate([np.zeros(0, self.columns[name][0].dtype), *self.columns[name]])


@dataclass
class BagContent:
    """All topics of a bag by name, and its metadata if present."""

    path: Path
    topics: dict[str, TopicContent] = field(default_factory=dict)
    metadata: Metadata | None = None

    def of_type(self, msgtype: str) -> list[TopicContent]:
        """Return the topics of one type that hold messages, in order of their names."""
        found = [t for t in self.topics.values() if t.topic.msgtype == msgtype and t.count]
        return sorted(found, key=lambda content: content.topic.name)


def blocks_of(
    path: Path, log: DamageLog, metadata: Metadata | None = None
) -> Iterator[tuple[dict[int, Topic], MessageBlock]]:
    """Yield the topics of the storage file and the block, for every block of a bag."""
    log = log.at(path)
    if metadata is None and path.is_dir():
        metadata = read_metadata(path, log)
    by_message = metadata is not None and metadata.compression == 'message'
    for storage in _storages(path, metadata, log):
        with closing(storage.blocks()) as blocks:
            for block in blocks:
                yield (
                    storage.topics,
                    decompressed(block, log.at(storage.path)) if by_message else block,
                )


def _storages(path: Path, metadata: Metadata | None, log: DamageLog) -> Iterator[Storage]:
    """Yield the storage files of a bag folder, or the file itself."""
    if not path.exists():
        raise RecordError(f'{path} does not exist; check the path')
    files = [path] if metadata is None else [path / file.name for file in metadata.files]
    found = 0
    for file in files:
        packed = file.suffix == '.zstd'
        reader = READERS.get(Path(file.stem).suffix if packed else file.suffix)
        if not file.is_file():
            log.add(f'its storage file {file.name} is missing')
        elif reader is None:
            log.add(f'its storage file {file.name} is of a kind that is not known')
        else:
            found += 1
            yield CompressedFile(file, log, reader) if packed else reader(file, log)
    if not found:
        raise RecordError(f'{path}: the folder holds no bag; give one that holds a metadata.yaml')


def read_content(path: Path, log: DamageLog) -> BagContent:
    """Read a bag folder or storage file."""
    log = log.at(path)
    metadata = read_metadata(path, log) if path.is_dir() else None
    content = BagContent(path, metadata=metadata)
    for topics, block in blocks_of(path, log, metadata):
        for topic in topics.values():
            content.topics.setdefault(topic.name, TopicContent(topic))
        _collect(content, topics, block, log)
    if metadata is not None:
        _compare(content, metadata, log)
    return content


def _collect(
    content: BagContent, topics: dict[int, Topic], block: MessageBlock, log: DamageLog
) -> None:
    for number in np.unique(block.topic).tolist():
        if number not in topics:
            count = int(np.sum(block.topic == number))
            what = f'{counted(count, "message", "belongs")} to no topic'
            log.add(what, count=count, lost=count)
            continue
        topic = topics[number]
        held = content.topics.setdefault(topic.name, TopicContent(topic))
        part = block.take(block.topic == number)
        held.count += part.topic.size
        held.first = min(held.first, int(part.log_time.min()))
        held.last = max(held.last, int(part.log_time.max()))
        if topic.msgtype in (STATE, REFERENCE):
            _decode(content, held, part, log)
        elif topic.msgtype == MARKER:
            held.messages += decode_markers(topic, part, log)


def _decode(content: BagContent, held: TopicContent, block: MessageBlock, log: DamageLog) -> None:
    topic = held.topic
    try:
        fields = cdr.fixed_fields(topic)
    except RecordError as error:
        log.add(f'topic {topic.name}: {error} (salvaged: the agreed one is used)')
        fields = cdr.fixed_fields(Topic(topic.name, topic.msgtype, MESSAGES[topic.msgtype]))
    decoded = cdr.decode(fields, block.buffer, block.offset, block.length)
    bad = int(decoded.good.size - decoded.good.sum())
    if bad:
        what = f'{counted(bad, "message")} of topic {topic.name} cannot be read by the definition'
        log.add(what, count=bad, lost=bad)
    held.stamps.append(decoded.stamps)
    held.log_times.append(block.log_time[decoded.good])
    for name, column in decoded.columns.items():
        held.columns.setdefault(name, []).append(column)


def _compare(content: BagContent, metadata: Metadata, log: DamageLog) -> None:
    """Compare the read messages with the counts of ``metadata.yaml``."""
    growing = metadata.custom.get(STATE_KEY) == RECORDING
    for name, (topic, count) in metadata.topics.items():
        held = content.topics.get(name)
        found = held.count if held else 0
        if held is not None and held.topic.msgtype != topic.msgtype:
            log.add(f'topic {name} is {held.topic.msgtype} in the file but '
                    f'{topic.msgtype} in its metadata')  # fmt: skip
        if found != count and not (growing and found > count):
            log.add(
                f'its metadata count {counted(count, "message")} of topic {name} but '
                f'{found} can be read',
                count=abs(count - found),
                lost=max(count - found, 0),
            )
    for name in sorted(set(content.topics) - set(metadata.topics)):
        if content.topics[name].count and metadata.topics:
            log.add(f'topic {name} is not in its metadata')
    if growing:
        log.note('the recording was not closed; all that was flushed is read')
