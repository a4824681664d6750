"""The study of `investigate` as a table and a page."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import median
from typing import Any

Rows = Sequence[dict[str, Any]]
HEAD = (
    '| method | actuators | right | false names | median time at the end | median time to the '
    'right name |\n|---|---:|---:|---:|---:|---:|'
)


def table(rows: Rows) -> str:
    """Return the results, a line per kind and method."""
    lines = [HEAD]
    for kind in ('single', 'null'):
        for way in ('designed', 'random', 'battery'):
            some = [row for row in rows if row['kind'] == kind and row['way'] == way]
            if some:
                lines.append(_line(kind, way, some))
    return '\n'.join(lines)


def _line(kind: str, way: str, rows: Rows) -> str:
    right = sum(row['right'] for row in rows)
    wrong = sum(bool(row['found']) and not row['right'] for row in rows)
    to_right = [row['right_after'] for row in rows if row['right_after'] is not None]
    first = f'{median(to_right):.1f} s' if to_right and kind != 'null' else ''
    name = f'{way}, no effect' if kind == 'null' else way
    spent = median(row['seconds'] for row in rows)
    return f'| {name} | {len(rows)} | {right} | {wrong} | {spent:.1f} s | {first} |'


def goals(rows: Rows, budget: float, limits: tuple[float, float, float]) -> str:
    """Return the goals with the results.

    Parameters
    ----------
    rows : sequence of dict
        Results of the study.
    budget : float
        Actuator time that might be spent [s].
    limits : (float, float, float)
        Least and greatest voltage [V], and fastest change [V/s], that were allowed.
    """
    chosen, fixed = (
        {row['key']: row for row in rows if row['way'] == way and row['kind'] == 'single'}
        for way in ('designed', 'battery')
    )
    both = sorted(chosen.keys() & fixed.keys())
    nulls = [r['seconds'] for r in rows if r['kind'] == 'null' and r['way'] == 'designed']
    if not (both and nulls):
        return 'Rows of designed, battery and null actuators are needed to judge the goals.'
    right = [sum(way[key]['right'] for key in both) for way in (chosen, fixed)]
    spent = [median(way[key]['seconds'] for key in both) for way in (chosen, fixed)]
    early = sum(seconds <= 0.1 * budget for seconds in nulls)
    driven = [row['extremes'] for row in rows if 'extremes' in row]
    worst = min(e[0] for e in driven), max(e[1] for e in driven), max(e[2] for e in driven)
    return '\n'.join(
        (
            '| goal | result |',
            '|---|---|',
            (
                f'| at most a third of the time of the battery | {spent[0]:.1f} s of '
                f'{spent[1]:.1f} s: {spent[0] / spent[1]:.0%}, median over {len(both)} actuators |'
            ),
            (
                f'| right at least as often as the battery | {right[0]} of {len(both)}; the '
                f'battery {right[1]} |'
            ),
            (
                f'| no effect: ends within a tenth of {budget:g} s | {early} of '
                f'{len(nulls)}; longest {max(nulls):.1f} s |'
            ),
            (
                f'| commands within {limits[0]:g} .. {limits[1]:g} V and {limits[2]:g} V/s | '
                f'{worst[0]:.3g} .. {worst[1]:.3g} V, at most {worst[2]:.3g} V/s |'
            ),
        )
    )


def page(rows: Rows, seed: int, aims: str, remarks: str = '') -> str:
    """Return the page of documentation: what was aimed at, every row, and remarks."""
    each = [
        '| hidden | method | reported | time | end |\n|---|---|---|---:|---|',
        *(
            f'| {" + ".join(row["hidden"]) or "nothing"} | {row["way"]} | '
            f'{" + ".join(row["found"]) or "nothing"} | {row["seconds"]:.1f} s | {row["stop"]} |'
            for row in rows
        ),
    ]
    return (
        '# Investigation study: actuator time to the right effect\n\n'
        f'Written by `python studies/investigate.py --table --seed {seed} --page '
        'docs/investigate_study.md`; the script describes the protocol. The actuators are '
        'simulated with random parameters. Times are actuator time, conditioning '
        'included.\n\n'
        f'{aims}\n\n{table(rows)}\n\n'
        'A result is right if it names the change and nothing else. '
        f'{remarks}All actuators:\n\n' + '\n'.join(each) + '\n'
    )
