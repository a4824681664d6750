"""Demonstrate the complete workflow, or identify your own records.

Without data: a simulated bimorph actuator is swept over live ROS 2 nodes into a bag, identified,
and tracks a reference with and without compensation. With --data only the identification runs, on
the given records, with automatic model selection. Writes report.html, summary.json, model.yaml and
params.yaml to the output folder.
"""

from __future__ import annotations

import argparse
import json
import signal
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from piezo_hysteresis.cli import verbosity
from piezo_hysteresis.cli.shared_options import add_out
from piezo_hysteresis.cli.verbosity import progress_bar
from piezo_hysteresis.errors import IdentificationError

if TYPE_CHECKING:
    from piezo_hysteresis.models import ModelFile

EXAMPLE = 'demo --data my_record.csv --out out/mine'


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this verb."""
    parser.add_argument(
        '--data',
        nargs='+',
        metavar='DATA',
        help='your own bags or CSV files, instead of the simulation',
    )
    add_out(parser, 'out/demo')


def run(arguments: argparse.Namespace) -> int:
    """Run the demo."""
    # Child processes stop in the same way after an interrupt and after termination.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _interrupt)
    out = Path(arguments.out)
    if arguments.data:
        identify_own(arguments.data, out)
    else:
        show(out)
    print(f'written to {out}: open {out / "report.html"}')
    return 0


def _interrupt(*_: object) -> None:
    processes = sys.modules.get('piezo_hysteresis.ros.processes')
    if processes is not None:
        processes.INTERRUPTED.set()
    raise KeyboardInterrupt


def show(out: Path) -> None:
    """Run the experiment on live nodes, print the table and write the results."""
    from piezo_hysteresis.cli.demo_live import run_demo
    from piezo_hysteresis.reporting.demo_report import Plan, write_demo_report
    from piezo_hysteresis.reporting.folder import replacing

    started = time.perf_counter()
    with replacing(out, 'demo') as folder:
        with progress_bar('demo') as progress:
            demo = run_demo(Plan(), folder, progress)
            progress(0.97, 'drawing the report')
            write_demo_report(
                folder / 'report.html', demo.sweep, demo.found, demo.runs, demo.plan, out
            )
        saved = demo.found.model_file(['bags/sweep'], demo.sweep[0].rate)
        _write(folder, saved, demo.summary(), started)
    _print_runs(demo)
    print(f'{time.perf_counter() - started:.0f} s')


def identify_own(data: Sequence[str], out: Path) -> None:
    """Select a model for the records of the user, identify it and write the results."""
    from piezo_hysteresis.discovery.choose import choose_model
    from piezo_hysteresis.identification.identify import identify
    from piezo_hysteresis.process_setup import number_of_workers
    from piezo_hysteresis.records import load
    from piezo_hysteresis.reporting.demo_report import write_data_report
    from piezo_hysteresis.reporting.folder import replacing

    started = time.perf_counter()
    records = load(data)
    if len({record.rate for record in records}) > 1:
        raise IdentificationError('the records have different rates; give those of one rate')
    with replacing(out, 'demo') as folder:
        with progress_bar('identifying') as progress:
            choice = choose_model(
                records,
                lambda f, words: progress(0.7 * f, f'trying {words}'),
                workers=number_of_workers(0),
            )
            progress(0.7, f'fitting {choice.model.name}')
            found = identify(records, choice.model, start=choice.start, count=1)
            progress(0.95, 'drawing the report')
            given = [str(each) for each in data]
            write_data_report(folder / 'report.html', records, found, choice.steps, given, out)
        steps = [vars(step) for step in choice.steps]
        summary = {'choice': steps, 'held_out': [vars(each) for each in choice.held_out]}
        saved = found.model_file(given, records[0].rate)
        _write(folder, saved, {**found.summary(), **summary}, started)
    _print_fit(found)
    for each in choice.held_out:
        print(
            f'  {each.record}: last 30 %, not fitted: {1e6 * each.free_run_rms:.4g} µm '
            f'({each.nrmse_percent:.3g} % of the standard deviation there)'
        )


def _write(folder: Path, saved: ModelFile, summary: dict[str, Any], started: float) -> None:
    """Write ``model.yaml``, ``params.yaml`` (for ``ros2 param load``) and ``summary.json``."""
    saved.save(folder / 'model.yaml')
    saved.save_ros_parameters(folder / 'params.yaml')
    content = {**summary, 'seconds': round(time.perf_counter() - started, 3)}
    text = json.dumps(content, indent=2, allow_nan=False) + '\n'
    (folder / 'summary.json').write_text(text, encoding='utf-8')


def _print_runs(demo: Any) -> None:
    from rich import box
    from rich.console import Console
    from rich.table import Table

    title = f'Tracking error at {demo.plan.tracked:g} Hz in µm: rms and harmonics'
    table = Table(title=title, title_justify='left', box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    table.add_column('run', no_wrap=True)
    orders = list(demo.runs[0].metrics.harmonics)
    for heading in ('RMSE', 'less mean', *(f'{order}x' for order in orders)):
        table.add_column(heading, justify='right', no_wrap=True)
    for run in demo.runs:
        m = run.metrics
        numbers = (m.rms, m.rms_without_mean, *m.harmonics.values())
        table.add_row(run.name, *(f'{1e6 * number:.3f}' for number in numbers))
    # a pipe has no width: use a width at which no number is truncated
    Console(width=None if sys.stdout.isatty() else 100).print(table)


def _print_fit(found: Any) -> None:
    print(f'{found.chain.name}: {found.message}')
    for row in found.records:
        print(
            f'  {row.record}: free run {1e6 * row.free_run_rms:.4g} µm '
            f'({row.nrmse_percent:.3g} % of its standard deviation)'
        )
    for warning in found.warnings:
        verbosity.warn(str(warning))
