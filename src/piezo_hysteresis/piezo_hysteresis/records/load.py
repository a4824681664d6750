"""Any mix of bag folders, storage files and files of columns as records with unique names."""

from __future__ import annotations

import os
import struct
import warnings
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from glob import glob, has_magic
from pathlib import Path
from typing import Any, Generic, TypeAlias, TypeVar

import numpy as np

from piezo_hysteresis.common.wording import reason_of
from piezo_hysteresis.errors import DataNote, RecordError, SeveralAxesError
from piezo_hysteresis.records.array_pairs import refuse_arrays
from piezo_hysteresis.records.bag_content import READERS, BagContent, read_content
from piezo_hysteresis.records.bags import bag_records
from piezo_hysteresis.records.columns import ReadOptions
from piezo_hysteresis.records.damage import (
    Damage,
    DamageError,
    DamageLog,
    DamageWarning,
    LeftOutWarning,
    read_advised,
)
from piezo_hysteresis.records.foreign import foreign_records
from piezo_hysteresis.records.formats.column_table import ColumnTable
from piezo_hysteresis.records.formats.reading import FORMATS, has_format, tables
from piezo_hysteresis.records.frames import (
    Arrays,
    Columns,
    DataFrameLike,
    columns_of_arrays,
    frame_records,
)
from piezo_hysteresis.records.metadata import NAME
from piezo_hysteresis.records.record import Record, RecordList
from piezo_hysteresis.records.table_reader import file_records, with_voltage
from piezo_hysteresis.records.tabular import INFO_FILE
from piezo_hysteresis.records.text_tables import text_tables

_TEXT = ('.csv', '.txt', '.tsv', '.dat', '.lvm', '.asc', '.prn')


def is_csv(path: Path) -> bool:
    """Return whether a file is text in columns, by its name."""
    return path.suffix.lower() in _TEXT


def is_of_columns(path: Path) -> bool:
    """Return whether a file is one of columns, by its name."""
    return is_csv(path) or has_format(path)


@dataclass(frozen=True)
class FolderContent:
    """Content of a folder, each part in the order of the names; hidden entries are left out."""

    is_bag: bool
    files: tuple[Path, ...] = ()
    bags: tuple[Path, ...] = ()
    folders: tuple[Path, ...] = ()
    others: tuple[Path, ...] = ()


def content_of(folder: Path) -> FolderContent:
    """Return what a folder contains; of a bag only that it is one."""
    inside = sorted(each for each in folder.iterdir() if not each.name.startswith('.'))
    if any(each.name == NAME or not READERS.keys().isdisjoint(each.suffixes) for each in inside):
        return FolderContent(True)
    folders = [each for each in inside if each.is_dir()]
    bags = [each for each in folders if (each / NAME).is_file()]
    files = [each for each in inside if each.is_file()]
    columns = [each for each in files if is_of_columns(each)]
    known = {*columns, *bags}
    return FolderContent(
        False,
        tuple(columns),
        tuple(bags),
        tuple(each for each in folders if each not in known),
        tuple(each for each in files if each not in known and each.name != INFO_FILE),
    )


def files_of(path: Path) -> list[Path]:
    """Return the files on which the records of a path depend."""
    if not path.is_dir():
        return [each for each in (path, path.with_name(INFO_FILE)) if each.is_file()]
    content = content_of(path)
    if content.is_bag:
        return [each for each in sorted(path.rglob('*')) if each.is_file()]
    inner = [each for bag in content.bags for each in files_of(bag)]
    return [*content.files, *inner, *(each for each in [path / INFO_FILE] if each.is_file())]


def matching(pattern: str | Path) -> list[Path]:
    """Return the paths that a pattern such as ``train/*.csv`` stands for, or a plain path."""
    if not has_magic(str(pattern)) or os.path.exists(pattern):  # noqa: PTH110 - never raises
        return [Path(pattern)]
    found = sorted(map(Path, glob(str(pattern), recursive=True)))  # noqa: PTH207 - absolute too
    if not found:
        raise RecordError(f'no file matches {pattern}; check the folder and the pattern')
    return found


R = TypeVar('R')
N = TypeVar('N', bound=Any)
Source: TypeAlias = str | Path | Columns | Arrays | Record


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
    *more: Source,
    dt: float | None = None,
    fs: float | None = None,
    salvage: bool = False,
    actuator: str | None = None,
    sign: float = 1.0,
    unit: str = '',
    columns: Mapping[str, str] | None = None,
    time_from: str = '',
) -> RecordList:
    """Return records from files, folders, arrays or data frames, in any mix.

    A record that was cancelled or refused, and a file of a folder that is no record, is omitted
    with a `LeftOutWarning`.

    Parameters
    ----------
    source, *more : str, Path, mapping, arrays, data frame, Record, or sequence of them
        Bag folders, ``.mcap``/``.db3`` files, files of columns, folders of them, or patterns such
        as ``'train/*.csv'``. In memory: ``(voltage, displacement)``, ``(time, voltage,
        displacement)``, a table of these columns, ``{'voltage': u, 'displacement': y}``, or a data
        frame of pandas or polars. Columns are named like those of a file, ``time_s, voltage_V,
        displacement_um``; a quantity without its unit is in SI units.
    dt : float, optional
        Sampling interval of data without a time [s]; of a file, its time is then not used.
    fs : float, optional
        Sampling rate [Hz], in place of `dt`.
    salvage : bool
        Return the readable part of damaged data; each loss or repair gives a `DamageWarning`.
    actuator : str, optional
        Name or namespace of the actuator, if a bag contains several.
    sign : float
        -1 for a sensor that measures the distance: the displacement is reversed.
    unit : str
        Unit of a displacement that states none: ``m``, ``mm``, ``um``, ``nm``, ...
    columns : mapping of str to str, optional
        Columns of files by quantity, ``{'voltage': 'CH1:V', 'displacement': '3:um'}``; of bags of
        other messages, ``/topic.field:unit``.
    time_from : str
        ``header`` or ``recording``: which time of the messages of such a bag counts.

    Returns
    -------
    RecordList
        A list of `Record` with unique names; a single one also offers the attributes of a record.

    Raises
    ------
    RecordError
        If the data are unusable.
    """
    options = ReadOptions(
        columns or {}, interval=interval(dt, fs), sign=sign, unit=unit, time_from=time_from
    )
    return loaded([source, *more] if more else source, options, salvage, actuator)


def loaded(
    data: Any, options: ReadOptions, salvage: bool = False, actuator: str | None = None
) -> RecordList:
    """Return records like `load`, with what is stated about the files as one object."""
    found = survey(_several(data), salvage=salvage, actuator=actuator, options=options)
    _warn(found.damage, found.left_out, found.guesses)
    return RecordList(found.records)


def warn_of(log: DamageLog) -> None:
    """Warn the caller of a function that reads records which no later check covers."""
    _warn(log.findings, log.left_out, [*log.guesses, *log.unlikely_values])


def _warn(damage: list[Damage], left_out: list[Damage], guesses: list[Damage]) -> None:
    for each in damage:
        warnings.warn(str(each), DamageWarning, stacklevel=4)
    for each in left_out:
        warnings.warn(str(each), LeftOutWarning, stacklevel=4)
    for each in guesses:
        warnings.warn(str(each), DataNote, stacklevel=4)


def listed(data: Source | Iterable[Source]) -> list[Record]:
    """Return one record or several as a list; anything else is given to `load`.

    Raises
    ------
    RecordError
        If the data are unusable.
    """
    if isinstance(data, Record):
        return [data]
    if isinstance(data, list) or (
        isinstance(data, Iterable) and not isinstance(data, (str, Path, Mapping, DataFrameLike))
    ):
        given = data if isinstance(data, (np.ndarray, tuple)) else list(data)
        parts = [_records_in(item) for item in given]
        return [record for part in parts for record in part] if all(parts) else load(given)
    return load(data)


def _records_in(item: Any) -> list[Record]:
    """Return the records of a record or of a list of `load`; empty for anything else."""
    if isinstance(item, Record):
        return [item]
    return list(item) if isinstance(item, RecordList) else []


def interval(dt: float | None, fs: float | None) -> float | None:
    """Return the sampling interval [s] that is given as such or as a rate [Hz]."""
    if fs is None:
        return dt
    if dt is not None:
        raise RecordError('dt and fs are the same information; give one of them')
    if not (isinstance(fs, (int, float)) and np.isfinite(fs) and fs > 0):
        raise RecordError(f'fs must be a positive number [Hz], got {fs!r}')
    return 1.0 / fs


def _several(source: Any) -> Sequence[Source]:
    """Return one source or several as a sequence."""
    arrays = columns_of_arrays(source)
    if arrays is not None:
        return [arrays]
    if isinstance(source, list):
        return source
    if isinstance(source, (str, Path, Mapping, Record, DataFrameLike)):
        return [source]
    if isinstance(source, Sequence):
        return source
    raise RecordError(_UNKNOWN.format(type(source).__name__))


_UNKNOWN = (
    'data are a path, arrays such as (voltage, displacement) with dt, a data frame, a Record or a '
    'list of them, not of type {}'
)


def survey(
    sources: Sequence[Source],
    *,
    salvage: bool = False,
    actuator: str | None = None,
    log: DamageLog | None = None,
    options: ReadOptions | None = None,
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
    stated = options or ReadOptions()

    def read(log: DamageLog) -> Survey:
        return _survey(sources, _OneAxis(log, stated, actuator))

    return read_advised(
        read, DamageLog(salvage) if log is None else log, lambda found: found.records
    )


def _survey(sources: Sequence[Source], reading: _OneAxis) -> Survey:
    log = reading.log
    records: list[Record] = []
    for given in sources:
        source = columns_of_arrays(given) or given
        if isinstance(source, (str, Path)):
            for path in matching(source):
                records += reading.of_path(path)
        elif isinstance(source, Record):
            records.append(source)
        elif isinstance(source, (Mapping, DataFrameLike)):
            records += frame_records(source, 'record', log, reading.options)
        else:
            raise RecordError(_UNKNOWN.format(type(source).__name__))
    if reading.options.sign < 0:
        records = [_reversed(record) for record in records]
    named = uniquely_named(records)
    return Survey(named, log.findings, log.notes, reading.bags, log.left_out, log.guesses)


def _reversed(record: Record) -> Record:
    """Return a record whose sensor measures the distance; a reference has the same sign."""
    return replace(
        record,
        displacement=-record.displacement,
        reference=None if record.reference is None else -record.reference,
    )


@dataclass(frozen=True)
class Reading(ABC, Generic[R]):
    """What all readers share: the log, what the user states, and the bags that were met.

    Subclasses say what becomes of a bag, of a file of columns and of columns in memory.
    """

    log: DamageLog
    options: ReadOptions
    actuator: str | None = None
    bags: list[BagContent] = field(default_factory=list)

    @abstractmethod
    def of_bag(self, content: BagContent) -> list[R]:
        """Return the records of a bag with our topics."""

    @abstractmethod
    def of_fields(self, path: Path) -> list[R]:
        """Return the records of a bag of which fields are named."""

    @abstractmethod
    def of_columns(self, path: Path) -> list[R]:
        """Return the records of a file of columns."""

    def of_path(self, path: Path) -> list[R]:
        """Return the records of a file, bag or folder.

        Raises
        ------
        RecordError
            If there is none.
        """
        log = self.log
        before = len(log.findings)
        try:
            with sentences(path):
                found = self._read(path)
        except (SeveralAxesError, DamageError):
            raise
        except RecordError as error:
            lost = '; '.join(each.what for each in log.findings[before : before + 2])
            raise RecordError(f'{error} ({lost})' if lost else str(error)) from error
        if not found:
            lost = '; '.join(str(each) for each in (*log.findings, *log.left_out)[-2:])
            raise RecordError(f'{path}: no record in it is readable ({lost})')
        return found

    def _read(self, path: Path) -> list[R]:
        if path.is_dir() and not content_of(path).is_bag:
            return self.of_folder(path)
        if path.is_dir() or path.suffix in (*READERS, '.zstd'):
            if self.options.columns:
                return self.of_fields(path)
            content = read_content(path, self.log)
            self.bags.append(content)
            return self.of_bag(content)
        if is_of_columns(path):
            return self.of_columns(path)
        raise RecordError(
            f'{path}: data of this kind are not known; give a bag folder, .mcap, .db3, CSV or '
            f'{", ".join(FORMATS)}'
        )

    def of_folder(self, path: Path) -> list[R]:
        """Return the records of all files and bags in a folder; others are left out with a note.

        Raises
        ------
        RecordError
            If there is none.
        """
        log, content = self.log, content_of(path)
        if not (content.files or content.bags):
            inside = next((str(each) for each in content.folders), '')
            hint = f'; give the folders in it, such as {inside}' if inside else ''
            raise RecordError(f'{path}: the folder holds no bag and no file of columns{hint}')
        records: list[R] = []
        errors: list[RecordError] = []
        for each in (*content.files, *content.bags):
            known = len(log.findings)
            try:
                records += self.of_path(each)
            except RecordError as error:
                del log.findings[known:]
                errors.append(error)
        if not records:
            raise errors[0]
        for reason in errors:
            log.at(path).leave_out(f'left out: {reason}')
        if stray := [each.name for each in (*content.others, *content.folders)]:
            some = ', '.join(stray[:4]) + (', ...' if len(stray) > 4 else '')
            log.at(path).leave_out(
                f'{some} left out: no bag and no file of columns', count=len(stray)
            )
        return records


class _OneAxis(Reading[Record]):
    """Reads everything as records of one axis."""

    def of_bag(self, content: BagContent) -> list[Record]:
        return bag_records(content, self.log, self.actuator)

    def of_fields(self, path: Path) -> list[Record]:
        options = self.options
        fields = {what: text for what, text in options.columns.items() if what != 'time'}
        if 'displacement' not in fields or not {'voltage', 'force'} & fields.keys():
            raise RecordError(
                'of a bag --displacement and --voltage (or --force) belong together; name both '
                'fields'
            )
        return foreign_records(path, self.log, time_from=options.time_from, **fields)

    def of_columns(self, path: Path) -> list[Record]:
        try:
            return column_records(path, self.log, self.options)
        except RecordError:
            refuse_arrays(path)
            raise

    def of_folder(self, path: Path) -> list[Record]:
        refuse_arrays(path, content_of(path).files)
        return super().of_folder(path)


@contextmanager
def sentences(path: Path) -> Iterator[None]:
    """Refuse anything but a file or folder, with the reason in one sentence."""
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


def column_records(path: Path, log: DamageLog, options: ReadOptions) -> list[Record]:
    """Return the records of a file of columns in any format."""
    return file_records(path, tables_of_file(path, log, options), log, options)


def tables_of_file(path: Path, log: DamageLog, options: ReadOptions) -> list[ColumnTable]:
    """Return the tables of a file of columns in any format."""
    if is_csv(path):
        return text_tables(path, log, options)
    if options.header_row is not None:
        raise RecordError(f'{path}: --header-row and --skip-rows are for text; leave them out')
    return tables(path)


def reference_record(
    path: Path, options: ReadOptions | None = None, salvage: bool = False
) -> Record:
    """Return the first record of a file, also of a desired displacement without a voltage."""
    if not is_of_columns(path):
        return loaded([path], options or ReadOptions(), salvage)[0]
    chosen, log = options or ReadOptions(), DamageLog(salvage)
    with sentences(path):
        found = [with_voltage(each) for each in tables_of_file(path, log, chosen)]
        record = file_records(path, found, log, chosen)[0]
    for damage in log.findings:
        warnings.warn(str(damage), DamageWarning, stacklevel=3)
    for guess in log.guesses:
        warnings.warn(str(guess), DataNote, stacklevel=3)
    return _reversed(record) if chosen.sign < 0 else record


def uniquely_named(records: Sequence[N]) -> list[N]:
    """Return records with a number behind the names that stand twice."""
    taken: set[str] = set()
    result = []
    for record in records:
        name, number = record.name, 2
        while name in taken:
            name, number = f'{record.name}-{number}', number + 1
        taken.add(name)
        result.append(replace(record, name=name) if name != record.name else record)
    return result
