"""Messages of the verbs about their input data."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.axes.axes_record import AxesRecord
from piezo_hysteresis.cli import verbosity
from piezo_hysteresis.common.wording import counted
from piezo_hysteresis.identification.noise import stroke_of
from piezo_hysteresis.records import Record, Survey
from piezo_hysteresis.records.bag_content import DROPPED_KEY, BagContent
from piezo_hysteresis.records.columns import counted_axes


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return columns aligned under their headers; numbers are right-aligned."""
    width = [max(len(line[k]) for line in [head, *rows]) for k in range(len(head))]
    number = [all(_is_number(row[k]) for row in rows) for k in range(len(head))]
    lines = []
    for line in [head, *rows]:
        cells = zip(line, width, number, strict=True)
        lines.append('  '.join(c.rjust(w) if n else c.ljust(w) for c, w, n in cells).rstrip())
    return '\n'.join(lines)


def _is_number(cell: str) -> bool:
    return cell.replace('.', '').replace('-', '').replace('+', '').replace('e', '').isdigit()


def records_table(records: Sequence[Record]) -> str:
    """Return one line per record: size, rate, ranges and annotations."""
    head = ['record', 'samples', 'rate Hz', 'start s', 'duration s', 'input', 'stroke µm',
            'excitation', 'reference', 'actuator']  # fmt: skip
    rows = [
        [
            record.name,
            str(len(record)),
            f'{record.rate:.6g}',
            f'{record.start:.6g}',
            f'{record.duration:.6g}',
            f'{record.voltage.min():.4g} .. {record.voltage.max():.4g} {record.info.input_unit}',
            f'{stroke_of(record) * 1e6:.4g}',
            _excitation(record),
            'yes' if record.reference is not None else 'no',
            record.info.actuator or '-',
        ]
        for record in records
    ]
    return table(head, rows)


def axes_table(records: Sequence[AxesRecord]) -> str:
    """Return what records of several axes share, and one line per record."""
    first = records[0]
    levels = {each.level: sum(r.level == each.level for r in records) for each in records}
    listed = ', '.join(f'{name} ({counted(n, "record")})' for name, n in levels.items())
    head = ['record', 'samples', 'periods', 'level', 'voltage V RMS', 'stroke µm', 'noise nm']
    rows = [
        [
            record.name,
            str(len(record)),
            str(record.periods) if record.periods else '-',
            record.level,
            _numbers(record.voltage.std(axis=0)),
            _numbers(1e6 * np.ptp(record.displacement, axis=0)),
            '-' if record.noise is None else _numbers(1e9 * record.noise),
        ]
        for record in records
    ]
    axes = counted_axes(first.axes, first.outputs)
    return f'{axes} at {first.rate:.6g} Hz; levels: {listed}\n{table(head, rows)}'


def _numbers(values: FloatArray) -> str:
    return ' '.join(f'{each:.4g}' for each in values)


def _excitation(record: Record) -> str:
    frequency = record.info.frequency
    return record.info.excitation + (f' {frequency:.4g} Hz' if frequency else '')


def topics_table(bag: BagContent) -> str:
    """Return one line per topic of a bag: type, number of messages and their mean rate."""
    rows = []
    for name, held in sorted(bag.topics.items()):
        span = (held.last - held.first) * 1e-9
        rate = f'{(held.count - 1) / span:.4g}' if held.count > 1 and span > 0 else '-'
        rows.append([name, held.topic.msgtype, str(held.count), rate])
    return table(['topic', 'type', 'messages', 'mean rate Hz'], rows)


def bag_lines(bag: BagContent) -> list[str]:
    """Return the metadata of a bag: storage, files, and dropped messages."""
    metadata = bag.metadata
    if metadata is None:
        return []
    names = ', '.join(file.name for file in metadata.files)
    lines = [f'storage {metadata.storage}: {names}']
    dropped = metadata.custom.get(DROPPED_KEY, '0')
    if dropped != '0':
        lines.append(f'its recorder had to drop {counted(int(dropped), "message")}')
    return lines


def print_survey_notes(found: Survey) -> None:
    """Print lost, repaired and noteworthy data to stderr."""
    for note in found.notes:
        verbosity.warn(str(note), 'note')
    for damage in found.damage:
        verbosity.warn(str(damage), 'salvaged')
    if found.damage:
        lost = sum(damage.lost for damage in found.damage)
        verbosity.warn(
            f'{counted(len(found.damage), "finding")}, {counted(lost, "sample")} lost', 'salvaged'
        )
