"""A model chosen to predict, against what the search of discovery ends with on the same records.

Of each record the first 70 % is fitted and the rest judges; further files judge the model that was
fitted to all of it. Discovery begins with the fine bank of plays, the better of the two chains.

    python studies/study.py choice TRAIN.csv [--judge TEST.csv]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from pathlib import Path

import numpy as np

from piezo_hysteresis.discovery import discover
from piezo_hysteresis.discovery.choose import CHOICE, choose_model
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.identification import identify
from piezo_hysteresis.identification.error_measures import views_of
from piezo_hysteresis.identification.prediction import Prediction
from piezo_hysteresis.models import Model, named
from piezo_hysteresis.models.named import MEMORIES
from piezo_hysteresis.records import Record, load
from studies.worlds.stand_ins import records_in


def left(
    model: Model, values: Mapping[str, float], late: float, record: Record, first: int = 0
) -> str:
    """Return what a model misses of a record from a sample on, in words."""
    (view,) = views_of(model, values, [record], late)
    error = Prediction(model, model.pack(values), view, late).residual
    skipped = max(first - record.warm_up_samples, 0)
    rms = float(np.sqrt(np.mean(error[skipped:] ** 2)))
    spread = float(np.std(view.measured[skipped:]))
    return f'{1e6 * rms:.3g} µm, {100 * rms / spread:.3g} % of its standard deviation'


def by_choice(records: Sequence[Record], judges: Sequence[Record]) -> list[str]:
    """Return what the choice of a model that predicts comes to."""
    started = time.process_time()
    choice = choose_model(records)
    took = time.process_time() - started
    lines = [f'choice: {choice.model.name}, {took:.0f} s of processor time']
    lines += [
        f'  rest of {each.record}: {1e6 * each.free_run_rms:.3g} µm, '
        f'{each.nrmse_percent:.3g} % of its standard deviation'
        for each in choice.held_out
    ]
    found = identify(records, choice.model, start=choice.start, count=1)
    own = (found.chain, found.values, found.sampling_offset)
    return lines + [f'  {record.name}: {left(*own, record)}' for record in judges]


def by_discovery(
    records: Sequence[Record], judges: Sequence[Record], name: str, limit: float
) -> list[str]:
    """Return what discovery from a named chain comes to."""
    cuts = [max(round(CHOICE.trained * len(record)), 2) for record in records]
    parts = [record.section(0, cut) for record, cut in zip(records, cuts, strict=True)]
    started = time.process_time()
    try:
        found = discover(parts, named(name), time_limit=limit)
    except PiezoError as error:
        return [f'discovery from {name}: {error}']
    took = time.process_time() - started
    effects = ', '.join(step.fit.effect for step in found.steps) or 'nothing named'
    lines = [f'discovery from {name}: {effects}, {took:.0f} s of processor time']
    final = found.final
    for record, cut in zip(records, cuts, strict=True):
        words = left(final.model, final.values, final.sampling_offset, record, cut)
        lines.append(f'  rest of {record.name}: {words}')
    if judges:
        final = discover(records, named(name), time_limit=limit).final
        for record in judges:
            words = left(final.model, final.values, final.sampling_offset, record)
            lines.append(f'  {record.name}: {words}')
    return lines


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options of this world."""
    parser.add_argument('data', nargs='*', type=Path, help='records to fit to')
    parser.add_argument('--judge', nargs='*', type=Path, default=[], help='records not fitted to')


QUICK = {'time_limit': 3.0}


def run(asked: argparse.Namespace) -> str:
    """Compare both on the files that were named."""
    stand_in = asked.quick and not asked.data
    with records_in(None, ('train.csv',)) if stand_in else nullcontext(Path()) as folder:
        records = load([folder / 'train.csv'] if stand_in else asked.data)
    judges = load(asked.judge) if asked.judge else []
    lines = by_choice(records, judges)
    return '\n'.join(lines + by_discovery(records, judges, MEMORIES[-1], asked.time_limit))
