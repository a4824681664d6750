"""The samples of several axes in a bag: one topic of states an axis, all on one clock."""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce

import numpy as np

from piezo_hysteresis.arrays import IntArray
from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records.bag_content import BagContent
from piezo_hysteresis.records.bags import TopicRun, no_states, on_one_clock, origin_of, runs_of
from piezo_hysteresis.records.columns import in_order
from piezo_hysteresis.records.damage import DamageLog
from piezo_hysteresis.records.definitions import STATE
from piezo_hysteresis.records.sampling import Track


def axes_tracks(content: BagContent, log: DamageLog) -> list[Track]:
    """Return the samples of each record, with the columns ``voltage_1``, ``displacement_1``, ...

    Axes are in the order of the numbers in their topics. Samples are joined by their stamps.
    """
    states = content.of_type(STATE)
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
    return [_joined([run.track for run in axes], content, log) for axes in zip(*runs, strict=True)]


def _names(runs: Sequence[TopicRun]) -> list[str]:
    return [run.track.name for run in runs]


def _joined(tracks: Sequence[Track], content: BagContent, log: DamageLog) -> Track:
    """Return the samples that all axes have, as one track."""
    stamps = [_nanoseconds(each) for each in tracks]
    if not all(np.array_equal(each, stamps[0]) for each in stamps):
        common = reduce(np.intersect1d, stamps)
        places = [np.unique(each, return_index=True) for each in stamps]
        tracks = [
            each.take(index[np.searchsorted(unique, common)])
            for each, (unique, index) in zip(tracks, places, strict=True)
        ]
        lone = sum(each.size for each in stamps) - len(stamps) * common.size
        log.note(content.path, f'{lone} samples of record {tracks[0].name} lack another axis',
                 count=lone)  # fmt: skip
    columns = {
        f'{what}_{k}': each.columns[what]
        for k, each in enumerate(tracks, 1)
        for what in ('voltage', 'displacement')
    }
    one = tracks[0]
    return Track(one.name, one.time, columns, one.sample, one.info, one.rate)


def _nanoseconds(track: Track) -> IntArray:
    return np.rint(1e9 * track.time).astype(np.int64)
