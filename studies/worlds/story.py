"""Discovery of the mode at 68 Hz that the models of Fujii 2018 lack.

    python studies/study.py story --baselines extended,classical,modified --workers 2

The simulated bimorph of Fujii 2018 is swept from 1 to 50 Hz and every baseline is given to the
discovery. It writes the result folder of each baseline, a table (story.md) and a picture over
frequency (story.png): Figure 10 of Fujii 2018 with the effects found. Fujii 2018 names 14 Hz and
23 Hz, whose fifth and third harmonics meet the mode.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure

from piezo_hysteresis.discovery import Discovery, Verdict, discover
from piezo_hysteresis.discovery.verdict.verdict import over_frequency
from piezo_hysteresis.identification.uncertainty import digits
from piezo_hysteresis.models import named
from piezo_hysteresis.records import Record, load, write_bag
from piezo_hysteresis.reporting.discovery_report import write_discovery
from piezo_sim.presets import load_preset
from piezo_sim.sweep import simulate

PRESET = 'fdk_pzba_00030'
MICRO = 1e6
ORDERS = (3, 5)


def sweep(frequencies: Sequence[float], seconds: float, seed: int) -> list[Record]:
    """Return one record of the simulated bimorph per frequency, at the papers' 1 V."""
    plan = [
        {'kind': 'sine', 'frequency': f, 'amplitude': 1.0, 'duration': seconds}
        for f in frequencies
    ]
    return simulate(PRESET, plan, seed=seed, actuator='bimorph')


def told(verdict: Verdict) -> list[str]:
    """Return the verdict as lines of a page: sentence, parameters of the modes, drives."""
    lines = [f'### {verdict.baseline}', '', verdict.summary, '']
    for effect in verdict.effects:
        shown = [
            f'{name} {digits(n.value, n.std) if n.std else f"{n.value:.4g}"}'
            + (f' {n.unit}' if n.unit != '1' else '')
            for name, n in effect.parameters.items()
        ]
        few = ', '.join(shown) if len(shown) < 6 else f'{len(shown)} weights'
        lines.append(f'- `{effect.name}` (probability {effect.probability:.3g}): {few}')
        lines += [f'  - {sentence}' for sentence in effect.evidence[-1:] if effect.drives]
    if verdict.unexplained.significant:
        lines.append(f'- left: {verdict.unexplained.description}')
    held, seconds = verdict.held_out, verdict.seconds
    lines += ['', f'Held out: {held.before_in_floors:.3g} floors before, ']
    lines[-1] += f'{held.after_in_floors:.3g} after; {seconds:.0f} s.'
    return [*lines, '', *_rows(verdict), '']


def _rows(verdict: Verdict) -> list[str]:
    floor = MICRO * verdict.noise_floor_rms_m
    lines = ['| drive [Hz] | before [um rms] | after [um rms] | |', '|---:|---:|---:|---|']
    for row in verdict.over_frequency:
        held = 'held out' if row['held_out'] else ''
        before, after = (floor * row[f'{when}_in_floors'] for when in ('before', 'after'))
        lines.append(f'| {row["frequency_hz"]:g} | {before:.3g} | {after:.3g} | {held} |')
    return lines


def draw(found: Sequence[Discovery], path: Path) -> None:
    """Draw the gap over frequency before and after, one panel per baseline."""
    mode = load_preset(PRESET).values()['structure.natural_frequency']
    with mpl.rc_context({'font.size': 9, 'axes.grid': True, 'grid.alpha': 0.3}):
        figure = Figure(figsize=(7.0, 2.6 * len(found)), layout='constrained', dpi=150)
        panels = figure.subplots(len(found), 1, sharex=True, squeeze=False)[:, 0]
        for panel, each in zip(panels, found, strict=True):
            rows = over_frequency(each.data, each.baselines.joint, each.final, each.proof)
            held = [row for row in rows if row.held_out]
            for label, colour, when in (
                (f'{each.verdict.baseline} alone', '#d55e00', 'before'),
                ('with what was found', '#0072b2', 'after'),
            ):
                x, y = [r.frequency for r in rows], [MICRO * getattr(r, when) for r in rows]
                panel.semilogy(x, y, '.-', color=colour, label=label, lw=1, ms=4)
                x, y = [r.frequency for r in held], [MICRO * getattr(r, when) for r in held]
                panel.semilogy(x, y, 'o', color=colour, mfc='none', ms=8)
            panel.axhline(MICRO * each.floor, color='0.4', ls=':', label='noise floor')
            for order in ORDERS:
                panel.axvline(mode / order, color='0.6', ls='--', lw=0.8)
                panel.text(
                    mode / order, 0.98, f' 1/{order} of the mode', va='top', fontsize=7,
                    transform=panel.get_xaxis_transform(),
                )  # fmt: skip
            panel.set_ylabel('rms gap [µm]')
            panel.legend(fontsize=7, loc='center right')
        panels[-1].set_xlabel('frequency of the drive [Hz]; circles are held out')
        figure.savefig(path)


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options of this world."""
    parser.set_defaults(seed=5, workers=2)
    add = parser.add_argument
    add('--baselines', default='extended,classical,modified')
    add('--frequencies', default=','.join(map(str, range(1, 51))))
    add('--seconds', type=float, default=4.0, help='of every record')
    add('--out', type=Path, default=Path('out/story'))


QUICK = {'baselines': 'classical', 'frequencies': '3,14,23,40', 'seconds': 1.0, 'time_limit': 2.0}


def run(asked: argparse.Namespace) -> str:
    """Return the page; end with an error if a baseline does not find the mode."""
    frequencies = [float(each) for each in asked.frequencies.split(',')]
    asked.out.mkdir(parents=True, exist_ok=True)
    bag = asked.out / f'sweep_{time.strftime("%Y%m%d_%H%M%S")}'
    write_bag(bag, sweep(frequencies, asked.seconds, asked.seed))
    mode = load_preset(PRESET).values()['structure.natural_frequency']
    found, missed, text = [], [], ''
    for baseline in asked.baselines.split(','):
        each = discover(
            load([bag]),
            named(baseline),
            name=baseline,
            workers=asked.workers,
            time_limit=asked.time_limit,
        )
        write_discovery(asked.out / baseline, each, [str(bag)])
        found.append(each)
        modes = [
            number.value
            for effect in each.verdict.effects
            for name, number in effect.parameters.items()
            if name.startswith('resonance_frequency')
        ]
        if not any(abs(value - mode) < 0.5 for value in modes):
            missed.append(baseline)
        text += '\n'.join(told(each.verdict)) + '\n'
        (asked.out / 'story.md').write_text(text, encoding='utf-8')
        draw(found, asked.out / 'story.png')
    if missed:
        text += f'no mode at {mode:g} Hz from {", ".join(missed)}\n'
    if missed and not asked.quick:
        sys.exit(text)
    return text
