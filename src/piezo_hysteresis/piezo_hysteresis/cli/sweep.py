"""Measure a sweep on a motion controller at its own sampling rate, and write a bag."""

from __future__ import annotations

import argparse
from pathlib import Path

from piezo_hysteresis.cli.progress import progress_bar
from piezo_hysteresis.common.wording import counted
from piezo_hysteresis.drivers import open_controller, sweep, write_measured
from piezo_hysteresis.drivers.addresses import FORMS, TAKE_OVER
from piezo_hysteresis.errors import PiezoError, RecordError

HELP = 'measure a sweep on a controller (PI, GCS 2; piezosystem jena, NV200)'
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
        controller.open_loop()
        records = sweep(
            controller, arguments.frequencies, arguments.amplitudes, arguments.seconds,
            warm_up=arguments.warm_up, waveform=arguments.waveform, options=arguments.options,
            actuator=arguments.actuator, progress=report,
        )  # fmt: skip
        about = controller.about()
    write_measured(out, records, about)
    samples = sum(len(record) for record in records)
    print(f'{out}: {counted(len(records), "record")}, {samples} samples at {records[0].rate:g} Hz')
    return 0


def _numbers(text: str) -> list[float]:
    try:
        return [float(word) for word in text.split(',')]
    except ValueError:
        raise PiezoError(f'{text!r} is no list of numbers such as 1,5,23') from None
