"""How a record was measured: readings out of range, steps of a counter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from piezo_hysteresis.common.wording import counted
from piezo_hysteresis.identification.noise import steps_of
from piezo_hysteresis.identification.outliers import interpolated, out_of_range, without_steps
from piezo_hysteresis.identification.periods import cached_per_record
from piezo_hysteresis.records import Record


def measurement_findings(record: Record) -> list[str]:
    """Return sentences on readings out of range and on steps of the counter of a record."""
    return [*_codes(record), *_steps(record)]


def as_measured(records: Sequence[Record]) -> tuple[list[Record], list[str]]:
    """Return records for a fit, and sentences on what was found wrong with their measurement.

    Readings out of range are interpolated: there was no measurement.
    """
    remarks = [
        f'record {record.name}: {sentence}'
        for record in records
        for sentence in measurement_findings(record)
    ]
    return [_usable(record) for record in records], remarks


@cached_per_record
def _usable(record: Record) -> Record:
    out = out_of_range(record.voltage, record.displacement)
    if not np.any(out):
        return record
    return replace(record, displacement=interpolated(record.displacement, out))


def _codes(record: Record) -> list[str]:
    y, out = record.displacement, out_of_range(record.voltage, record.displacement)
    if not np.any(out):
        return []
    values, count = np.unique(y[out], return_counts=True)
    about = '' if values.size == 1 else 'about '
    sentence = (
        f'{counted(int(out.sum()), "reading")} of {about}'
        f'{1e6 * float(values[np.argmax(count)]):.8g} µm far outside of all others: the sensor '
        'was out of range; they are excluded'
    )
    return [sentence]


def _steps(record: Record) -> list[str]:
    steps = steps_of(record)
    if not steps:
        return []
    where = ', '.join(
        f'{1e6 * each.height:+.4g} µm at {record.start + each.sample * record.dt:.6g} s'
        for each in steps[:3]
    )
    more = '' if len(steps) <= 3 else f' and {len(steps) - 3} more'
    kind = 'force' if record.info.input_unit == 'N' else 'voltage'
    sentence = (
        f'the reading jumps by {where}{more} and stays, but the {kind} does not jump: the counter '
        'of the sensor slipped or was set to zero; `import --without-steps` writes the record '
        'without these steps'
    )
    return [sentence]


def corrected(record: Record) -> Record:
    """Return the record without the steps of its counter."""
    steps = steps_of(record)
    if not steps:
        return record
    return replace(record, displacement=without_steps(record.displacement, steps))
