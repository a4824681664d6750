"""The page and the pictures of results."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from string import Template
from typing import Any

import numpy as np

from piezo_benchmark.draw import COUNTS
from piezo_benchmark.effects import EFFECTS, OUTSIDE
from piezo_benchmark.entries import CALIBRATED, NAMES
from piezo_benchmark.entries.calibrated import read as read_calibration
from piezo_benchmark.run import entry_named
from piezo_benchmark.scores import FLOOR, GROUPS, Row, calibration, summary
from piezo_benchmark.tasks import CONVENTIONS, EQUATIONS, outcomes

Summary = dict[str, dict[str, Any]]
TEMPLATE = Path(__file__).with_name('page.md')
LEAST = 5  # tasks of a point in the picture of the calibration
LAZY = ('coin', 'most_frequent', 'always_none')
DETAIL = Path(__file__).with_name('detail.md')
RIVALS = tuple(name for name in CALIBRATED if name != 'suite')


def rows_of(results: dict[str, Any]) -> dict[str, list[Row]]:
    """Return the rows of each entry on the tasks that all entries answered."""
    entries = {
        name: [Row(**row) for row in results['entries'][name]]
        for name in (*NAMES, *sorted(set(results['entries']) - set(NAMES)))
        if name in results['entries']
    }
    if not entries:
        return {}
    common = set.intersection(*({row.identifier for row in rows} for rows in entries.values()))
    return {n: [row for row in rows if row.identifier in common] for n, rows in entries.items()}


def table(
    entries: dict[str, Summary], key: str, form: str, percent: bool = False, short: bool = False
) -> Iterator[str]:
    """Yield a table of one number per entry and group, with its interval unless `short`."""
    groups = [g for g in GROUPS if any(g in s for s in entries.values())]
    tasks = {g: next(s[g]['tasks'] for s in entries.values() if g in s) for g in groups}
    yield '| entry | ' + ' | '.join(f'{g} ({tasks[g]})' for g in groups) + ' |'
    yield '|---|' + '---:|' * len(groups)
    factor = 100.0 if percent else 1.0
    for name, found in entries.items():
        cells = []
        for group in groups:
            value, low, high = (factor * x for x in found[group][key])
            spread = '' if short else f' ({low:{form}} to {high:{form}})'
            cells.append(f'{value:{form}}{spread}')
        yield f'| `{name}` | ' + ' | '.join(cells) + ' |'


def _second_table(entries: dict[str, list[Row]]) -> Iterator[str]:
    yield _cells(
        'entry', 'truth within the 90 % class', 'outcomes in that class',
        'parameters: median error', 'within two deviations', 'median s per task', 'longest s',
        'failed',
    )  # fmt: skip
    yield '|---|---:|---:|---:|---:|---:|---:|---:|'
    for name, rows in entries.items():
        errors = [r.parameter_error for r in rows if r.parameter_error is not None]
        covered = [r.covered for r in rows if r.covered is not None]
        seconds = [r.seconds for r in rows]
        yield (
            f'| `{name}` | {np.mean([r.in_class for r in rows]):.0%} '
            f'| {np.mean([r.class_size for r in rows]):.1f} '
            f'| {f"{np.median(errors):.1%} ({len(errors)})" if errors else ""} '
            f'| {f"{np.mean(covered):.0%}" if covered else ""} '
            f'| {np.median(seconds):.1f} | {max(seconds):.0f} '
            f'| {sum(bool(r.failed) for r in rows)} |'
        )


def _calibration_table(entries: dict[str, list[Row]]) -> Iterator[str]:
    yield '| entry | stated probability of the first outcome | tasks | stated, mean | right |'
    yield '|---|---|---:|---:|---:|'
    for name, rows in entries.items():
        for part in calibration(rows):
            yield (
                f'| `{name}` | {part["low"]:g} to {part["high"]:g} | {part["tasks"]:.0f} '
                f'| {part["said"]:.0%} | {part["right"]:.0%} |'
            )


def losses(entries: dict[str, Summary]) -> list[str]:
    """Return a list of the scores in which another entry is better than the suite."""
    found: list[str] = []
    if 'suite' not in entries:
        return found
    for key, what, form in (
        ('bits', 'log score', '.2f'), ('false_alarms', 'false alarms', '.2f'),
        ('ratio', 'held-out error', '.2f'),
    ):  # fmt: skip
        lost = []
        for group in entries['suite']:
            own = entries['suite'][group][key][0]
            better = [
                f'`{name}` {s[group][key][0]:{form}}'
                for name, s in entries.items()
                if name in RIVALS and s[group][key][0] < own - 0.005
            ]
            if better:
                lost.append(f'{group} {own:{form}} ({", ".join(better)})')
        if lost:
            found.append(f'- {what}: {"; ".join(lost)}')
    return found


def _cells(*cells: str) -> str:
    return '| ' + ' | '.join(cell.replace('|', chr(92) + '|') for cell in cells) + ' |'


def _rest(count: int, total: int) -> str:
    if count == total:
        return 'That is all of them.'
    return 'The others were not run by every entry.'


def _cost_table(results: dict[str, Any]) -> Iterator[str]:
    yield '| entry | tasks | wall s | processor s |'
    yield '|---|---:|---:|---:|'
    for name, cost in results.get('cost', {}).items():
        yield (
            f'| `{name}` | {cost["tasks"]} | {cost["wall_s"]:.0f} | {cost["processor_s"]:.0f} |'
        )


def _wrong_table(rows: Sequence[Row]) -> Iterator[str]:
    yield '| task | group | truth | most probable | stated | bits | held-out over control |'
    yield '|---|---|---|---|---:|---:|---:|'
    for row in rows:
        if row.right < 1.0:
            top = row.failed or f'`{row.top}`'
            yield (
                f'| {row.identifier} | {row.group} | `{row.truth}` | {top} | {row.confidence:.0%} '
                f'| {row.bits:.1f} | {row.ratio:.2f} |'
            )


def _calibrated_on() -> str:
    """Return on which tasks entries are calibrated."""
    found = read_calibration()
    seeds = sorted({seed for part in found.values() for seed in part['seeds']})
    count = max((len(part['rows']) for part in found.values()), default=0)
    return f'up to {count} tasks of seed {", ".join(str(seed) for seed in seeds)}'


def _lines(lines: Iterable[str]) -> str:
    return chr(10).join(lines)


def detail(results: dict[str, Any], page_at: str) -> str:
    """Return the detail of the results in Markdown, with a link to the page."""
    entries = rows_of(results)
    found = {name: summary(rows) for name, rows in entries.items()}
    made = {
        'page': page_at,
        'version': str(results['version']),
        'seed': str(results.get('seed')),
        'date': str(results.get('date')),
        'right': _lines(table(found, 'right', '.0f', True)),
        'false_alarms': _lines(table(found, 'false_alarms', '.0f', True)),
        'ratio': _lines(table(found, 'ratio', '.2f')),
        'second': _lines(_second_table(entries)),
        'cost': _lines(_cost_table(results)),
        'calibration': _lines(_calibration_table(entries)),
        'effects': _lines(
            ['| effect | equation | units |', '|---|---|---|']
            + [
                _cells(f'`{n}`', e.equation, ', '.join(f'{k} {u}' for k, u in e.units.items()))
                for n, e in EFFECTS.items()
            ]
        ),
        'baselines': _lines(
            ['| baseline | equations |', '|---|---|']
            + [_cells(f'`{n}`', e) for n, e in EQUATIONS.items()]
        ),
        'wrong': _lines(_wrong_table(entries.get('suite', []))),
    }
    return Template(DETAIL.read_text(encoding='utf-8')).substitute(made)


def page(
    results: dict[str, Any],
    sealed: Sequence[dict[str, Any]] = (),
    at: str = '',
    detail_at: str = '',
) -> str:
    """Return the page in Markdown.

    Parameters
    ----------
    results : dict
        Of the practice tasks.
    sealed : sequence of dict
        Results of sealed sets.
    at : str
        Folder of the pictures as links name it; empty omits them.
    detail_at : str
        File of the detail as the link names it.
    """
    entries = rows_of(results)
    found = {name: summary(rows) for name, rows in entries.items()}
    methods = {name: numbers for name, numbers in found.items() if name not in LAZY}
    count, total = len(next(iter(entries.values()), [])), sum(COUNTS.values())

    def picture(title: str, name: str) -> str:
        return f'![{title}]({at}/{name}.svg)' if at else ''

    made = {
        'version': str(results['version']),
        'count': str(count),
        'total': str(total),
        'seed': str(results.get('seed')),
        'date': str(results.get('date')),
        'note': str(results.get('note', '')),
        'causes': _lines(results.get('causes', [])),
        'rest': _rest(count, total),
        'detail': detail_at,
        'conventions': CONVENTIONS,
        'uniform': f'{np.log2(len(outcomes())):.1f}',
        'bits': _lines(table(found, 'bits', '.1f')),
        'false_alarms': _lines(table(methods, 'false_alarms', '.0f', True, short=True)),
        'ratio': _lines(table(methods, 'ratio', '.2f', short=True)),
        'losses': _lines(losses(found) or ['- in no group']),
        'calibration': _calibrated_on(),
        'picture_bits': picture('Log score of each entry by level', 'benchmark_bits'),
        'picture_calibration': picture('Right over stated', 'benchmark_calibration'),
        'entries': _lines(
            ['| entry | method |', '|---|---|']
            + [_cells(f'`{name}`', entry_named(name)[2]) for name in entries]
        ),
        'effects': ', '.join(f'`{name}`' for name in EFFECTS),
        'baselines': ', '.join(f'`{name}`' for name in EQUATIONS),
        'outside': ', '.join(f'`{name}`' for name in OUTSIDE),
        'outcomes': str(len(outcomes())),
        'names': str(len(EFFECTS)),
        'floor': f'{FLOOR:.0%}',
        'worst': f'{-np.log2(FLOOR / len(outcomes())):.1f}',
        'sealed': _lines(_sealed(sealed) or ['| | | | | |']),
        'versions': ', '.join(
            f'{k} {v}'
            for part in ('versions', 'hardware')
            for k, v in results.get(part, {}).items()
        ),
    }
    text = Template(TEMPLATE.read_text(encoding='utf-8')).substitute(made)
    return re.sub(chr(10) + '{3,}', chr(10) * 2, text)


def _sealed(runs: Sequence[dict[str, Any]]) -> list[str]:
    """Return a line for each sealed run: log score in bits by group."""
    lines = []
    for run in runs:
        for name, rows in rows_of(run).items():
            bits = {g: s['bits'][0] for g, s in summary(rows).items()}  # type: ignore[index]
            said = ', '.join(f'{group} {value:.1f}' for group, value in bits.items())
            lines.append(
                _cells(str(run['seed']), run['date'], run.get('examiner', ''), f'`{name}`', said)
            )
    return lines


def pictures(results: dict[str, Any], folder: Path) -> bool:
    """Draw log scores and calibration; return whether matplotlib was there to do it."""
    try:
        import matplotlib as mpl

        mpl.use('svg')
        mpl.rcParams['svg.hashsalt'] = 'benchmark'
        import matplotlib.pyplot as plt
    except ImportError:
        return False
    folder.mkdir(parents=True, exist_ok=True)
    entries = rows_of(results)
    found = {n: summary(r) for n, r in entries.items() if n not in ('always_none', 'coin')}
    groups = [g for g in GROUPS if any(g in s for s in found.values())]
    figure, axes = plt.subplots(figsize=(8.5, 3.6), layout='constrained')
    width = 0.8 / max(len(found), 1)
    for k, (name, numbers) in enumerate(found.items()):
        values = np.array([numbers[g]['bits'] for g in groups])
        at = np.arange(len(groups)) + (k - len(found) / 2 + 0.5) * width
        spread = np.abs(values[:, 1:] - values[:, :1]).T
        axes.bar(at, values[:, 0], width, yerr=spread, label=name, error_kw={'lw': 0.7})
    axes.set_xticks(np.arange(len(groups)), groups)
    axes.set_ylabel('log score [bits], less is better')
    axes.legend(fontsize=7, ncols=4, loc='lower center', bbox_to_anchor=(0.5, 1.0))
    _save(figure, folder / 'benchmark_bits.svg')
    figure, axes = plt.subplots(figsize=(4.2, 3.8), layout='constrained')
    axes.plot([0, 1], [0, 1], color='0.7', lw=1)
    for name in ('ideal_observer', *CALIBRATED):
        if name in entries:
            parts = [part for part in calibration(entries[name]) if part['tasks'] >= LEAST]
            axes.plot(
                [p['said'] for p in parts], [p['right'] for p in parts], 'o-', label=name, ms=4
            )
    axes.set_xlabel('stated probability of the first outcome')
    axes.set_ylabel('share right')
    axes.legend(fontsize=7)
    _save(figure, folder / 'benchmark_calibration.svg')
    return True


def _save(figure: Any, file: Path) -> None:
    figure.savefig(file, metadata={'Date': None})
    figure.clear()
