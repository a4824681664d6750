"""Scores and tables of the discovery test on simulated actuators."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

from piezo_hysteresis.discovery import Verdict
from studies.exams import Exam, hits

Row = Mapping[str, Any]
KINDS = ('single', 'pair', 'null', 'unknown')


def in_a_cell(verdict: Verdict) -> str:
    """Return a verdict for a cell of a table: the others of its class in brackets."""
    cells = []
    for effect in verdict.effects:
        others = effect.effect_class[1:]
        more = f' (or {", ".join(others)})' if others else ''
        cells.append(f'{effect.name} {effect.probability:.2f}{more}')
    return '; '.join(cells) or verdict.verdict


def named(row: Row) -> list[str]:
    """Return the words of the verdict: its effects, or none, or unknown."""
    if row['verdict'] != 'named':
        return [row['verdict']]
    return [effect['name'] for effect in row['effects']]


def first_right(row: Row) -> bool:
    """Return whether the effect that is ranked first is hidden in the set."""
    every = {name for names in row['names'] for name in names}
    return row['verdict'] == 'named' and row['effects'][0]['name'] in every


def all_right(row: Row) -> bool:
    """Return whether all hidden effects are named."""
    words = set(named(row))
    return all(words & set(names) for names in row['names'])


def among(row: Row) -> bool:
    """Return whether all hidden effects are named or alternatives."""
    words = set(named(row))
    for effect in row.get('effects', []):
        words |= {other['name'] for other in effect['alternatives']}
    return all(words & set(names) for names in row['names'])


def extra(row: Row) -> list[str]:
    """Return what is named but not hidden."""
    every = {name for names in row['names'] for name in names}
    return [name for name in named(row) if name not in every and name not in ('none', 'unknown')]


def interval(hits: int, count: int) -> str:
    """Return a share with its 95 % interval (Wilson), in per cent."""
    if count == 0:
        return '-'
    z, p = 1.96, hits / count
    middle = (p + z * z / (2 * count)) / (1 + z * z / count)
    half = z * math.sqrt(p * (1 - p) / count + z * z / (4 * count**2)) / (1 + z * z / count)
    low, high = 100 * (middle - half), 100 * (middle + half)
    return f'{100 * p:.0f} % ({hits}/{count}; {low:.0f}..{high:.0f})'


def _spread(values: Sequence[float]) -> list[float]:
    ordered = sorted(value for value in values if not math.isnan(value))
    at = [ordered[min(int(q * len(ordered)), len(ordered) - 1)] for q in (0.5, 0.9, 1.0)]
    return [float(f'{value:.3g}') for value in at]


def hidden_words(row: Row) -> str:
    """Return the hidden effects of a set; a rate law without a block is stated separately."""
    words = [
        'rate_dependence (power law)'
        if name == 'rate_dependence' and row['overrides'].get('rate_dependence.exponent', 0.0) > 0
        else name
        for name in row['hidden']
    ]
    return ' + '.join(words) or 'nothing'


def exam(rows: Sequence[Row], seed: int) -> Exam:
    """Return the exam: what was named, gaps, times, and right names by their probability."""
    group = {kind: [row for row in rows if row['kind'] == kind] for kind in KINDS}
    hidden = [*group['single'], *group['pair']]
    counts = {
        'first': hits([first_right(row) for row in group['single']]),
        'class': hits([among(row) for row in group['single']]),
        'pairs': hits([all_right(row) for row in group['pair']]),
        'wrong': hits([bool(extra(row)) for row in hidden]),
        'none': hits([row['verdict'] == 'none' for row in group['null']]),
        'outside': hits([row['verdict'] == 'unknown' for row in group['unknown']]),
    }
    figures: dict[str, Sequence[float]] = {}
    for kind, own in group.items():
        after = [row['held_out']['after_in_floors'] for row in own]
        if kind in ('single', 'pair') and own:
            figures[f'{kind}, held out [floors]: median, 90 %, largest'] = _spread(after)
            figures[f'{kind}, within 1.2 floors'] = hits([gap <= 1.2 for gap in after])
        if own:
            seconds = [row['seconds'] for row in own]
            figures[f'{kind} [s]: median, 90 %, largest'] = _spread(seconds)
    names = [
        (effect['probability'], effect['name'] in set().union(*row['names']))
        for row in rows
        for effect in (row['effects'] if row['verdict'] == 'named' else ())
    ]
    for low, high in pairwise((0.0, 0.5, 0.8, 0.95, 0.999, 1.01)):
        if inside := [right for chance, right in names if low <= chance < high]:
            title = f'right names of probability {low:g} to {min(high, 1):g}'
            figures[title] = hits(inside)
    kinds = Counter((hidden_words(row), ' + '.join(named(row))) for row in rows)
    cells = [{'hidden': a, 'reported': b, 'sets': n} for (a, b), n in sorted(kinds.items())]
    counts = {key: count for key, count in counts.items() if count[1]}
    commits = ', '.join(sorted({row.get('commit', '') for row in rows} - {''}))
    longest = round(max(row['seconds'] for row in rows))
    return Exam('simulated', seed, counts, cells, '', longest, figures, commits)
