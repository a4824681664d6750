"""Write the figures that the README cites, and its picture, from what the programs measured.

    python tools/write_figures.py [--demo out/demo] [--own out/own] [--check]

``docs/figures.json`` keeps the figures of the last run: ``make demo``, and with ``--own`` of
``make demo DATA=`` for the measured 150 V actuator. The README shows each between two comments:
``<!--NAME-->43.2<!---->``. With --check nothing is written: the exit code is 1 where the README
shows other figures than the file, or a run that is named has others than the file.
"""

from __future__ import annotations

import argparse
import json
import math
import re
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

if not __package__:
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

ROOT = Path(__file__).resolve().parents[1]
README = ROOT / 'README.md'
FIGURES = ROOT / 'docs' / 'figures.json'
PLACE = re.compile(r'(<!--([a-z0-9_.]+)-->)([^<]*)(<!---->)')

# Digits that the README shows. A run on another machine may differ by so much, relatively.
DIGITS = {
    'no_compensation_um': 3,
    'feedforward_um': 2,
    'feedforward_attenuation_um': 2,
    'own_error_percent': 2,
    'own_held_out_percent': 2,
}
TOLERANCE = 0.05


def of_demo(summary: Mapping[str, Any]) -> dict[str, float]:
    """Return the figures of a demo: rms tracking errors [µm]."""
    runs = {run['name']: 1e6 * run['rmse_m'] for run in summary['tracking']['runs']}
    return {f'{name.replace(" + ", "_").replace(" ", "_")}_um': rms for name, rms in runs.items()}


def of_own(summary: Mapping[str, Any]) -> dict[str, float]:
    """Return the figures of the measured actuator: error of the free run [% of the deviation]."""
    return {
        'own_error_percent': max(each['nrmse_percent'] for each in summary['records']),
        'own_held_out_percent': max(each['nrmse_percent'] for each in summary['held_out']),
    }


def shown(name: str, value: float) -> str:
    """Return a figure as the README shows it."""
    digits = DIGITS[name] - 1 - math.floor(math.log10(abs(value)))
    return f'{value:.{max(0, digits)}f}'


def with_figures(text: str, figures: Mapping[str, float]) -> str:
    """Return a page with its places filled in."""
    return PLACE.sub(lambda m: f'{m[1]}{shown(m[2], figures[m[2]])}{m[4]}', text)


def differences(known: Mapping[str, float], run: Mapping[str, float]) -> list[str]:
    """Return what a run has otherwise than what is known, in words."""
    return [
        f'{name} is {value:.4g}, docs/figures.json says {known.get(name, math.nan):.4g}'
        for name, value in run.items()
        if not abs(value - known.get(name, math.nan)) <= TOLERANCE * abs(value)
    ]


def measured(demo: Path | None, own: Path | None) -> dict[str, float]:
    """Return the figures of the runs in these folders."""
    found: dict[str, float] = {}
    for folder, figures_of in ((demo, of_demo), (own, of_own)):
        if folder is not None:
            summary = json.loads((folder / 'summary.json').read_text(encoding='utf-8'))
            found |= figures_of(summary)
    return found


def main() -> int:
    """Write the figures, or say what is otherwise."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--demo', type=Path, help='folder that make demo left')
    parser.add_argument('--own', type=Path, help='the same of the measured actuator')
    parser.add_argument('--check', action='store_true')
    words = parser.parse_args()
    known = json.loads(FIGURES.read_text(encoding='utf-8')) if FIGURES.exists() else {}
    run = measured(words.demo, words.own)
    readme = README.read_text(encoding='utf-8')
    if words.check:
        wrong = differences(known, run)
        if with_figures(readme, known) != readme:
            wrong.append('README.md shows other figures than docs/figures.json')
        for each in wrong:
            print(f'{each}: run python tools/write_figures.py --demo out/demo', file=sys.stderr)
        return int(bool(wrong))
    figures = {name: float(f'{value:.6g}') for name, value in {**known, **run}.items()}
    FIGURES.write_text(json.dumps(figures, indent=2, sort_keys=True) + '\n', encoding='utf-8')
    README.write_text(with_figures(readme, figures), encoding='utf-8')
    if words.demo is not None:
        from tools.draw_picture import draw

        draw(words.demo)
    return 0


if __name__ == '__main__':
    sys.exit(main())
