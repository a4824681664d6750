"""Records from rosbag2 bags."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from piezo_hysteresis.arrays import FloatArray, IntArray
from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records.bag_content import BagContent, TopicContent, read_content
from piezo_hysteresis.records.damage import DamageLog
from piezo_hysteresis.records.definitions import MARKER, REFERENCE, STATE
from piezo_hysteresis.records.markers import MOVED, Marker
from piezo_hysteresis.records.record import Record
from piezo_hysteresis.records.sampling import Track, records_of

STATE_NAME = 'actuator/state'
REFERENCE_NAME = 'reference'
MARKER_NAME = 'record/marker'
EXACT = 1 << 53  # nanoseconds that float64 still tells apart (104 days)


def read_bag(
    path: str | Path, *, salvage: bool = False, actuator: str | None = None
) -> list[Record]:
    """Read the records of a bag.

    Parameters
    ----------
    path : str or Path
        Bag folder, or one ``.mcap`` or ``.db3`` file.
    salvage : bool
        Return what is readable of a damaged bag (see `records.survey` for what was lost).
    actuator : str, optional
        Name or namespace of the actuator, where the bag holds several.

    Raises
    ------
    RecordError
        If the bag cannot be used as it is, or holds no record that counts.
    """
    log = DamageLog(salvage)
    records = bag_records(read_content(Path(path), log), log, actuator)
    if not records:
        raise RecordError(f'{path}: it holds no record that counts; `info {path}` says why')
    return records


def bag_records(content: BagContent, log: DamageLog, actuator: str | None = None) -> list[Record]:
    """Return the records among the topics of a bag.

    Raises
    ------
    RecordError
        If there are none, or they are damaged and the log does not salvage.
    """
    states = content.of_type(STATE)
    if not states:
        raise RecordError(_no_states(content))
    runs = [run for state in states for run in _runs(content, state, len(states) == 1, log)]
    if actuator is not None:
        runs = [run for run in runs if actuator in (run.track.info.actuator, run.namespace)]
        if not runs:
            raise RecordError(f'{content.path}: it holds no actuator named {actuator!r}')
    spaces = sorted({run.namespace for run in runs})
    names = sorted({run.track.info.actuator for run in runs} - {''})
    if len(spaces) > 1:
        names = spaces
    if len(names) > 1:
        log.add(
            content.path,
            f'it holds {len(names)} actuators ({", ".join(names)})',
            count=len(names),
            remedy='take one of them out with `import BAG --actuator NAME --out NEW_BAG`',
        )
    return [record for run in runs for record in records_of(run.track, str(content.path), log)]


@dataclass(frozen=True)
class _Run:
    """The samples of one record, and the namespace of their topic."""

    namespace: str
    track: Track


def _no_states(content: BagContent) -> str:
    held = [f'{t.topic.name} ({t.topic.msgtype})' for t in content.topics.values() if t.count]
    if not held:
        return f'{content.path}: it holds no messages; record while the experiment runs'
    some = ', '.join(sorted(held)[:4]) + (', ...' if len(held) > 4 else '')
    return (
        f'{content.path}: it holds no {STATE} but {some}; '
        'record the topic actuator/state, or import a CSV file'
    )


def _namespace(topic: str, name: str) -> str:
    """Return what stands in front of the agreed name of a topic."""
    return topic.strip('/').removesuffix(name).strip('/')


def _siblings(content: BagContent, msgtype: str, name: str, space: str, alone: bool) -> list[Any]:
    """Return the topics of a type in the same namespace (anywhere if there is one actuator)."""
    return [
        held
        for held in content.of_type(msgtype)
        if alone or _namespace(held.topic.name, name) == space
    ]


def _runs(content: BagContent, state: TopicContent, alone: bool, log: DamageLog) -> list[_Run]:
    """Cut the samples of one topic at its markers."""
    space = _namespace(state.topic.name, STATE_NAME)
    for name in ('sample', 'voltage', 'displacement'):
        if name not in state.columns:
            raise RecordError(
                f'{content.path}: {state.topic.name} has no field {name}; its messages were '
                'recorded with another definition'
            )
    stamp = state.stamp()
    origin = int(stamp.min()) if stamp.size and int(stamp.max()) >= EXACT else 0
    columns = {name: state.column(name).astype(np.float64) for name in ('voltage', 'displacement')}
    sample = state.column('sample').astype(np.int64)
    reference = _reference(content, space, alone, sample)
    if reference is not None:
        columns['reference'] = reference
    track = Track(
        content.path.resolve().stem or 'record',
        np.asarray((stamp - origin) / 1e9, np.float64),
        columns,
        sample,
    )
    markers = [
        message
        for held in _siblings(content, MARKER, MARKER_NAME, space, alone)
        for message in held.messages
    ]
    if not markers:
        return [_Run(space, _with_reference(track, content.path, log))]
    return [
        _Run(space, _with_reference(part, content.path, log))
        for part in _cut(track, stamp, markers, content.path, log)
    ]


def _cut(
    track: Track, stamp: IntArray, markers: list[Marker], path: Path, log: DamageLog
) -> list[Track]:
    """Return the samples from each marker to the next, without the records that do not count."""
    starts = [marker.stamp for marker in markers]
    void = _void(markers)
    # At one tick, the end of a record stands in front of the beginning of the next.
    order = sorted(range(len(markers)), key=lambda k: (starts[k], bool(markers[k].record)))
    edges = [starts[k] for k in order] + [int(stamp.max()) + 1]
    outside = int(np.sum(stamp < edges[0]))
    parts = []
    for k, first, last in zip(order, edges, edges[1:], strict=False):
        own = (stamp >= first) & (stamp < last)
        marker = markers[k]
        if not marker.record:
            outside += int(own.sum())
        elif k in void:
            if void[k] != MOVED:
                what = f'record {marker.record} was {void[k]} and is left out'
                log.leave_out(path, what, count=int(own.sum()))
        elif not own.any():
            if first < last:  # else it was said twice
                log.note(path, f'record {marker.record} is announced but holds no samples')
        else:
            part = track.take(own)
            parts.append(
                Track(marker.record, part.time, part.columns, part.sample,
                      marker.info, marker.rate)
            )  # fmt: skip
    if outside:
        log.note(path, f'{outside} samples lie outside the marked records', count=outside)
    return parts


def _void(markers: list[Marker]) -> dict[int, str]:
    """Return why records do not count, by the place of the marker that begins them.

    A marker that judges means the newest of its name that was begun before it and still counts.
    """
    void: dict[int, str] = {}
    for k, judge in enumerate(markers):
        if judge.judged:
            begun = [
                j for j, m in enumerate(markers[:k]) if m.record == judge.judged and j not in void
            ]
            void |= dict.fromkeys(begun[-1:], judge.verdict)
    return void


def _reference(
    content: BagContent, space: str, alone: bool, sample: IntArray
) -> FloatArray | None:
    """Return the desired displacement of each sample [m], NaN where none was recorded."""
    found = _siblings(content, REFERENCE, REFERENCE_NAME, space, alone)
    if not found or 'displacement' not in found[0].columns:
        return None
    number = found[0].column('sample').astype(np.int64)
    value = found[0].column('displacement').astype(np.float64)
    if not number.size:
        return None
    order = np.argsort(number, kind='stable')
    number, value = number[order], value[order]
    place = np.minimum(np.searchsorted(number, sample), number.size - 1)
    return np.where(number[place] == sample, value[place], np.nan)


def _with_reference(track: Track, path: Path, log: DamageLog) -> Track:
    """Leave out a reference that does not cover the record."""
    reference = track.columns.get('reference')
    if reference is None:
        return track
    missing = int(np.isnan(reference).sum())
    if missing == 0:
        return track
    if missing < reference.size:
        what = f'record {track.name}: {missing} samples have no reference, so it is left out'
        log.note(path, what, count=missing)
    columns = {key: column for key, column in track.columns.items() if key != 'reference'}
    return Track(track.name, track.time, columns, track.sample, track.info, track.rate)
