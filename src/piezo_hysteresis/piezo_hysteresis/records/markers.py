"""Markers that divide a recording into records."""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass
from typing import Any

import numpy as np

from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records.damage import DamageLog
from piezo_hysteresis.records.definitions import MARKER, store_of, typestore
from piezo_hysteresis.records.record import RecordInfo
from piezo_hysteresis.records.storage import MessageBlock, Topic

# Reasons for the rejection of a record. The rejecting marker has no name, so that it also ends an
# open record; its excitation is one of these, its frame_id the name of the rejected record.
CANCELLED, REFUSED, FAILED, REPEATED, MOVED = VERDICTS = (
    'cancelled', 'refused', 'failed', 'repeated', 'moved',
)  # fmt: skip

NUMBERS = ('frequency', 'amplitude', 'warm_up', 'rate')


@dataclass(frozen=True)
class Marker:
    """Content of a marker."""

    stamp: int  # header stamp: start of its record [ns]
    record: str  # name of the record; empty if it only ends the previous one
    rate: float  # sampling rate [Hz]
    info: RecordInfo  # further metadata
    judged: str = ''  # name of a rejected record; empty if none is rejected
    verdict: str = ''  # reason of the rejection: one of `VERDICTS`
    sample: int = -1  # sample at which it starts or ends; -1 if only the stamp is given
    log_time: int = 0  # time of recording [ns]


def decode_markers(topic: Topic, block: MessageBlock, log: DamageLog) -> list[Marker]:
    """Return the markers of a block, all of one topic."""
    from rosbags.serde import SerdeError

    try:
        store = _store(topic)
    except RecordError as error:
        log.add(f'topic {topic.name}: {error} (salvaged: the agreed one is used)')
        store = typestore()
    markers = []
    for index in range(block.topic.size):
        try:
            message = store.deserialize_cdr(block.payload(index), MARKER)
            markers.append(_marker(message, int(block.log_time[index]), log))
        except (SerdeError, ValueError, IndexError, AssertionError, struct.error) as error:
            log.add(f'a marker on topic {topic.name} cannot be read ({error})', lost=1)
    return markers


def _store(topic: Topic) -> Any:
    """Return a type store that reads markers as the bag defines them.

    Fields may have been added to ours, but none may be missing.
    """
    if not topic.definition:
        return typestore()
    theirs, ours = store_of(topic), typestore().fielddefs[MARKER][1]
    if not all(field in theirs.fielddefs[MARKER][1] for field in ours):
        raise RecordError('the stored definition of the markers lacks agreed fields')
    return theirs


def sample_text(sample: int) -> str:
    """Return the ``frame_id`` with which a marker that rejects no record names its sample."""
    return f'sample {sample}'


def _sample_of(text: str) -> int:
    found = re.fullmatch(r'sample ([0-9]{1,18})', text)
    return int(found[1]) if found else -1


def _marker(message: Any, log_time: int, log: DamageLog) -> Marker:
    numbers = {name: float(getattr(message, name)) for name in NUMBERS}
    wrong = [name for name, value in numbers.items() if not np.isfinite(value) or value < 0]
    if wrong:
        log.add(f'the marker of record {message.record} has no usable {", ".join(wrong)}')
        numbers |= dict.fromkeys(wrong, 0.0)
    stamp = message.header.stamp
    judges = not message.record and message.excitation in VERDICTS
    return Marker(
        int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec),
        message.record,
        numbers['rate'],
        RecordInfo(
            actuator=message.actuator,
            excitation=message.excitation or 'unknown',
            frequency=numbers['frequency'],
            amplitude=numbers['amplitude'],
            warm_up=numbers['warm_up'],
            input_unit=message.input_unit or 'V',
        ),
        message.header.frame_id if judges else '',
        message.excitation if judges else '',
        -1 if judges else _sample_of(message.header.frame_id),
        log_time,
    )
