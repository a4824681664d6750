"""The study of `investigate` as a table and a page."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import median
from typing import Any

Rows = Sequence[dict[str, Any]]
HEAD = (
    '| way | actuators | right | wrong besides or instead | median time at the end | median time '
    'to the right name |\n|---|---:|---:|---:|---:|---:|'
)


def table(rows: Rows) -> str:
    """Return what came out, a line per kind and way."""
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
    name = f'{way}, nothing hidden' if kind == 'null' else way
    spent = median(row['seconds'] for row in rows)
    return f'| {name} | {len(rows)} | {right} | {wrong} | {spent:.1f} s | {first} |'


def page(rows: Rows, seed: int) -> str:
    """Return the page of documentation."""
    each = [
        '| hidden | way | named | time | end |\n|---|---|---|---:|---|',
        *(
            f'| {" + ".join(row["hidden"]) or "nothing"} | {row["way"]} | '
            f'{" + ".join(row["found"]) or "nothing"} | {row["seconds"]:.1f} s | {row["stop"]} |'
            for row in rows
        ),
    ]
    return (
        '# How long it takes an actuator to tell what changed\n\n'
        f'Written by `python bench/investigate.py --table --seed {seed} --page '
        'docs/investigate_study.md`, which says what was done. Simulated actuators of random '
        'numbers; times are seconds for which it is driven, conditioning included.\n\n'
        f'{table(rows)}\n\n'
        'Right: what changed is named, and nothing else. Every actuator, misses included:\n\n'
        + '\n'.join(each)
        + '\n'
    )
