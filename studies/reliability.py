"""Measured reliability of the probabilities that discovery reports.

    python studies/reliability.py [--picture docs/pictures/reliability.png]

It is read from docs/exams.json, of the tests on data that were not simulated with the suite and
that set no threshold. A name in addition to a hidden effect counts as wrong.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from scipy.stats import binomtest

if not __package__:
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from bench.quick import parsed
from studies.exams import read
from studies.worlds.hidden import HIDDEN
from studies.worlds.lottery_world import EFFECTS

WORLDS = ('hidden', 'foreign', 'lottery')
TRUTHS = {**{name: truth for name, (_, truth) in HIDDEN.items()}, **EFFECTS}
EDGES = (0.0, 0.5, 0.7, 0.8, 1.0001)
_NAME = re.compile(r'([a-z_]+) ([01]\.\d+)')


@dataclass(frozen=True)
class Class:
    """Reported names with similar probability."""

    low: float  # [1]
    high: float  # [1]
    named: int  # number of reported names
    right: int  # of right ones
    mean: float  # mean reported probability [1]

    @property
    def share(self) -> float:
        """Share of correct names [1]."""
        return self.right / self.named

    @property
    def interval(self) -> tuple[float, float]:
        """95 % of Clopper and Pearson 1934."""
        found = binomtest(self.right, self.named).proportion_ci(method='exact')
        return float(found.low), float(found.high)


def said_in(rows: Sequence[Mapping[str, Any]]) -> list[tuple[float, bool]]:
    """Return probability and truth of every name in the rows of an exam."""
    found: list[tuple[float, bool]] = []
    for row in rows:
        truths = {TRUTHS.get(part, '') for part in row['hidden'].split(' and ')}
        told = re.sub(r'\([^)]*\)', '', row['reported'])
        found += [(float(p), name in truths) for name, p in _NAME.findall(told)]
    return found


def classes(named: Sequence[tuple[float, bool]]) -> list[Class]:
    """Return names by probability, and how many of each class were right."""
    found = []
    for low, high in pairwise(EDGES):
        inside = [pair for pair in named if low <= pair[0] < high]
        if inside:
            given, hits = zip(*inside, strict=True)
            mean = sum(given) / len(given)
            found.append(Class(low, min(high, 1.0), len(hits), sum(hits), mean))
    return found


def drawn(found: Sequence[Class]) -> Figure:
    """Return the reliability diagram."""
    figure = Figure(figsize=(5.0, 4.2), layout='constrained')
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    axes.plot([0, 1], [0, 1], color='0.6', lw=1.0, label='perfectly calibrated')
    for each in found:
        low, high = each.interval
        axes.errorbar(
            each.mean,
            each.share,
            yerr=[[each.share - low], [high - each.share]],
            xerr=[[each.mean - each.low], [each.high - each.mean]],
            fmt='o',
            color='tab:blue',
            capsize=3,
        )
        axes.annotate(
            f'{each.right}/{each.named}',
            (each.mean, each.share),
            textcoords='offset points',
            xytext=(-6, 6),
            ha='right',
        )
    axes.set(
        xlabel='reported probability',
        ylabel='share that was right, 95 %',
        xlim=(0, 1.03),
        ylim=(0, 1.05),
    )
    figure.legend(loc='outside upper center', frameon=False)
    return figure


def main() -> None:
    """Print the classes, and draw them."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--picture', type=Path)
    arguments = parsed(parser)
    exams = [each for each in read() if each['world'] in WORLDS]
    named = [pair for each in exams for pair in said_in(each.get('rows', ()))]
    found = classes(named)
    print('| named with | mean | names | right | 95 % |\n|---|---:|---:|---:|---|')
    for each in found:
        low, high = each.interval
        print(
            f'| {each.low:g} to {each.high:g} | {each.mean:.2f} | {each.named} | {each.right} | '
            f'{100 * low:.0f} to {100 * high:.0f} % |'
        )
    if arguments.picture:
        drawn(found).savefig(arguments.picture, dpi=100, metadata={'Software': None})


if __name__ == '__main__':
    main()
