"""Measure a sweep on a controller: it runs there, at its own rate, and becomes a bag."""

from __future__ import annotations

import argparse
import math
from dataclasses import asdict
from pathlib import Path
from urllib.parse import urlsplit

import yaml

from piezo_hysteresis.cli.progress import progress_bar
from piezo_hysteresis.common.wording import counted
from piezo_hysteresis.drivers.gcs import Connection, DriveLimits, DriverError, GcsController, sweep
from piezo_hysteresis.drivers.gcs.connection import PORT
from piezo_hysteresis.errors import PiezoError, RecordError
from piezo_hysteresis.records import write_bag

HELP = 'measure a sweep on a controller (PI, GCS 2)'

#: What the controller says of itself, beside the bag.
ABOUT = 'controller.yaml'


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the words of this verb."""
    add = parser.add_argument
    add('--on', required=True, metavar='gcs://HOST[:PORT]', help='the controller')
    add('--axis', default='1', help='of the controller (default 1)')
    add('--frequencies', required=True, type=_numbers, metavar='HZ,...')
    add('--amplitudes', required=True, type=_numbers, metavar='V,...')
    add('--seconds', type=float, default=2.0, metavar='S', help='of each record (default 2)')
    add('--warm-up', type=float, default=0.0, metavar='S', help='that errors leave out')
    add('--waveform', default='sine', help='see piezo_sim describe waveforms')
    add('--options', default='', metavar='YAML',
        help='settings of the waveform, as {offset: 30}')  # fmt: skip
    add('--range', nargs=2, type=float, metavar=('LOW', 'HIGH'),
        help='volts that are never left; that of the controller where it is narrower')  # fmt: skip
    add('--slew', type=float, metavar='V/S', help='rate that is never exceeded')
    add('--actuator', default='', help='its name in the records')
    add('--out', required=True, metavar='BAG', help='bag folder to create')


def run(arguments: argparse.Namespace) -> int:
    """Connect, check, measure, and write the bag."""
    out = Path(arguments.out)
    if out.exists():
        raise RecordError(f'{out} exists already; remove it or choose another name')
    low, high = arguments.range or (None, None)
    with (
        controller_of(arguments.on, arguments.axis, low, high, arguments.slew) as controller,
        progress_bar('sweep') as tell,
    ):
        about = {
            'controller': asdict(controller.identity),
            'axis': arguments.axis,
            'voltage': 'control voltage of the output [V]',
            'displacement': 'position as the controller measures it, with its own filters',
            'limits': asdict(controller.limits),
        }
        controller.open_loop()
        records = sweep(
            controller, arguments.frequencies, arguments.amplitudes, arguments.seconds,
            warm_up=arguments.warm_up, waveform=arguments.waveform, options=arguments.options,
            actuator=arguments.actuator, progress=tell,
        )  # fmt: skip
    write_bag(out, records)
    (out / ABOUT).write_text(yaml.safe_dump(about, sort_keys=False), 'utf-8')
    samples = sum(len(record) for record in records)
    print(f'{out}: {counted(len(records), "record")}, {samples} samples at {records[0].rate:g} Hz')
    return 0


def controller_of(
    text: str, axis: str, low: float | None, high: float | None, slew: float | None
) -> GcsController:
    """Connect to the controller that ``gcs://HOST[:PORT]`` names, with limits where given.

    Raises
    ------
    PiezoError
        If the text is something else, or no controller answers.
    """
    host, port = address(text)
    limits = DriveLimits(
        -math.inf if low is None else low,
        math.inf if high is None else high,
        math.inf if slew is None else slew,
    )
    return GcsController(Connection(host, port), limits, axis)


def address(text: str) -> tuple[str, int]:
    """Return host and port of ``gcs://HOST[:PORT]``.

    Raises
    ------
    PiezoError
        If it is something else.
    """
    try:
        parts = urlsplit(text)
        host, port = parts.hostname, parts.port
    except ValueError:
        host, port = None, None
    if host is None or parts.scheme != 'gcs':
        raise DriverError(f'{text!r} is no controller: write gcs://HOST or gcs://HOST:{PORT}')
    return host, PORT if port is None else port


def _numbers(text: str) -> list[float]:
    try:
        return [float(word) for word in text.split(',')]
    except ValueError:
        raise PiezoError(f'{text!r} is no list of numbers such as 1,5,23') from None
