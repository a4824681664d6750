"""One model for all drives or one per frequency, on the bimorph of Fujii 2018 in open loop.

Ten frequencies from 1 to 50 Hz are recorded and identified by both methods of the chain: the RLS
of Fujii 2018 and `rls_ud` with the mode of an output-error fit. Then sines of the recorded
frequencies, of frequencies between them, and two sums of three tones are tracked, with the
feedforward of one estimate for all, of the nearest estimate, and of that with attenuation.

    python studies/per_frequency.py [--picture docs/pictures/per_frequency.png]
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass, replace
from pathlib import Path

if not __package__:
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
from matplotlib.figure import Figure

import piezo_hysteresis as ph
from bench.quick import parsed
from piezo_hysteresis.compensation.controllers import Controllers
from piezo_hysteresis.compensation.harmonics.lines import AttenuationSettings
from piezo_hysteresis.compensation.offline_loop import closed_loop, tracking_metrics
from piezo_hysteresis.models import ModelFile
from piezo_hysteresis.records import Record
from piezo_hysteresis.waveforms import Sine, Waveform, from_spec
from studies.papers import bimorph, runs

DT, LIMITS = bimorph.DT, bimorph.LIMITS
RECORDED = (1.0, 5.0, 10.0, 14.0, 18.0, 22.0, 23.0, 24.0, 35.0, 50.0)
BETWEEN = (3.0, 7.0, 12.0, 16.0, 20.0, 30.0, 43.0)
#: Sums of three tones: 7, 19 and 43 Hz, and 20, 30 and 40 Hz.
SUMS = ('composite_xiao2014', 'composite_zhou2021_low')
KINDS = ('no compensation', 'one for all', 'per frequency', 'with attenuation')
METHODS = {'Fujii 2018': ('fujii2018', 'extended'), 'rls_ud': ('rls_ud', 'bouc_wen_mode')}


@dataclass(frozen=True)
class Row:
    """Rms tracking errors of one reference with their mean [m], by `KINDS`."""

    name: str
    recorded: bool
    errors: tuple[float, ...]


def references(seconds: float, records: list[Record]) -> list[tuple[str, bool, Waveform]]:
    """Return name, whether its frequency was recorded, and waveform of each reference."""
    middle = float(np.mean([_middle(each) for each in records]))
    rows: list[tuple[str, bool, Waveform]] = [
        (
            f'{f:g} Hz', f in RECORDED,
            Sine(bimorph.amplitude(f), f, seconds, offset=middle, ramp=1.0),
        )
        for f in sorted((*RECORDED, *BETWEEN))
    ]  # fmt: skip
    for kind in SUMS:
        spec = {'kind': kind, 'amplitude': 1.2e-4, 'duration': seconds, 'offset': middle}
        wave = from_spec({**spec, 'ramp': 1.0})
        tones = ' + '.join(f'{f:g}' for f in wave.frequencies)  # type: ignore[attr-defined]
        rows.append((f'{tones} Hz', False, wave))
    return rows


def _middle(record: Record) -> float:
    moved = record.displacement[record.warm_up_samples :]
    return 0.5 * float(moved.max() + moved.min())


def tracked(model: ModelFile, wave: Waveform) -> tuple[float, ...]:
    """Return the rms errors of a reference over its second half [m], by `KINDS`."""
    whole = Controllers(DT, LIMITS, model, attenuation=AttenuationSettings())
    joint = replace(whole, model=replace(model, schedule=None), attenuation=None)
    alone = replace(whole, attenuation=None)
    samples = wave.sample(np.asarray(DT * np.arange(round(wave.duration / DT)), np.float64))
    errors = []
    for links in ([whole.straight()], joint.links(), alone.links(), whole.links()):
        run = closed_loop(samples, links, runs.plant(bimorph.NAME, 3), LIMITS, DT)
        errors.append(tracking_metrics(run, 0.5 * wave.duration).rms)
    return tuple(errors)


def measured(method: str, seconds: float, recorded: float) -> list[Row]:
    """Identify by a method, and track every reference."""
    records = [bimorph.record(f, recorded) for f in RECORDED]
    how, chain = METHODS[method]
    found = ph.identify(records, model=chain, method=how, per_frequency=True)
    return [
        Row(name, seen, tracked(found.model, wave))
        for name, seen, wave in references(seconds, records)
    ]


def table(found: dict[str, list[Row]]) -> list[str]:
    """Return the rms errors as a table in Markdown [µm]."""
    lines = ['| reference | method | ' + ' | '.join(KINDS) + ' |', '|---|' + '---|' * 5]
    for method, rows in found.items():
        groups = {
            'recorded, median (worst)': [r for r in rows if r.recorded],
            'between, median (worst)': [r for r in rows if not r.recorded and '+' not in r.name],
        }
        for name, group in groups.items():
            errors = np.array([row.errors for row in group]) * 1e6
            cells = [f'{np.median(e):.3g} ({e.max():.3g})' for e in errors.T]
            lines.append(f'| {name} | {method} | ' + ' | '.join(cells) + ' |')
        for row in rows:
            if row.name == '23 Hz' or '+' in row.name:
                cells = [f'{1e6 * e:.3g}' for e in row.errors]
                lines.append(f'| {row.name} | {method} | ' + ' | '.join(cells) + ' |')
    return lines


def drawn(found: dict[str, list[Row]]) -> Figure:
    """Return the errors over the references, by method."""
    figure = Figure(figsize=(9, 3.6), layout='constrained')
    for axis, (method, rows) in zip(
        figure.subplots(1, len(found), sharey=True, squeeze=False)[0], found.items(), strict=True
    ):
        for k, kind in enumerate(KINDS):
            axis.semilogy([1e6 * row.errors[k] for row in rows], '.-', label=kind)
        names = [row.name.replace(' Hz', '') for row in rows]
        axis.set_xticks(range(len(rows)), names, rotation=90)
        axis.set_title(method)
        axis.set_xlabel('frequency of the reference [Hz]')
        axis.grid(alpha=0.3)
    figure.axes[0].set_ylabel('rms tracking error [µm]')
    figure.axes[0].legend(fontsize=8)
    return figure


def main() -> int:
    """Print the table, and draw the figure where a file for it is given."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--seconds', type=float, default=20.0, help='length of a reference [s]')
    parser.add_argument('--recorded', type=float, default=6.0, help='length of a record [s]')
    parser.add_argument('--picture', type=Path)
    asked = parsed(parser, seconds=1.0, recorded=1.0)
    found = {method: measured(method, asked.seconds, asked.recorded) for method in METHODS}
    for method, rows in found.items():
        for row in rows:
            cells = '  '.join(f'{1e6 * error:9.3f}' for error in row.errors)
            print(f'{method:<12}{row.name:<18}{cells}')
    print('\n'.join(table(found)))
    if asked.picture:
        drawn(found).savefig(asked.picture, dpi=100, metadata={'Software': None})
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
