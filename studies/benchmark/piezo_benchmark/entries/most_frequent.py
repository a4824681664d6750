"""Lazy: the published frequencies of the outcomes, without a look at the records."""

from __future__ import annotations

from itertools import combinations

from piezo_benchmark.draw import COUNTS
from piezo_benchmark.effects import EFFECTS
from piezo_benchmark.measured import NAMES
from piezo_benchmark.tasks import NONE, UNKNOWN, Answer, Task


def answer(task: Task) -> Answer:
    """Return how often each outcome is drawn at this level."""
    counts = {kind: n for (level, kind), n in COUNTS.items() if level == task.level}
    total = sum(counts.values())
    names = NAMES if task.level == 'measured' else tuple(EFFECTS)
    found = {name: counts['single'] / total / len(names) for name in names}
    found[NONE] = counts['nothing'] / total
    found[UNKNOWN] = counts.get('outside', 0) / total
    pairs = ['+'.join(sorted(pair)) for pair in combinations(EFFECTS, 2)]
    found |= {pair: counts.get('pair', 0) / total / len(pairs) for pair in pairs}
    return Answer(found)
