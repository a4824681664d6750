"""Records into rosbag2 bags, whole topics encoded at once."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from piezo_hysteresis.arrays import IntArray
from piezo_hysteresis.common.plain_yaml import write_atomically
from piezo_hysteresis.common.wording import reason_of
from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records import cdr
from piezo_hysteresis.records.bags import MARKER_NAME, REFERENCE_NAME, STATE_NAME
from piezo_hysteresis.records.definitions import MARKER, REFERENCE, STATE, definition_of, typestore
from piezo_hysteresis.records.load import listed
from piezo_hysteresis.records.mcap_format import MESSAGE, MESSAGE_HEAD
from piezo_hysteresis.records.mcap_writer import McapWriter
from piezo_hysteresis.records.metadata import FileSummary, Metadata
from piezo_hysteresis.records.record import Record
from piezo_hysteresis.records.storage import Topic

SECOND = 1_000_000_000
ROWS = 1 << 15  # samples in one chunk


@dataclass(frozen=True)
class MessageBatch:
    """Serialised messages of one topic: number, log times [ns] and one row of bytes each."""

    topic: int
    log_time: IntArray
    rows: np.ndarray[Any, Any]


def write_bag(
    path: str | Path,
    records: Record | Sequence[Record],
    *,
    storage: str = 'mcap',
    namespace: str = 'piezo',
) -> None:
    """Write records to a new bag in the format of ``ros2 bag`` (Jazzy).

    Records are consecutive in time: a record that would start before the end of the previous one
    starts at the next full second. Samples are numbered throughout the bag.

    Parameters
    ----------
    path : str or Path
        Folder to create.
    records : Record or sequence of Record
        At least one, with unique names.
    storage : str
        ``mcap``; sqlite3 is read, not written.
    namespace : str
        Prefix of the topics ``actuator/state``, ``reference`` and ``record/marker``.

    Raises
    ------
    RecordError
        If the folder exists, the names are not unique, or it cannot be written; no partial bag
        remains.
    """
    folder, records = Path(path), listed(records)
    _check_request(folder, records, storage)
    try:
        with write_atomically(folder) as temporary:
            temporary.mkdir()
            _fill(temporary, temporary / f'{folder.name}_0.mcap', records, namespace)
    except OSError as error:
        raise RecordError(f'{folder}: it cannot be written ({reason_of(error)})') from None


def _check_request(folder: Path, records: Sequence[Record], storage: str) -> None:
    if storage != 'mcap':
        raise RecordError(
            f'{folder}: bags are written as mcap, not {storage!r}; `ros2 bag convert` makes a '
            'sqlite3 bag of it'
        )
    if folder.exists():
        raise RecordError(f'{folder} exists already; remove it or choose another name')
    if not records:
        raise RecordError(f'{folder}: there are no records to write')
    names = [record.name for record in records]
    again = sorted({name for name in names if names.count(name) > 1})
    if again or '' in names:
        raise RecordError(
            f'{folder}: every record needs a unique name, not {(again or [""])[0]!r}'
        )


def _fill(folder: Path, file: Path, records: Sequence[Record], namespace: str) -> None:
    writer = McapWriter(file)
    prefix = f'/{namespace.strip("/")}/' if namespace.strip('/') else '/'
    kinds = [(STATE_NAME, STATE), (MARKER_NAME, MARKER)]
    if any(record.reference is not None for record in records):
        kinds.append((REFERENCE_NAME, REFERENCE))
    try:
        for name, msgtype in kinds:
            writer.add_topic(Topic(prefix + name, msgtype, *definition_of(msgtype)))
        for batches in _batches(records):
            _write(writer, batches)
        summary = FileSummary(file.name, writer.first, writer.last, sum(writer.counts))
        topics = {
            topic.name: (topic, count)
            for topic, count in zip(writer.topics, writer.counts, strict=True)
        }
        metadata = Metadata('mcap', [summary], topics)
        writer.close(metadata.text())
    except BaseException:
        writer.abandon()
        raise
    metadata.write(folder)


def _write(writer: McapWriter, batches: list[MessageBatch]) -> None:
    """Write the batches of one stretch of time as a chunk."""
    # Topics stay together within a chunk: the index keeps the order in time.
    raw, offsets = b'', []
    for batch in batches:
        offsets.append(
            len(raw) + np.arange(batch.log_time.size) * (MESSAGE_HEAD + batch.rows.itemsize)
        )
        raw += _message_records(batch)
    topic = np.concatenate([np.full(batch.log_time.size, batch.topic) for batch in batches])
    log_time = np.concatenate([batch.log_time for batch in batches])
    writer.write_chunk(raw, topic, log_time, np.concatenate(offsets))


def _message_records(batch: MessageBatch) -> bytes:
    """Return the rows as MCAP message records."""
    size = batch.rows.itemsize
    kind = np.dtype(
        [('opcode', 'u1'), ('length', '<u8'), ('channel', '<u2'), ('sequence', '<u4'),
         ('log_time', '<u8'), ('publish_time', '<u8'), ('payload', f'V{size}')]
    )  # fmt: skip
    records = np.empty(batch.rows.size, kind)
    records['opcode'] = MESSAGE
    records['length'] = kind.itemsize - 9
    records['channel'] = batch.topic
    records['sequence'] = 0
    records['log_time'] = records['publish_time'] = batch.log_time
    records['payload'] = batch.rows.view(f'V{size}')
    return records.tobytes()


def _batches(records: Sequence[Record]) -> Iterator[list[MessageBatch]]:
    """Yield the messages of every record in portions."""
    types = {msgtype: fixed_fields(msgtype) for msgtype in (STATE, REFERENCE)}
    sample, free = 0, 0
    for record in records:
        start = max(round(record.start * SECOND), 0)
        if start < free:
            start = -(-free // SECOND) * SECOND
        for first in range(0, len(record), ROWS):
            part = slice(first, min(first + ROWS, len(record)))
            tick = np.arange(part.start, part.stop)
            stamps = start + np.round(tick * (record.dt * SECOND)).astype(np.int64)
            batches = [] if first else [MessageBatch(2, stamps[:1], marker_row(record, start))]
            columns = {
                'sample': sample + tick,
                'voltage': record.voltage[part],
                'displacement': record.displacement[part],
            }
            batches.append(MessageBatch(1, stamps, cdr.encode(types[STATE], stamps, columns)))
            if record.reference is not None:
                columns = _reference_columns(record, part)
                columns['sample'] = sample + tick
                batches.append(
                    MessageBatch(3, stamps, cdr.encode(types[REFERENCE], stamps, columns))
                )
            yield batches
        sample += len(record)
        free = start + round(len(record) * record.dt * SECOND)


def fixed_fields(msgtype: str) -> cdr.Fields:
    """Return the fields of one of our types of fixed size."""
    return cdr.fixed_fields(Topic('', msgtype, *definition_of(msgtype)))


def _reference_columns(record: Record, part: slice) -> dict[str, Any]:
    """Return a recorded reference with derivatives by central differences."""
    reference = record.reference
    assert reference is not None
    velocity = np.gradient(reference, record.dt) if reference.size > 1 else np.zeros(1)
    acceleration = np.gradient(velocity, record.dt) if reference.size > 1 else np.zeros(1)
    time = np.arange(part.start, part.stop) * record.dt
    return {
        'displacement': reference[part],
        'velocity': velocity[part],
        'acceleration': acceleration[part],
        'frequency': record.info.frequency,
        'phase': 2 * np.pi * record.info.frequency * time,
    }


def marker_row(record: Record, start: int) -> np.ndarray[Any, Any]:
    """Return the marker of a record as one row of bytes."""
    types = typestore().types
    sec, nanosec = divmod(start, SECOND)
    stamp = types['builtin_interfaces/msg/Time'](sec=sec, nanosec=nanosec)
    info = record.info
    message = types[MARKER](
        header=types['std_msgs/msg/Header'](stamp=stamp, frame_id=''),
        record=record.name,
        actuator=info.actuator,
        excitation=info.excitation,
        frequency=info.frequency,
        amplitude=info.amplitude,
        warm_up=info.warm_up,
        rate=1.0 / record.dt,
        input_unit=info.input_unit,
    )
    raw = bytes(typestore().serialize_cdr(message, MARKER))
    return np.frombuffer(raw, f'V{len(raw)}')
