"""Arrays (sample, channel[, realisation[, period]]) of voltages and displacements in files."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records.columns import in_order, several_axes
from piezo_hysteresis.records.formats import columnar, hdf5, sizes
from piezo_hysteresis.records.formats.column_table import interval_of

USUAL = (('u*', 'y*'), ('voltage*', 'displacement*'))
KINDS = ('.npy', '.npz', '.mat', '.h5', '.hdf5')


@dataclass(frozen=True)
class ArrayPair:
    """Voltages and displacements of one experiment."""

    name: str  # what the two names share; empty if nothing
    names: tuple[str, str]  # of the two arrays
    voltage: Any  # (n, channels[, realisations[, periods]])
    displacement: Any  # (n, channels[, realisations[, periods]])
    interval: float = 0.0  # sampling interval that the file states [s]; 0 if none


def file_pairs(path: Path, voltage: str = '', displacement: str = '') -> list[ArrayPair]:
    """Return the pairs of arrays in one file; none if it holds columns."""
    if path.suffix.lower() not in KINDS:
        return []
    found = _arrays_of(path)
    many = {name: each for name, each in found.items() if np.squeeze(each).ndim > 1}
    return list(_pairs(many, voltage, displacement, path, interval_of(found)))


def folder_pairs(
    path: Path, files: Sequence[Path], voltage: str = '', displacement: str = ''
) -> list[ArrayPair]:
    """Return the pairs of ``.npy`` files in a folder; none if its files hold columns."""
    arrays: dict[str, Any] = {}
    for each in files:
        if each.suffix.lower() == '.npy':
            arrays |= _arrays_of(each)
    return list(_pairs(arrays, voltage, displacement, path, 0.0))


def refuse_arrays(path: Path, files: Sequence[Path] = ()) -> None:
    """Refuse the arrays of several axes in a file, or in the files of a folder."""
    pairs: list[ArrayPair] = []
    with suppress(RecordError):  # what is no pair is read as columns
        pairs = file_pairs(path) if path.is_file() else folder_pairs(path, files)
    for each in pairs:
        refuse_pair(path, each)


def refuse_pair(where: object, pair: ArrayPair) -> None:
    """Refuse a pair of arrays of several axes."""
    voltages, displacements = (
        [f'{name}[:, {k}]' for k in range(_channels(array))]
        for name, array in zip(pair.names, (pair.voltage, pair.displacement), strict=True)
    )
    if max(len(voltages), len(displacements)) > 1:
        take = '`ph.load_axes(DATA, fs=RATE)[0].axis(0)` in Python'
        raise several_axes(where, voltages, displacements, take)


def _channels(array: Any) -> int:
    return int(array.shape[1]) if array.ndim > 1 else 1


def _pairs(
    arrays: Mapping[str, Any], voltage: str, displacement: str, where: object, interval: float
) -> Iterator[ArrayPair]:
    """Yield arrays whose names match the patterns with the same text for the wildcards."""
    if bool(voltage) != bool(displacement):
        raise RecordError('patterns of voltage and displacement belong together; give both')
    given = [(voltage, displacement)] if voltage else USUAL
    if not arrays:
        return
    for inputs, outputs in given:
        left = _by_wildcards(arrays, inputs)
        right = _by_wildcards(arrays, outputs)
        if not (left or right):
            continue
        lone = sorted(left.keys() ^ right.keys())
        if lone:
            name = left.get(lone[0]) or right.get(lone[0])
            if not voltage:
                continue
            raise RecordError(
                f'{where}: {name} has no partner; names of voltage and displacement differ only '
                f'in what is fixed in {inputs} and {outputs}'
            )
        rests = list(left)
        for k in in_order(list(left.values()), range(len(left))):
            rest = rests[k]
            yield ArrayPair(
                _shared(left[rest], right[rest]) or ' '.join(rest).strip(' _-.'),
                (left[rest], right[rest]),
                arrays[left[rest]], arrays[right[rest]], interval,
            )  # fmt: skip
        return


def _shared(one: str, other: str) -> str:
    """Return the words at the end that two names share."""
    parts = []
    for a, b in zip(*(re.split(r'([_\-. ]+)', name)[::-1] for name in (one, other)), strict=False):
        if a != b:
            break
        parts.append(a)
    return ''.join(parts[::-1]).strip(' _-.')


def _by_wildcards(names: Mapping[str, Any], pattern: str) -> dict[tuple[str, ...], str]:
    """Return the names that match a pattern, by the texts for its wildcards."""
    parts = re.split(r'(\*|\?|\[[^\]]+\])', pattern)
    held = {'*': '(.*)', '?': '(.)'}
    text = ''.join(
        held.get(part, f'([{re.sub("^!", "^", part[1:-1])}])') if k % 2 else re.escape(part)
        for k, part in enumerate(parts)
    )
    try:
        expression = re.compile(text)
    except re.error:
        raise RecordError(
            f"the pattern {pattern!r} is not understood; use *, ? and [...], as in 'u_[12]*'"
        ) from None
    matches = {name: expression.fullmatch(name) for name in names}
    return {found.groups(): name for name, found in matches.items() if found}


def _arrays_of(path: Path) -> dict[str, Any]:
    """Return the arrays of numbers in a file by name."""
    try:
        found = _opened(path)
    except Exception as error:  # libraries raise any exception for truncated or damaged files
        reason = ' '.join(str(error).split())[:120] or type(error).__name__
        raise RecordError(f'{path}: it cannot be read ({reason}); save it again') from None
    return {
        name: each
        for name, each in found.items()
        if isinstance(each, np.ndarray) and each.dtype.kind in 'biuf'
    }


def _opened(path: Path) -> dict[str, Any]:
    kind = path.suffix.lower()
    if kind in ('.npy', '.npz'):
        return columnar.arrays(path)
    if kind != '.mat' or hdf5.is_in_matlab(path):
        return hdf5.arrays(path)
    from scipy.io import loadmat

    sizes.judge_matlab(path)
    return dict(loadmat(path))
