"""Draw docs/pictures/investigation.png from the folder of an investigation.

python tools/draw_investigation.py FOLDER
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from piezo_hysteresis.reporting.plots import GREY, PALETTE

PICTURE = Path(__file__).resolve().parents[1] / 'docs' / 'pictures' / 'investigation.png'
SHOWN = 4


def main() -> int:
    """Draw the picture."""
    draw(Path(sys.argv[1]), PICTURE)
    return 0


def draw(folder: Path, out: Path) -> None:
    """Draw the probabilities over time, and the gap before and after."""
    text = (folder / 'journal.jsonl').read_text(encoding='utf-8')
    lines = [json.loads(line) for line in text.splitlines()[1:]]
    summary = json.loads((folder / 'investigation.json').read_text(encoding='utf-8'))
    figure = Figure(figsize=(9.6, 3.6), layout='constrained')
    beliefs, gap = figure.subplots(1, 2, width_ratios=(3, 1))
    _beliefs(beliefs, lines)
    _gap(gap, summary)
    figure.savefig(out, metadata={'Software': None})


def _beliefs(axes: Axes, lines: list[dict[str, Any]]) -> None:
    seconds = [0.0, *(line['spent'] for line in lines)]
    every = [lines[0]['before']['chances'], *(line['after']['chances'] for line in lines)]
    best = {name: max(each.get(name, 0.0) for each in every) for each in every for name in each}
    names = sorted(best, key=lambda name: -best[name])[:SHOWN]
    for colour, name in zip(PALETTE, names, strict=False):
        values = [each.get(name, 0.0) for each in every]
        axes.plot(seconds, values, 'o-', color=colour, label=name)
    for line in lines:
        middle = line['spent'] - 0.5 * line['seconds']
        words = line['experiment'].replace(' at ', '\nat ').replace(' held ', '\nheld ')
        axes.axvline(line['spent'], color=GREY, linewidth=0.7)
        axes.text(middle, 1.04, words, fontsize=7, ha='center', va='bottom')
    axes.set(xlabel='time for which the actuator was driven [s]', ylabel='probability')
    axes.set_ylim(-0.03, 1.22)
    axes.legend(frameon=False, loc='center right', fontsize=8)


def _gap(axes: Axes, summary: dict[str, Any]) -> None:
    sizes = [summary['before_in_floors'], summary['after_in_floors']]
    axes.bar(['before', 'after'], sizes, color=[PALETTE[1], PALETTE[0]])
    axes.axhline(1.0, color='black', linestyle=':', linewidth=1.0)
    axes.set(ylabel='noise floors', ylim=(0.0, None))
    axes.set_title('gap on a record taken afterwards', fontsize=9)


if __name__ == '__main__':
    sys.exit(main())
