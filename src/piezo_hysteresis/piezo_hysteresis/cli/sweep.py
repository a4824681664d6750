"""Measure a sweep on a motion controller at its own sampling rate, and write a bag."""

from __future__ import annotations

import argparse
import os
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from piezo_hysteresis.cli.verbosity import progress_bar
from piezo_hysteresis.common.wording import counted
from piezo_hysteresis.drivers import open_controller, sweep, write_measured
from piezo_hysteresis.drivers.addresses import FORMS, TAKE_OVER
from piezo_hysteresis.errors import PiezoError, RecordError
from piezo_hysteresis.records import Record

# Size of a sample in a bag, its entry in the index included.
_SAMPLE_BYTES = 120
EXAMPLE = (
    'sweep --on gcs://192.168.0.10 --frequencies 1,10 --amplitudes 5,10 --range 0 100 --out sweep'
)


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this verb."""
    add = parser.add_argument
    add('--on', required=True, metavar='ADDRESS', help=f'the controller: {FORMS}')
    add('--axis', default='1', help='axis of the controller')
    add('--frequencies', required=True, type=_numbers, metavar='HZ,...', help='frequencies [Hz]')
    add('--amplitudes', required=True, type=_numbers, metavar='V,...', help='amplitudes [V]')
    add('--seconds', type=float, default=2.0, metavar='S', help='length of each record [s]')
    add(
        '--warm-up',
        type=float,
        default=0.0,
        metavar='S',
        help='initial time excluded from errors [s]',
    )
    add(
        '--waveform',
        default='sine',
        help='waveform; `python -m piezo_sim describe waveforms` lists them',
    )
    add('--options', default='', metavar='YAML',
        help='settings of the waveform, such as {offset: 30}')  # fmt: skip
    add('--range', nargs=2, type=float, metavar=('LOW', 'HIGH'),
        help='voltage range that is never exceeded [V]')  # fmt: skip
    add('--slew', type=float, metavar='V/S', help='slew rate that is never exceeded [V/s]')
    add('--take-over', action='store_true', help=TAKE_OVER)
    add('--actuator', default='', help='name of the actuator in the records')
    add('--out', required=True, metavar='BAG', help='bag folder to create')


def run(arguments: argparse.Namespace) -> int:
    """Connect, check, measure, and write the bag."""
    out = Path(arguments.out)
    if out.exists():
        raise RecordError(f'{out} exists already; remove it or choose another name')
    low, high = arguments.range or (None, None)
    with (
        open_controller(
            arguments.on, arguments.axis, low, high, arguments.slew, take_over=arguments.take_over
        ) as controller,
        progress_bar('sweep') as report,
    ):
        count = len(arguments.frequencies) * len(arguments.amplitudes)
        _require_room(out, count * arguments.seconds * controller.identity.rate)
        controller.open_loop()
        records = sweep(
            controller, arguments.frequencies, arguments.amplitudes, arguments.seconds,
            warm_up=arguments.warm_up, waveform=arguments.waveform, options=arguments.options,
            actuator=arguments.actuator, progress=report,
        )  # fmt: skip
        about = controller.about()
    try:
        write_measured(out, records, about)
    except (RecordError, OSError) as error:
        raise _rescued(out, records, about, error) from None
    samples = sum(len(record) for record in records)
    print(f'{out}: {counted(len(records), "record")}, {samples} samples at {records[0].rate:g} Hz')
    return 0


def _require_room(out: Path, samples: float) -> None:
    """Require a folder that can be written, with room for the samples, before any voltage."""
    parent = next(each for each in out.absolute().parents if each.exists())
    if not os.access(parent, os.W_OK):
        raise RecordError(f'{parent} cannot be written; choose another --out')
    free = shutil.disk_usage(parent).free
    if free < _SAMPLE_BYTES * samples:
        raise RecordError(
            f'{parent} has {free / 1e6:.0f} MB free; the sweep needs '
            f'{_SAMPLE_BYTES * samples / 1e6:.0f} MB: choose another --out, or measure less'
        )


def _rescued(
    out: Path, records: Sequence[Record], about: Mapping[str, Any], error: Exception
) -> RecordError:
    """Write measured records to the temporary folder, and return the error that says so."""
    kept = Path(tempfile.mkdtemp(prefix='piezo_sweep_')) / out.name
    try:
        write_measured(kept, records, about)
    except (RecordError, OSError):
        return RecordError(f'{error}; the measured records are lost')
    return RecordError(f'{error}; the measured records are in {kept}')


def _numbers(text: str) -> list[float]:
    try:
        return [float(word) for word in text.split(',')]
    except ValueError:
        raise PiezoError(f'{text!r} is no list of numbers such as 1,5,23') from None
