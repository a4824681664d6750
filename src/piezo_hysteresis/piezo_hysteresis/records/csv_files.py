"""Records from and to CSV files whose columns are named with their unit."""

from __future__ import annotations

import io
import re
from collections.abc import Mapping
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from piezo_common import plain_yaml
from piezo_common.files import write_atomically
from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records import csv_columns
from piezo_hysteresis.records.damage import DamageLog
from piezo_hysteresis.records.record import Record, RecordInfo
from piezo_hysteresis.records.sampling import Track, records_of

LENGTHS = {'m': 1.0, 'mm': 1e3, 'um': 1e6, 'µm': 1e6, 'μm': 1e6, 'nm': 1e9}
# Divisors, not factors: x / 1e6 is the double nearest to x um, x * 1e-6 often is not.
UNITS = {
    'time': {'s': 1.0, 'ms': 1e3, 'us': 1e6, 'ns': 1e9},
    'voltage': {'V': 1.0, 'mV': 1e3, 'kV': 1e-3},
    'force': {'N': 1.0, 'mN': 1e3, 'kN': 1e-3},
    'displacement': LENGTHS,
    'reference': LENGTHS,
}
MEANT = {
    'time': ('t', 'zeit', 'timestamp', 'stamp', 'seconds'),
    'voltage': ('v', 'u', 'volt', 'volts', 'volatge', 'input', 'command', 'drive'),
    'force': ('f', 'load'),
    'displacement': ('x', 'y', 'pos', 'position', 'disp', 'displ', 'output', 'extension', 'stroke',
                     'deflection'),
    'reference': ('r', 'ref', 'desired', 'setpoint', 'target', 'yd'),
}  # fmt: skip
EXAMPLE = 'time_s,voltage_V,displacement_um'
INFO_FILE = 'records.yaml'


def read_csv(path: str | Path, *, salvage: bool = False) -> Record:
    """Read one CSV file with the columns ``time_s, voltage_V, displacement_um``.

    Lengths may be in m, mm, um or nm, times in s, ms, us or ns; ``force_N`` may stand in place of
    the voltage, ``reference_um`` may be added, further columns are left out.  What
    ``records.yaml`` beside the file says of it (as `export` writes it) is taken over.

    Parameters
    ----------
    path : str or Path
        File with one line of column names.
    salvage : bool
        Return the longest intact piece of a damaged file.

    Raises
    ------
    RecordError
        If the file cannot be used as it is.
    """
    log = DamageLog(salvage)
    records = csv_records(Path(path), log)
    return max(records, key=len)


def csv_records(
    path: Path, log: DamageLog, chosen: Mapping[str, str] | None = None
) -> list[Record]:
    """Return a CSV file as one record, or as its intact pieces when salvaging.

    Parameters
    ----------
    path : Path
        File with one line of column names.
    log : DamageLog
        Where damage is listed, or raised.
    chosen : mapping of str to str, optional
        ``NAME:UNIT`` or the number of a column, from 1, by what it is to be taken for; columns
        that are not named keep what their own names say.

    Raises
    ------
    RecordError
        If the file cannot be used and the log does not salvage, or nothing of it is readable.
    """
    large = path.stat().st_size > csv_columns.LARGE
    lines = _lines(path, most=_HEAD if large else -1)
    head = next((k for k, line in enumerate(lines) if line.strip() and line[0] != '#'), None)
    if head is None:
        raise RecordError(f'{path}: the file is empty; it needs the columns {EXAMPLE}')
    delimiter = next((mark for mark in ('\t', ';', ',') if mark in lines[head]), ',')
    names = [name.strip().strip('"\'') for name in lines[head].split(delimiter)]
    meanings = _meanings(path, _renamed(path, names, chosen or {}))
    plain = large and (delimiter == ',' or ',' not in ''.join(lines[head + 1 : head + 2]))
    found = csv_columns.columns(path, head, delimiter, list(meanings)) if plain else None
    if found is None:
        found = _values(path, _lines(path), head, delimiter, names, meanings, log)
    values = found
    if not values.size:
        raise RecordError(f'{path}: it has column names but no samples; export it again')
    columns = {
        what: values[:, k] / UNITS[what][unit] for k, (what, unit) in enumerate(meanings.values())
    }
    info, name, rate = _about(path)
    if 'force' in columns:
        columns['voltage'] = columns.pop('force')
        info = RecordInfo(**{**asdict(info), 'input_unit': 'N'})
    time = columns.pop('time')
    track = Track(name, time, columns, info=info, rate=rate)
    records = records_of(track, str(path), log)
    if not records:
        raise RecordError(f'{path}: nothing of it is readable as a record')
    return records


def _renamed(path: Path, names: list[str], chosen: Mapping[str, str]) -> list[str]:
    """Return the names of the columns as they would have to be, for those that are chosen."""
    columns = list(names)
    for what, text in chosen.items():
        name, colon, unit = text.rpartition(':')
        if not colon:
            name, unit = text, ''
        unit = unit or next(iter(UNITS[what]))
        place = int(name) - 1 if name not in names and name.isdigit() else -1
        if name in names:
            place = names.index(name)
        if not 0 <= place < len(names):
            raise RecordError(f'{path}: it has no column {name!r}, but {", ".join(names)[:160]}')
        if unit not in UNITS[what]:
            raise RecordError(f'{unit!r} is no unit of a {what}; use {", ".join(UNITS[what])}')
        # what was named so by itself is something else then
        columns = ['' if _meaning(each)[0] == what else each for each in columns]
        columns[place] = f'{what}_{unit}'
    return columns


def _meanings(path: Path, names: list[str]) -> dict[int, tuple[str, str]]:
    """Return which column means what in which unit, by the column's place."""
    meanings: dict[int, tuple[str, str]] = {}
    helps = []
    for place, name in enumerate(names):
        what, unit = _meaning(name)
        if what and unit:
            if what in (known for known, _ in meanings.values()):
                raise RecordError(f'{path}: the column {what} stands twice; keep one of them')
            meanings[place] = (what, unit)
        elif what:
            example = (
                next(iter(UNITS[what])) if what not in ('displacement', 'reference') else 'um'
            )
            helps.append(f'rename {name!r} to {what}_{example} (or its unit)')
    found = {what for what, _ in meanings.values()}
    if {'voltage', 'force'} <= found:
        raise RecordError(
            f'{path}: it has both a voltage and a force; keep the one that drives it'
        )
    missing = [what for what in ('time', 'voltage', 'displacement') if what not in found]
    if 'force' in found:
        missing = [what for what in missing if what != 'voltage']
    if missing:
        advice = '; '.join(helps) if helps else f'columns are named like {EXAMPLE}'
        advice += f', or named to `import` (--{missing[0]} COLUMN:UNIT)'
        listed = ', '.join(names)[:120]
        raise RecordError(
            f'{path}: no column for {" and ".join(missing)} among {listed!r}; {advice}'
        )
    return meanings


def _meaning(name: str) -> tuple[str, str]:
    """Return the quantity and unit of a column; the unit is empty where it is not understood."""
    stem, _, unit = name.rpartition('_')
    stem = stem.lower()
    if stem in UNITS:
        for known in UNITS[stem]:
            if unit == known or unit.lower() == known.lower():
                return stem, known
        return stem, ''
    parts = [part for part in re.split(r'[^a-zµμ]+', name.lower()) if part]
    for what, spellings in MEANT.items():
        if parts and (parts[0] == what or parts[0] in spellings):
            return what, ''
    return '', ''


# Characters in which the column names of a large file are looked for.
_HEAD = 100_000


def _lines(path: Path, most: int = -1) -> list[str]:
    try:
        with path.open(encoding='utf-8-sig') as file:
            return file.read(most).splitlines()
    except UnicodeDecodeError:
        raise RecordError(f'{path}: this is no text; save it as CSV in UTF-8') from None


def _values(
    path: Path,
    lines: list[str],
    head: int,
    delimiter: str,
    names: list[str],
    meanings: dict[int, tuple[str, str]],
    log: DamageLog,
) -> FloatArray:
    """Return the numbers of the columns that mean something, shape (n, columns)."""
    body = lines[head + 1 :]
    if delimiter != ',' and any(',' in line for line in body[:1]):
        body = [line.replace(',', '.') for line in body]
    options: dict[str, Any] = {'delimiter': delimiter, 'usecols': list(meanings), 'ndmin': 2}
    if all(not line.strip() or line.lstrip().startswith('#') for line in body):
        return np.zeros((0, len(meanings)))
    try:
        return np.asarray(np.loadtxt(body, **options))
    except ValueError:
        return _slowly(path, body, head, delimiter, names, meanings, log)


def _slowly(
    path: Path,
    body: list[str],
    head: int,
    delimiter: str,
    names: list[str],
    meanings: dict[int, tuple[str, str]],
    log: DamageLog,
) -> FloatArray:
    """Read line by line, to say which line is wrong and to keep the others."""
    rows, wrong, first = [], 0, ''
    for number, line in enumerate(body, start=head + 2):
        if not line.strip() or line.startswith('#'):
            continue
        cells = line.split(delimiter)
        row = []
        for place in meanings:
            cell = cells[place].strip().strip('"') if place < len(cells) else ''
            try:
                row.append(float(cell))
            except ValueError:
                first = first or f'line {number} has {cell!r} in column {names[place]}'
        if len(row) == len(meanings):
            rows.append(row)
        else:
            wrong += 1
    if wrong:
        log.add(path, f'{wrong} lines are not numbers, {first}', count=wrong, lost=wrong,
                remedy='mend them')  # fmt: skip
    return np.array(rows).reshape(-1, len(meanings))


def _about(path: Path) -> tuple[RecordInfo, str, float]:
    """Return what ``records.yaml`` beside a file says of it, its name and its rate."""
    notes = path.with_name(INFO_FILE)
    entry: Any = None
    if notes.is_file():
        try:
            entry = (plain_yaml.load_file(notes) or {}).get(path.name)
        except (OSError, yaml.YAMLError, AttributeError) as error:
            reason = str(error).split('\n', 1)[0]
            raise RecordError(
                f'{notes}: it cannot be read ({reason}); mend or remove it'
            ) from None
    if not isinstance(entry, dict):
        return RecordInfo(), path.stem, 0.0
    try:
        known = {
            item.name: type(getattr(RecordInfo(), item.name))(entry[item.name])
            for item in fields(RecordInfo)
            if item.name in entry
        }
        return (
            RecordInfo(**known),
            str(entry.get('record', path.stem)),
            float(entry.get('rate', 0)),
        )
    except (TypeError, ValueError, OverflowError):
        raise RecordError(
            f'{notes}: the entry of {path.name} has a value of the wrong kind; mend it'
        ) from None


def write_csv(path: str | Path, record: Record, *, unit: str = 'um') -> None:
    """Write one record with the columns ``time_s, voltage_V, displacement_um``.

    Parameters
    ----------
    path : str or Path
        File to create.
    record : Record
        What to write; ``force_N`` where its input is a force, a reference where it has one.
    unit : str
        Unit of the displacement: m, mm, um or nm.  In ``m`` every number is exact.

    Raises
    ------
    RecordError
        If the file exists or cannot be written; nothing is left behind then.
    """
    path = Path(path)
    if unit not in LENGTHS:
        raise RecordError(f'unit {unit!r} is not known; use m, mm, um or nm')
    if path.exists():
        raise RecordError(f'{path} exists already; remove it or choose another name')
    drive = 'force_N' if record.info.input_unit == 'N' else 'voltage_V'
    names = ['time_s', drive, f'displacement_{unit}']
    columns = [record.voltage, record.displacement * LENGTHS[unit]]
    if record.reference is not None:
        names.append(f'reference_{unit}')
        columns.append(record.reference * LENGTHS[unit])
    text = io.StringIO()
    text.write(','.join(names) + '\n')
    rows = zip(record.time.tolist(), *[column.tolist() for column in columns], strict=True)
    text.writelines(f'{time:.12g},' + ','.join(map(repr, values)) + '\n' for time, *values in rows)
    try:
        with write_atomically(path) as temporary:
            temporary.write_text(text.getvalue(), 'utf-8')
    except OSError as error:
        raise RecordError(f'{path}: it cannot be written ({error.strerror or error})') from None
