"""Probabilities of methods that state none, or whose probabilities are too high.

The answer of an entry is a mixture of what it states with simple alternatives: the published
frequencies, `none`, `unknown`, one half of a stated pair, a pair that contains a stated name, a
stated outcome with one name replaced by a similar one, and other names that the entry holds
possible. The weights are those with the largest likelihood on
tasks of other seeds (`calibration.json`, written by `python -m piezo_benchmark calibrate`), one
set for each kind of answer. The rule is the same for every entry, so that a log score compares
what entries know about a task and not how they round their confidence.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from piezo_benchmark.effects import EFFECTS
from piezo_benchmark.entries import most_frequent
from piezo_benchmark.tasks import NONE, UNKNOWN, Answer, Task
from piezo_benchmark.worlds import Array

FILE = Path(__file__).with_name('calibration.json')
COMPONENTS = (
    'stated', 'frequencies', 'none', 'unknown', 'half', 'partner', 'relative', 'others',
)  # fmt: skip
#: Names with similar signatures: late, curved, slow.
RELATIVES = (
    ('transport_delay', 'amplifier_lag', 'mode'),
    ('square_law', 'saturation', 'sensor_curve'),
    ('creep', 'drift', 'falling_gain'),
)
#: Tasks that the weights of the wider kind count for, when those of a narrower one are fitted.
PRIOR_TASKS = 8.0
Distribution = Mapping[str, float]


@dataclass(frozen=True)
class Statement:
    """What a method states about a task.

    Attributes
    ----------
    kind : tuple of str
        Kind of the statement, from wide to narrow; each kind has its weights.
    stated : dict of str to float
        Probabilities of outcomes, or 1 for the only one. What is missing to 1 is distributed by
        the published frequencies, more than 1 is scaled down.
    others : dict of str to float
        Further outcomes that the method holds possible, in any scale.
    prediction : (samples, held-out records) [m], optional
    parameters : dict of effect to dict of parameter to (value, deviation)
    """

    kind: tuple[str, ...]
    stated: Distribution
    others: Distribution = field(default_factory=dict)
    prediction: Array | None = None
    parameters: Mapping[str, Mapping[str, tuple[float, float]]] = field(default_factory=dict)


def kind_of(outcome: str, left: bool, task: Task) -> tuple[str, ...]:
    """Return the kind of a statement: its first outcome, whether a residual is left, the level."""
    word = outcome if outcome in (NONE, UNKNOWN) else ('pair' if '+' in outcome else 'single')
    exact = 'exact' if task.reference is None else task.level
    return word, 'residual' if left else 'noise', exact


def components(task: Task, statement: Statement) -> dict[str, dict[str, float]]:
    """Return the distributions that are mixed, by the names in `COMPONENTS`."""
    usual = _unit(most_frequent.answer(task).probabilities)
    half: dict[str, float] = {}
    partner: dict[str, float] = {}
    relative: dict[str, float] = {}
    for outcome, p in statement.stated.items():
        parts = [name for name in outcome.split('+') if name in EFFECTS]
        for name in parts:
            half[name] = half.get(name, 0.0) + p / len(parts)
            for other in EFFECTS:
                if other not in parts:
                    pair = '+'.join(sorted((name, other)))
                    partner[pair] = partner.get(pair, 0.0) + p / len(parts)
            for other in _relatives(name):
                changed = '+'.join(sorted({*parts, other} - {name}))
                relative[changed] = relative.get(changed, 0.0) + p
    total = sum(statement.stated.values())
    stated = {name: p / max(total, 1.0) for name, p in statement.stated.items()}
    for name, p in usual.items():
        stated[name] = stated.get(name, 0.0) + max(1.0 - total, 0.0) * p
    found = {
        'stated': stated, 'frequencies': usual, 'none': {NONE: 1.0},
        'unknown': {UNKNOWN: 1.0}, 'half': half, 'partner': partner,
        'relative': relative, 'others': statement.others,
    }  # fmt: skip
    return {name: _unit(part) or usual for name, part in found.items()}


def _relatives(name: str) -> list[str]:
    return [other for group in RELATIVES if name in group for other in group if other != name]


def _unit(part: Distribution) -> dict[str, float]:
    total = sum(part.values())
    return {name: p / total for name, p in part.items()} if total > 0.0 else {}


def answered(entry: str, task: Task, statement: Statement) -> Answer:
    """Return the answer of an entry: the mixture, with its prediction and parameters."""
    mixed: dict[str, float] = {}
    weights = weights_of(entry, statement.kind)
    for weight, part in zip(weights, components(task, statement).values(), strict=True):
        for name, p in part.items():
            mixed[name] = mixed.get(name, 0.0) + float(weight) * p
    return Answer(mixed, prediction=statement.prediction, parameters=statement.parameters)


def chances_row(task: Task, statement: Statement, truth: str) -> dict[str, Any]:
    """Return what a task adds to the calibration: the truth's probability in each component."""
    parts = components(task, statement)
    chances = [round(parts[name].get(truth, 0.0), 6) for name in COMPONENTS]
    return {'identifier': task.identifier, 'kind': list(statement.kind), 'chances': chances}


def likeliest(chances: Array, prior: Array) -> Array:
    """Return the weights of a mixture with the largest likelihood.

    Parameters
    ----------
    chances : (tasks, components)
        Probability of the truth in each component.
    prior : (components,)
        In tasks: what is assumed to have been seen before (Dempster, Laird, Rubin 1977).
    """
    weights = prior / prior.sum()
    for _ in range(300):
        joint = weights * chances + 1e-9 * weights
        weights = prior + np.sum(joint / joint.sum(1, keepdims=True), 0)
        weights = weights / weights.sum()
    return np.asarray(weights)


def read() -> dict[str, Any]:
    """Return the rows of calibration: seed and rows of each entry."""
    if not FILE.exists():
        return {}
    found: dict[str, Any] = json.loads(FILE.read_text(encoding='utf-8'))
    return found


def write(entry: str, seeds: Sequence[int], rows: Sequence[Mapping[str, Any]]) -> None:
    """Replace the rows of an entry."""
    found = {**read(), entry: {'seeds': list(seeds), 'rows': list(rows)}}
    lines = [
        f'{json.dumps(name)}: {{"seeds": {json.dumps(part["seeds"])}, "rows": [\n'
        + ',\n'.join(json.dumps(each) for each in part['rows'])
        + '\n]}'
        for name, part in sorted(found.items())
    ]
    FILE.write_text('{' + ',\n'.join(lines) + '}\n', encoding='utf-8')
    weights_of.cache_clear()


@cache
def weights_of(entry: str, kind: tuple[str, ...]) -> Array:
    """Return the weights of a kind; those of the wider kind are its prior."""
    wider = weights_of(entry, kind[:-1]) if kind else np.full(len(COMPONENTS), 1 / len(COMPONENTS))
    rows = [r for r in read().get(entry, {}).get('rows', []) if r['kind'][: len(kind)] == [*kind]]
    if not rows:
        return wider
    return likeliest(np.array([r['chances'] for r in rows]), PRIOR_TASKS * wider)
