"""A model chosen to predict, against what the search of discovery ends with on the same records.

Of each record the first 70 % is fitted and the rest judges; further files judge the model that was
fitted to all of it. Discovery begins with the fine bank of plays, the better of the two chains.

    python studies/choice.py TRAIN.csv [--judge TEST.csv]
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

if not __package__:
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np

from bench.quick import parsed
from piezo_hysteresis.discovery import discover
from piezo_hysteresis.discovery.choice.choice_policy import CHOICE
from piezo_hysteresis.discovery.choice.choose import choose_model
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


def by_choice(records: Sequence[Record], judges: Sequence[Record]) -> None:
    """Print what the choice of a model that predicts comes to."""
    started = time.process_time()
    choice = choose_model(records)
    took = time.process_time() - started
    print(f'choice: {choice.model.name}, {took:.0f} s of processor time')
    for each in choice.held_out:
        print(f'  rest of {each.record}: {1e6 * each.free_run_rms:.3g} µm, '
              f'{each.nrmse_percent:.3g} % of its standard deviation')  # fmt: skip
    found = identify(records, choice.model, start=choice.start, count=1)
    for record in judges:
        print(f'  {record.name}: '
              f'{left(found.chain, found.values, found.sampling_offset, record)}')  # fmt: skip


def by_discovery(
    records: Sequence[Record], judges: Sequence[Record], name: str, limit: float
) -> None:
    """Print what discovery from a named chain comes to."""
    cuts = [max(round(CHOICE.trained * len(record)), 2) for record in records]
    parts = [record.section(0, cut) for record, cut in zip(records, cuts, strict=True)]
    started = time.process_time()
    try:
        found = discover(parts, named(name), time_limit=limit)
    except PiezoError as error:
        print(f'discovery from {name}: {error}')
        return
    took = time.process_time() - started
    effects = ', '.join(step.fit.effect for step in found.steps) or 'nothing named'
    print(f'discovery from {name}: {effects}, {took:.0f} s of processor time')
    final = found.final
    for record, cut in zip(records, cuts, strict=True):
        words = left(final.model, final.values, final.sampling_offset, record, cut)
        print(f'  rest of {record.name}: {words}')
    if judges:
        final = discover(records, named(name), time_limit=limit).final
        for record in judges:
            words = left(final.model, final.values, final.sampling_offset, record)
            print(f'  {record.name}: {words}')


def main() -> None:
    """Compare both on the files that were named."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('data', nargs='*', type=Path, help='records to fit to')
    parser.add_argument('--judge', nargs='*', type=Path, default=[], help='records not fitted to')
    parser.add_argument('--time-limit', type=float, default=math.inf, help='of each search [s]')
    options = parsed(parser, time_limit=3.0)
    if options.data or not options.quick:
        compare(options.data, options.judge, options.time_limit)
        return
    with records_in(None, ('train.csv',)) as folder:
        compare([folder / 'train.csv'], options.judge, options.time_limit)


def compare(data: Sequence[Path], judge: Sequence[Path], limit: float) -> None:
    """Print what both come to."""
    records = load(data)
    judges = load(judge) if judge else []
    by_choice(records, judges)
    by_discovery(records, judges, MEMORIES[-1], limit)


if __name__ == '__main__':
    main()
