"""Scores and tables of the discovery test on simulated actuators."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

from piezo_hysteresis.discovery import Verdict

Row = Mapping[str, Any]


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


def _share(rows: Sequence[Row], test: Any) -> str:
    return interval(sum(bool(test(row)) for row in rows), len(rows))


def _spread(values: Sequence[float]) -> str:
    ordered = sorted(value for value in values if not math.isnan(value))
    if not ordered:
        return '-'
    at = [ordered[min(int(q * len(ordered)), len(ordered) - 1)] for q in (0.5, 0.9)]
    return f'median {at[0]:.3g}, 90 % {at[1]:.3g}, largest {ordered[-1]:.3g}'


def summary(rows: Sequence[Row]) -> list[str]:
    """Return the measured figures, line by line."""
    lines = []
    for design in ('careful', 'poor'):
        these = [row for row in rows if row['design'] == design]
        for kind in ('single', 'pair', 'null', 'unknown'):
            group = [row for row in these if row['kind'] == kind]
            if group:
                lines += [f'{kind} ({design} records, {len(group)} sets)', *_lines(kind, group)]
    return lines


def _lines(kind: str, rows: Sequence[Row]) -> list[str]:
    rules = {'unknown': lambda row: row['verdict'] == 'unknown',
            'null': lambda row: row['verdict'] == 'none'}  # fmt: skip
    lines = []
    if kind in rules:
        lines.append(f'  verdict right             {_share(rows, rules[kind])}')
    else:
        lines.append(f'  named first               {_share(rows, first_right)}')
        lines.append(f'  all of them named         {_share(rows, all_right)}')
        lines.append(f'  named or an alternative   {_share(rows, among)}')
        lines.append(f'  nothing else named        {_share(rows, lambda row: not extra(row))}')
        after = [row['held_out']['after_in_floors'] for row in rows]
        near = sum(gap <= 1.2 for gap in after)
        lines.append(f'  held-out gap <= 1.2 floors {interval(near, len(after))}')
        lines.append(f'  held-out gap after [floors] {_spread(after)}')
    seconds = [row['seconds'] for row in rows]
    samples = sorted(row['samples'] for row in rows)[len(rows) // 2]
    lines.append(f'  seconds per set            {_spread(seconds)} ({samples} samples)')
    return lines


def calibration(rows: Sequence[Row]) -> list[str]:
    """Return how often a name of a given probability was right."""
    told = []
    for row in rows:
        every = {name for names in row['names'] for name in names}
        if row['verdict'] == 'named':
            told += [(e['probability'], e['name'] in every) for e in row['effects']]
    lines = ['calibration: stated probability, and fraction of right names']
    edges = (0.0, 0.5, 0.8, 0.95, 0.999, 1.01)
    for low, high in pairwise(edges):
        inside = [right for chance, right in told if low <= chance < high]
        if inside:
            lines.append(f'  {low:g} to {min(high, 1):g}: {interval(sum(inside), len(inside))}')
    return lines


def hidden_words(row: Row) -> str:
    """Return the hidden effects of a set; a rate law without a block is stated separately."""
    words = [
        'rate_dependence (power law)'
        if name == 'rate_dependence' and row['overrides'].get('rate_dependence.exponent', 0.0) > 0
        else name
        for name in row['hidden']
    ]
    return ' + '.join(words) or '(nothing)'


def confusion(rows: Sequence[Row]) -> list[str]:
    """Return the reported names for every hidden effect; pairs are listed separately."""
    lines = []
    for kinds, title in (
        (('single', 'null', 'unknown'), 'confusion: hidden -> reported (sets)'),
        (('pair',), 'pairs: hidden -> reported (sets)'),
    ):
        table: dict[str, Counter[str]] = {}
        for row in rows:
            if row['kind'] in kinds:
                table.setdefault(hidden_words(row), Counter())[' + '.join(named(row))] += 1
        width = max((len(hidden) for hidden in table), default=0)
        lines += [title] if table else []
        for hidden in sorted(table):
            text = ', '.join(f'{word} {count}' for word, count in table[hidden].most_common())
            lines.append(f'  {hidden:{width}} {text}')
    return lines


def page(rows: Sequence[Row], table: str) -> str:
    """Return the table as a page, with what it was made from."""
    seeds = sorted({row['key'].split('-')[2] for row in rows})
    commits = sorted({row.get('commit', '') for row in rows} - {''})
    return (
        '# Discovery test: simulated actuators\n\n'
        f'{len(rows)} sets, seed {", ".join(seeds)}, commit {", ".join(commits) or "unknown"}; '
        'written by `studies/study.py simulated --page`. [validation.md](validation.md) describes '
        'the protocol and summarises the results.\n\n'
        f'```text\n{table}\n```\n'
    )
