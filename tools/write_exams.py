"""Write the tables of docs/exams.md from docs/exams.json.

Called by ``python tools/write_docs.py``. A table stands between ``<!-- exams: NAME -->`` and
``<!-- end -->``; the rest of the page is written by hand.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from studies.exams import FILE, read

PAGE = FILE.with_suffix('.md')
#: World and variant: the test in a table, and whether the baseline is a name or a model.yaml.
TESTS = {
    ('simulated', ''): ('[simulated actuators](#simulated-actuators)', 'name'),
    ('lottery', ''): ('[random recording conditions](#random-recording-conditions)', 'name'),
    ('foreign', ''): ('[actuators from the literature](#actuators-from-the-literature)', 'file'),
    ('hidden', ''): ('[effects in measured records](#effects-in-measured-records)', 'file'),
    ('hidden', 'repeated'): ('the same, reference repeated', 'name'),
    ('hidden', 'parts'): ('the same, reference in parts', 'name'),
    ('foreign', 'bends'): (
        'literature, [curves and gains](detection_limits.md#curves-and-gains)',
        'file',
    ),
    ('hidden', 'bends'): ('measured, [odd curves](detection_limits.md#curves-and-gains)', 'file'),
    ('hidden', 'second'): ('the same, [second channel](#second-channel), curves', 'file'),
    ('hidden', 'second repeated'): ('the same, second channel in the reference, too', 'name'),
}
AGAIN = '[again](#the-same-experiment-again), {}'
SUMS = ('first', 'class', 'pairs', 'wrong', 'class_without', 'none')
HEADS = ('first', 'class', 'pair', 'wrong', 'lacking', 'none')
Entry = Mapping[str, Any]


def exam_pages() -> dict[Path, str]:
    """Return the text of the page by path."""
    return {PAGE: filled(PAGE.read_text('utf-8'), read())}


def filled(page: str, exams: Sequence[Entry]) -> str:
    """Return a page with its tables."""
    present = [
        each
        for each in exams
        if each['search'] == 'present' and not {*SUMS}.isdisjoint(each.get('counts', ()))
    ]
    tables = {
        'results': results(present),
        'draws': draws(present),
        'effects': by_effect([each for each in present if each.get('rows')]),
        'earlier': earlier([each for each in exams if each['search'] == 'earlier']),
        'blocks': blocks([each for each in exams if each['world'] == 'false_alarms']),
    }

    def table(place: re.Match[str]) -> str:
        lines = '\n'.join(tables[place[1]])
        return f'<!-- exams: {place[1]} -->\n\n{lines}\n\n<!-- end -->'

    return re.sub(r'<!-- exams: (\w+) -->\n.*?<!-- end -->', table, page, flags=re.DOTALL)


def results(exams: Iterable[Entry]) -> list[str]:
    """Return a row per test, with the sums over its seeds."""
    tests: dict[tuple[str, str], list[Entry]] = {}
    for each in exams:
        tests.setdefault((each['world'], each['variant']), []).append(each)
    lines = [*head('test', 'seeds', 'baseline', *HEADS)]
    for test, draws_of in tests.items():
        title, baseline = TESTS.get(test, (AGAIN.format(test[1]), 'file'))
        seeds = spans([each['seed'] for each in draws_of if each['seed'] is not None])
        sums = [added([each['counts'].get(key) for each in draws_of]) for key in SUMS]
        lines.append(row(title, seeds, baseline, *sums))
    return lines


def draws(exams: Iterable[Entry]) -> list[str]:
    """Return a row per seed of the tests that were drawn."""
    lines = [*head('test', 'seed', 'commit', *HEADS, 'held out', 'longest')]
    for each in exams:
        if each['seed'] is not None:
            counts = [added([each['counts'].get(key)]) for key in (*SUMS, 'held_out')]
            seconds = f'{each["seconds"]:g} s' if 'seconds' in each else ''
            lines.append(row(named(each), each['seed'], each.get('commit', ''), *counts, seconds))
    return lines


def by_effect(exams: Sequence[Entry]) -> list[str]:
    """Return how often each hidden effect was ranked first, in each exam that lists its sets."""
    listed = [
        each
        for each in exams
        if 'right' in each['rows'][0]
        and each['world'] != 'lottery'  # one or two sets of each
        and not each['variant'].startswith(('second', 'bends'))
    ]
    cells: dict[str, list[list[bool]]] = {}
    for k, each in enumerate(listed):
        for one in each['rows']:
            if ' and ' not in one['hidden']:
                cells.setdefault(one['hidden'], [[] for _ in listed])[k].append(one['right'])
    lines = head('hidden', *(f'{named(each)} {each["seed"]}' for each in listed))
    for hidden, found in cells.items():
        lines.append(row(hidden, *(added([(sum(r), len(r))] if r else []) for r in found)))
    return lines


def earlier(exams: Iterable[Entry]) -> list[str]:
    """Return the draws of each test by searches before the present one, each in few words."""
    tests: dict[str, list[str]] = {}
    for each in exams:
        counts = dict(each['counts']) if 'counts' in each else {}
        commit = f' ({each["commit"]})' if 'commit' in each else ''
        words = [f'{key.replace("_", " ")} {a}/{b}' for key, (a, b) in counts.items()]
        words += [each['note']] if 'note' in each else []
        tests.setdefault(named(each), []).append(f'{each["seed"]}{commit}: {", ".join(words)}')
    return [*head('test', 'draws'), *(row(test, '; '.join(told)) for test, told in tests.items())]


def blocks(exams: Sequence[Entry]) -> list[str]:
    """Return the false alarms on unchanged blocks by their length."""
    lines = head('actuator', 'baseline', 'record', *(each['variant'] for each in exams))
    for each in zip(*(exam['rows'] for exam in exams), strict=True):
        first, alarms = each[0], [added([(one['alarms'], one['blocks'])]) for one in each]
        lines.append(row(first['actuator'], f'`{first["baseline"]}`', first['record'], *alarms))
    return lines


def named(exam: Entry) -> str:
    """Return the test of an entry in a word or two."""
    return f'{exam["world"]} {exam["variant"]}'.strip()


def added(counts: Iterable[Sequence[int] | None]) -> str:
    """Return the sum of counts, nothing where there are none."""
    there = [each for each in counts if each is not None]
    return f'{sum(a for a, _ in there)}/{sum(b for _, b in there)}' if there else ''


def spans(seeds: Sequence[int]) -> str:
    """Return seeds in order, runs of three and more by their ends."""
    ends = [0, *(k + 1 for k, (a, b) in enumerate(pairwise(seeds)) if b != a + 1), len(seeds)]
    runs = [seeds[a:b] for a, b in pairwise(ends)]
    return ', '.join(
        f'{run[0]} to {run[-1]}' if len(run) > 2 else ', '.join(map(str, run)) for run in runs
    )


def head(*titles: str) -> list[str]:
    """Return the head of a table."""
    return [row(*titles), '|' + '---|' * len(titles)]


def row(*cells: object) -> str:
    """Return a row of a table."""
    return '| ' + ' | '.join(map(str, cells)) + ' |'
