"""Identify or discover over many data sets, each separately.

Each data set gets a folder in DIR with all results of the verb; results.csv and index.html
combine them. The same command continues after an interruption or with more data:
finished results are kept if data and settings are unchanged. Unusable data are rows that state the
reason. The CSV files of a folder are one data set, such as all records of a stage; a folder that
contains only folders or bags stands for them.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from piezo_hysteresis.cli import discover, identify
from piezo_hysteresis.cli.verbosity import progress_bar
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.process_setup import number_of_workers

EXAMPLE = 'batch identify bags --model classical --out table'


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this verb: those of the repeated verb and of the executor."""
    verbs = parser.add_subparsers(
        title='verb for each data set', dest='each', metavar='VERB', required=True
    )
    for name, module in (('identify', identify), ('discover', discover)):
        # --workers means processes here: it replaces the option of the repeated verb
        each = verbs.add_parser(name, help=f'{name} each data set', conflict_handler='resolve')
        module.configure(each)
        add = each.add_argument
        add('--workers', type=int, default=0, metavar='N', help='processes, 0 for one per core')
        add(
            '--dask',
            metavar='ADDRESS',
            help='scheduler of a Dask cluster, such as tcp://host:8786',
        )


def run(arguments: argparse.Namespace) -> int:
    """Run the batch and print its result."""
    from piezo_hysteresis.batch import run_batch

    # one thread in each process
    workers, arguments.workers = number_of_workers(arguments.workers), 1
    module: Any = {'identify': identify, 'discover': discover}[arguments.each]
    for name in ('model', 'baseline'):  # remote workers have other working directories
        value = getattr(arguments, name, None) or ''
        if value.endswith(('.yaml', '.yml')):
            setattr(arguments, name, str(Path(value).resolve()))
    options = {**module.options_of(arguments), 'workers': 1}
    with _cluster(arguments.dask) as executor, progress_bar(f'batch {arguments.each}') as progress:
        done = run_batch(
            arguments.each, arguments.data, arguments.out, executor=executor, processes=workers,
            progress=progress, **options,
        )  # fmt: skip
    for row in done.rows:
        if row['state'] != 'done':
            print(f'{row["state"]}: {row["name"]}: {row["error"]}', file=sys.stderr)
    print(done)
    print(f'written to {arguments.out}; open {arguments.out}/index.html')
    return 0 if any(row['state'] == 'done' for row in done.rows) else 2


@contextmanager
def _cluster(address: str | None) -> Iterator[Executor | None]:
    """Provide the executor of a Dask cluster, None without an address."""
    if address is None:
        yield None
        return
    try:
        from distributed import Client
    except ModuleNotFoundError as error:
        raise PiezoError('--dask needs Dask: pip install dask distributed') from error
    try:
        client = Client(address, timeout=10)
    except (OSError, ValueError, TypeError) as error:
        raise PiezoError(f'no Dask cluster answers at {address}; check the address') from error
    with client:
        yield client.get_executor()
