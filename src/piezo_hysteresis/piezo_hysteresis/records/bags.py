"""Records from rosbag2 bags."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from piezo_hysteresis.arrays import FloatArray, IntArray
from piezo_hysteresis.common.wording import counted
from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records.bag_content import BagContent, TopicContent, read_content
from piezo_hysteresis.records.columns import alike, in_order, several_axes
from piezo_hysteresis.records.damage import DamageLog, read_advised
from piezo_hysteresis.records.definitions import MARKER, REFERENCE, STATE
from piezo_hysteresis.records.markers import MOVED, Marker
from piezo_hysteresis.records.record import Record
from piezo_hysteresis.records.sampling import Track, records_of, restarts

STATE_NAME = 'actuator/state'
REFERENCE_NAME = 'reference'
MARKER_NAME = 'record/marker'
ON_ONE_CLOCK = 0.9  # part of the stamps that two axes of one clock share at least
EXACT = 1 << 53  # nanoseconds that float64 still resolves (104 days)


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
        Name or namespace of the actuator, if the bag contains several.

    Raises
    ------
    RecordError
        If the bag is unusable, or contains no valid record.
    """
    records = read_advised(
        lambda log: bag_records(read_content(Path(path), log), log, actuator), DamageLog(salvage)
    )
    if not records:
        raise RecordError(f'{path}: it holds no record that counts; `info {path}` says why')
    return records


def bag_records(content: BagContent, log: DamageLog, actuator: str | None = None) -> list[Record]:
    """Return the records among the topics of a bag."""
    states, log = content.of_type(STATE), log.at(content.path)
    if not states:
        raise RecordError(no_states(content))
    numbered = len(states) > 1 and alike([each.topic.name for each in states])
    if actuator is None and numbered and all(on_one_clock(states[0], s) for s in states[1:]):
        raise several_axes(
            content.path,
            [f'{each.topic.name}.voltage' for each in states],
            [f'{each.topic.name}.displacement' for each in states],
            '`import BAG --actuator NAME --out NEW_BAG`, NAME being that of a namespace',
        )
    runs = [
        (_namespace(state.topic.name, STATE_NAME), run)
        for state in states
        for run in runs_of(content, state, len(states) == 1, log)
    ]
    if actuator is not None:
        runs = [(space, run) for space, run in runs if actuator in (run.info.actuator, space)]
        if not runs:
            raise RecordError(f'{content.path}: it holds no actuator named {actuator!r}')
    spaces = sorted({space for space, _ in runs})
    names = sorted({run.info.actuator for _, run in runs} - {''})
    if len(spaces) > 1:
        names = spaces
    if len(names) > 1:
        log.add(
            f'it holds {len(names)} actuators ({", ".join(names)})',
            count=len(names),
            remedy='take one of them out with `import BAG --actuator NAME --out NEW_BAG`',
        )
    return [record for _, run in runs for record in records_of(run, log)]


def no_states(content: BagContent) -> str:
    """Return the sentence with which a bag without states is refused."""
    held = [f'{t.topic.name} ({t.topic.msgtype})' for t in content.topics.values() if t.count]
    if not held:
        return f'{content.path}: it holds no messages; record while the experiment runs'
    some = ', '.join(sorted(held)[:4]) + (', ...' if len(held) > 4 else '')
    return (
        f'{content.path}: it holds no {STATE} but {some}; '
        'record the topic actuator/state, or name its fields: import BAG '
        '--voltage /topic.field:V --displacement /topic.field:um'
    )


def _namespace(topic: str, name: str) -> str:
    """Return the prefix of a standard topic name."""
    return topic.strip('/').removesuffix(name).strip('/')


def _siblings(content: BagContent, msgtype: str, name: str, space: str, alone: bool) -> list[Any]:
    """Return the topics of a type in the same namespace (anywhere if there is one actuator)."""
    return [
        held
        for held in content.of_type(msgtype)
        if alone or _namespace(held.topic.name, name) == space
    ]


def on_one_clock(one: TopicContent, other: TopicContent) -> bool:
    """Return whether nearly all stamps of two topics are the same."""
    stamps = one.stamp(), other.stamp()
    common = np.intersect1d(*stamps).size
    return bool(common >= ON_ONE_CLOCK * min(each.size for each in stamps) and common > 1)


def origin_of(state: TopicContent) -> int:
    """Return the origin of the times of a topic, so that nanoseconds are exact [ns]."""
    stamp = state.stamp()
    return int(stamp.min()) if stamp.size and int(stamp.max()) >= EXACT else 0


def runs_of(
    content: BagContent,
    state: TopicContent,
    alone: bool,
    log: DamageLog,
    origin: int | None = None,
) -> list[Track]:
    """Cut the samples of one topic where their numbers start again, and at its markers.

    With an `origin` [ns] it is one of several axes: the only topic of markers is that of all.
    """
    space = _namespace(state.topic.name, STATE_NAME)
    for name in ('sample', 'voltage', 'displacement'):
        if name not in state.columns:
            raise RecordError(
                f'{content.path}: {state.topic.name} has no field {name}; its messages were '
                'recorded with another definition'
            )
    stamp = state.stamp()
    start = origin_of(state) if origin is None else origin
    columns = {name: state.column(name).astype(np.float64) for name in ('voltage', 'displacement')}
    sample = state.column('sample').astype(np.int64)
    starts = restarts(sample, state.log_time())
    reference = _reference(content, space, alone, sample, starts)
    if reference is not None:
        columns['reference'] = reference
    track = Track(
        content.path.resolve().stem or 'record',
        np.asarray((stamp - start) / 1e9, np.float64),
        columns,
        sample,
    )
    shared = origin is not None and len(content.of_type(MARKER)) == 1
    markers = [
        message
        for held in _siblings(content, MARKER, MARKER_NAME, space, alone or shared)
        for message in held.messages
    ]
    if starts.size:
        what = f'the numbers of the samples start again {counted(starts.size, "time")}'
        log.note(f'{what}: read as {starts.size + 1} runs', count=starts.size)
    stretches = [slice(a, b) for a, b in pairwise([0, *starts.tolist(), sample.size])]
    parts = [track.take(each) for each in stretches]
    if markers:
        stamps = [stamp[each] for each in stretches]
        log_times = [state.log_time()[each] for each in stretches]
        parts = _cut(parts, _edges(markers, parts, stamps, log_times), log)
    elif len(parts) > 1:
        parts = [replace(part, name=f'{part.name}.{k}') for k, part in enumerate(parts, 1)]
    return [_with_reference(part, log) for part in parts]


@dataclass(frozen=True)
class _Edge:
    """Where a marker cuts: the run, the number of its first sample, and why it does not count."""

    run: int
    sample: int
    marker: Marker
    void: str


def _edges(
    markers: list[Marker], runs: list[Track], stamps: list[IntArray], log_times: list[IntArray]
) -> list[_Edge]:
    """Return the cuts of the markers in order, without those of moved or unstarted records."""
    sequel = all(a.max() < b.min() for a, b in pairwise(stamps))
    begins = [each.min() for each in (stamps if sequel else log_times)]
    numbers = [_numbers(run) for run in runs]
    places = []
    for marker in markers:
        when = marker.stamp if sequel else marker.log_time
        run = max(int(np.searchsorted(begins, when, side='right')) - 1, 0)
        places.append((run, marker.sample))
        if marker.sample < 0 or runs[run].sample is not numbers[run]:
            behind = int(np.searchsorted(np.sort(stamps[run]), marker.stamp))
            number = np.append(np.sort(numbers[run]), numbers[run].max() + 1)
            places[-1] = (run, int(number[behind]))
    return _settled(markers, places)


def _settled(markers: list[Marker], places: list[tuple[int, int]]) -> list[_Edge]:
    """Return the edges in order, without those of records that never started.

    A marker that rejects a record ends only that record.
    """
    rejections = _rejections(markers)
    edges: list[_Edge] = []
    running = -1
    # At the same tick, the end of a record precedes the start of the next one.
    for k in sorted(range(len(markers)), key=lambda k: (places[k], bool(markers[k].record))):
        marker, judge = markers[k], rejections.get(k, -1)
        void = markers[judge].verdict if judge >= 0 else ''
        never = void == MOVED or (void and places[k] >= places[judge])
        if never or (marker.judged and rejections.get(running) != k):
            continue
        edges.append(_Edge(*places[k], marker, void))
        running = k if marker.record else -1
    return edges


def _numbers(run: Track) -> IntArray:
    """Return the numbers of samples, or their places where the source does not count."""
    sample = run.sample
    if sample is None or np.all(sample == sample[0]):
        return np.argsort(np.argsort(run.time, kind='stable'), kind='stable')
    return sample


def _cut(runs: list[Track], edges: list[_Edge], log: DamageLog) -> list[Track]:
    """Return the samples from each marker to the next, without the records that do not count."""
    outside = 0
    parts = []
    for k, run in enumerate(runs):
        number = _numbers(run)
        own = [edge for edge in edges if edge.run == k]
        last = int(number.max()) + 1
        outside += int(np.sum(number < (own[0].sample if own else last)))
        ends = [edge.sample for edge in own[1:]] + [last]
        for edge, end in zip(own, ends, strict=True):
            inside = (number >= edge.sample) & (number < end)
            marker, count = edge.marker, int(inside.sum())
            if not marker.record:
                outside += count
            elif edge.void:
                what = f'record {marker.record} was {edge.void} and is left out'
                log.leave_out(what, count=count)
            elif count:
                part = run.take(inside)
                parts.append(replace(part, name=marker.record, info=marker.info, rate=marker.rate))
            elif edge.sample < end or edge is own[-1]:  # else it is a duplicate
                log.note(f'record {marker.record} is announced but holds no samples')
    if outside:
        what = f'{counted(outside, "sample", "lies")} outside the marked records'
        log.note(what, count=outside)
    return parts


def _rejections(markers: list[Marker]) -> dict[int, int]:
    """Return the rejecting marker of each record, by the marker that starts the record.

    A marker rejects the newest earlier record of its name that is still valid.
    """
    rejections: dict[int, int] = {}
    for k, judge in enumerate(markers):
        if judge.judged:
            named = [j for j, m in enumerate(markers[:k]) if m.record == judge.judged]
            rejections |= dict.fromkeys([j for j in named if j not in rejections][-1:], k)
    return rejections


def _reference(
    content: BagContent, space: str, alone: bool, sample: IntArray, starts: IntArray
) -> FloatArray | None:
    """Return the desired displacement of each sample [m], NaN if none was recorded.

    `starts` are the positions at which the sample numbers restart.
    """
    found = _siblings(content, REFERENCE, REFERENCE_NAME, space, alone)
    if not found or 'displacement' not in found[0].columns:
        return None
    number = found[0].column('sample').astype(np.int64)
    value = found[0].column('displacement').astype(np.float64)
    if not number.size:
        return None
    again = restarts(number, found[0].log_time())
    if again.size != starts.size:
        starts = again = starts[:0]  # runs without a reference: joined as if there were one
    pieces = zip(np.split(sample, starts), np.split(number, again), np.split(value, again),
                 strict=True)  # fmt: skip
    return np.concatenate([_joined(*piece) for piece in pieces])


def _joined(sample: IntArray, number: IntArray, value: FloatArray) -> FloatArray:
    """Return the value of each sample by its number, NaN if there is none."""
    order = np.argsort(number, kind='stable')
    number, value = number[order], value[order]
    place = np.minimum(np.searchsorted(number, sample), number.size - 1)
    return np.where(number[place] == sample, value[place], np.nan)


def _with_reference(track: Track, log: DamageLog) -> Track:
    """Leave out samples at the ends that have no reference, or a reference with gaps.

    A recording begins and ends between two messages of the topics. Samples are kept, and the
    reference is not, where it covers less than half of them.
    """
    reference = track.columns.get('reference')
    if reference is None:
        return track
    known = np.flatnonzero(~np.isnan(reference))
    missing = reference.size - known.size
    if not missing:
        return track
    if known.size:
        inside = track.take(slice(int(known[0]), int(known[-1]) + 1))
        if inside.time.size == known.size > missing:
            what = (
                f'record {track.name}: {counted(missing, "sample")} before or after the '
                'reference left out'
            )
            log.note(what, count=missing)
            return inside
        what = (
            f'record {track.name}: {counted(missing, "sample", "has")} no reference, so it '
            'is left out'
        )
        log.note(what, count=missing)
    columns = {key: column for key, column in track.columns.items() if key != 'reference'}
    return replace(track, columns=columns)


def axes_tracks(content: BagContent, log: DamageLog) -> list[Track]:
    """Return the samples of each record, with the columns ``voltage_1``, ``displacement_1``, ...

    Axes are in the order of the numbers in their topics. Samples are joined by their stamps.
    """
    states, log = content.of_type(STATE), log.at(content.path)
    if not states:
        raise RecordError(no_states(content))
    states = [
        states[k] for k in in_order([each.topic.name for each in states], range(len(states)))
    ]
    first = states[0]
    for each in states[1:]:
        if not on_one_clock(first, each):
            raise RecordError(
                f'{content.path}: the stamps of {first.topic.name} and {each.topic.name} differ; '
                'axes of one record need one clock, so record them from one loop'
            )
    origin = min(origin_of(each) for each in states)
    alone = len(states) == 1
    runs = [runs_of(content, each, alone, log, origin=origin) for each in states]
    names = [each.topic.name for each in states]
    for topic, own in zip(names, runs, strict=True):
        if _names(own) != _names(runs[0]):
            raise RecordError(
                f'{content.path}: the records of {names[0]} ({", ".join(_names(runs[0]))}) and '
                f'{topic} ({", ".join(_names(own))}) differ; mark the records of all axes alike'
            )
    return [_bag_axes_joined(axes, log) for axes in zip(*runs, strict=True)]


def _names(runs: Sequence[Track]) -> list[str]:
    return [run.name for run in runs]


def _bag_axes_joined(tracks: Sequence[Track], log: DamageLog) -> Track:
    """Return the samples that all axes have, as one track."""
    stamps = [np.rint(1e9 * each.time).astype(np.int64) for each in tracks]
    if not all(np.array_equal(each, stamps[0]) for each in stamps):
        common = reduce(np.intersect1d, stamps)
        places = [np.unique(each, return_index=True) for each in stamps]
        tracks = [
            each.take(index[np.searchsorted(unique, common)])
            for each, (unique, index) in zip(tracks, places, strict=True)
        ]
        lone = sum(each.size for each in stamps) - len(stamps) * common.size
        what = (
            f'{counted(lone, "sample")} of record {tracks[0].name} without another axis left out'
        )
        log.note(what, count=lone)
    columns = {
        f'{what}_{k}': each.columns[what]
        for k, each in enumerate(tracks, 1)
        for what in ('voltage', 'displacement')
    }
    return replace(tracks[0], columns=columns)
