"""Any mix of bag folders, storage files and files of columns as records with unique names."""

from __future__ import annotations

import struct
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeAlias

from piezo_hysteresis.common.wording import reason_of
from piezo_hysteresis.errors import DataNote, RecordError
from piezo_hysteresis.records.bag_content import READERS, BagContent, read_content
from piezo_hysteresis.records.bags import bag_records
from piezo_hysteresis.records.csv_files import csv_records
from piezo_hysteresis.records.damage import (
    Damage,
    DamageLog,
    DamageWarning,
    LeftOutWarning,
)
from piezo_hysteresis.records.formats.reading import FORMATS, has_format, table_records
from piezo_hysteresis.records.frames import Columns, DataFrameLike, frame_records
from piezo_hysteresis.records.metadata import NAME
from piezo_hysteresis.records.record import Record

Source: TypeAlias = str | Path | Columns | Record


@dataclass(frozen=True)
class Survey:
    """Content of data, with damage and notes.

    Attributes
    ----------
    records : list of Record
        Usable records.
    damage : list of Damage
        Lost or repaired data (only when salvaging).
    notes : list of Damage
        Notes that do not prevent the use of the data.
    bags : list of BagContent
        The bags among the data, with all their topics.
    left_out : list of Damage
        Notes on records that were cancelled, refused or repeated.
    guesses : list of Damage
        Notes on guessed columns.
    """

    records: list[Record]
    damage: list[Damage] = field(default_factory=list)
    notes: list[Damage] = field(default_factory=list)
    bags: list[BagContent] = field(default_factory=list)
    left_out: list[Damage] = field(default_factory=list)
    guesses: list[Damage] = field(default_factory=list)


def load(
    source: Source | Sequence[Source],
    *,
    dt: float | None = None,
    salvage: bool = False,
    actuator: str | None = None,
) -> list[Record]:
    """Return records from files, from arrays or from data frames, in any mix.

    A record that was cancelled or refused is omitted with a `LeftOutWarning`.

    Parameters
    ----------
    source : str, Path, mapping, data frame, Record, or sequence of them
        At least one bag folder, ``.mcap``/``.db3`` file or file of columns; or columns in memory,
        such as ``{'voltage': u, 'displacement': y}`` or a data frame of pandas or polars. Columns
        are named like those of a file, ``time_s, voltage_V, displacement_um``; a quantity without
        its unit is in SI units.
    dt : float, optional
        Sampling interval of columns in memory without a time [s].
    salvage : bool
        Return the readable part of damaged data; each loss or repair gives a `DamageWarning`.
    actuator : str, optional
        Name or namespace of the actuator, if a bag contains several.

    Returns
    -------
    list of Record
        With unique names.

    Raises
    ------
    RecordError
        If the data are unusable.
    """
    found = survey(_several(source), dt=dt, salvage=salvage, actuator=actuator)
    for damage in found.damage:
        warnings.warn(str(damage), DamageWarning, stacklevel=2)
    for record in found.left_out:
        warnings.warn(str(record), LeftOutWarning, stacklevel=2)
    for guess in found.guesses:
        warnings.warn(str(guess), DataNote, stacklevel=2)
    return found.records


def _several(source: Source | Sequence[Source]) -> Sequence[Source]:
    """Return one source or several as a sequence."""
    if isinstance(source, (str, Path, Mapping, Record, DataFrameLike)):
        return [source]
    if isinstance(source, Sequence):
        return source
    raise RecordError(_UNKNOWN.format(type(source).__name__))


_UNKNOWN = (
    'data are a path, a dictionary of arrays, a data frame, a Record or a list of them, not of '
    'type {}'
)


def survey(
    sources: Sequence[Source],
    *,
    dt: float | None = None,
    salvage: bool = False,
    actuator: str | None = None,
    log: DamageLog | None = None,
) -> Survey:
    """Read like `load`, and also return damage, notes and bags.

    `log`, if given, defines what is damage and how it is treated.

    Raises
    ------
    RecordError
        If the data are unusable, or no part of them is readable.
    """
    if not sources:
        raise RecordError('no data were given; name a bag folder or a CSV file')
    log = DamageLog(salvage) if log is None else log
    records: list[Record] = []
    bags: list[BagContent] = []
    for source in sources:
        if isinstance(source, (str, Path)):
            records += _of_path(Path(source), log, bags, actuator)
        elif isinstance(source, Record):
            records.append(source)
        elif isinstance(source, (Mapping, DataFrameLike)):
            records += frame_records(source, 'record', dt, log)
        else:
            raise RecordError(_UNKNOWN.format(type(source).__name__))
    named = _uniquely_named(records)
    return Survey(named, log.findings, log.notes, bags, log.left_out, log.guesses)


def _of_path(
    path: Path, log: DamageLog, bags: list[BagContent], actuator: str | None
) -> list[Record]:
    before = len(log.findings)
    try:
        with sentences(path):
            found = _read(path, log, bags, actuator)
    except RecordError as error:
        lost = '; '.join(each.what for each in log.findings[before : before + 2])
        raise RecordError(f'{error} ({lost})' if lost else str(error)) from error
    if not found:
        lost = '; '.join(str(each) for each in (*log.findings, *log.left_out)[-2:])
        raise RecordError(f'{path}: no record in it is readable ({lost})')
    return found


@contextmanager
def sentences(path: Path) -> Iterator[None]:
    """Refuse anything but a file or folder, with the reason in one sentence.

    Raises
    ------
    RecordError
        Replaces all other exceptions of reading damaged data.
    """
    try:
        if not path.exists():
            raise RecordError(f'{path} does not exist; check the path')
        if not (path.is_file() or path.is_dir()):
            raise RecordError(f'{path}: it is a pipe or a device; save the data as a file')
        yield
    except (OSError, ValueError, KeyError, IndexError, OverflowError, RecursionError, struct.error,
            MemoryError) as error:  # fmt: skip
        reason = reason_of(error)
        raise RecordError(
            f'{path}: it cannot be read ({reason or type(error).__name__})'
        ) from error


def _read(
    path: Path, log: DamageLog, bags: list[BagContent], actuator: str | None
) -> list[Record]:
    if path.is_dir() and (inside := _data_below(path)):
        raise RecordError(
            f'{path}: the folder is no bag; give what it contains, such as {inside[0]}'
        )
    if path.is_dir() or path.suffix in READERS:
        content = read_content(path, log)
        bags.append(content)
        return bag_records(content, log, actuator)
    if is_of_columns(path):
        return column_records(path, log)
    raise RecordError(unknown_kind(path))


def _data_below(folder: Path) -> list[Path]:
    """Return the bags and files of columns in a folder; none if it is a bag itself."""
    files = sorted(folder.iterdir())
    if any(each.name == NAME or not READERS.keys().isdisjoint(each.suffixes) for each in files):
        return []
    return [each for each in files if is_of_columns(each) or (each / NAME).is_file()]


def unknown_kind(path: Path) -> str:
    """Return the sentence with which a file of another kind is refused."""
    return (
        f'{path}: data of this kind are not known; give a bag folder, .mcap, .db3, CSV or '
        f'{", ".join(FORMATS)}'
    )


def column_records(
    path: Path,
    log: DamageLog,
    chosen: Mapping[str, str] | None = None,
    header_row: int | None = None,
) -> list[Record]:
    """Return the records of a file of columns in any format, see `csv_records`.

    Raises
    ------
    RecordError
        If the file is unusable, or a line of a file that is no text is requested.
    """
    if _is_csv(path):
        return csv_records(path, log, chosen, header_row)
    if header_row is not None:
        raise RecordError(f'{path}: --header-row and --skip-rows are for text; leave them out')
    return table_records(path, log, chosen)


def is_of_columns(path: Path) -> bool:
    """Return whether a file is one of columns, by its name."""
    return _is_csv(path) or has_format(path)


def _is_csv(path: Path) -> bool:
    return path.suffix.lower() in ('.csv', '.txt', '.tsv', '.dat', '.lvm', '.asc', '.prn')


def _uniquely_named(records: list[Record]) -> list[Record]:
    taken: set[str] = set()
    result = []
    for record in records:
        name, number = record.name, 2
        while name in taken:
            name, number = f'{record.name}-{number}', number + 1
        taken.add(name)
        result.append(replace(record, name=name) if name != record.name else record)
    return result
