"""Draw docs/pictures/tracking.png from what ``make demo`` left in out/demo."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.records import Record, read_bag
from piezo_hysteresis.reporting.plots import GREY, PALETTE
from piezo_hysteresis.reporting.signals import amplitude_spectrum

ROOT = Path(__file__).resolve().parents[1]
PICTURE = ROOT / 'docs' / 'pictures' / 'tracking.png'
MICRO = 1e6
COLOURS = {
    'no compensation': PALETTE[1],
    'feedforward': PALETTE[0],
    'feedforward + attenuation': PALETTE[2],
}


def main() -> int:
    """Draw the picture."""
    draw(Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / 'out' / 'demo')
    return 0


def draw(folder: Path) -> None:
    """Draw the picture of the demo in `folder`."""
    tracking = json.loads((folder / 'summary.json').read_text())['tracking']
    runs = {run['name']: _record(folder, run['name']) for run in tracking['runs']}
    figure = Figure(figsize=(9.6, 3.5), layout='constrained')
    axes = figure.subplots(1, 3)
    _traces(axes[0], runs, tracking['frequency_hz'])
    _loops(axes[1], runs, tracking['frequency_hz'])
    _spectra(axes[2], runs, tracking['judged_seconds'])
    figure.legend(
        *axes[0].get_legend_handles_labels(), loc='outside upper center', ncols=4, frameon=False
    )
    PICTURE.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(PICTURE, metadata={'Software': None})


def _record(folder: Path, name: str) -> Record:
    bag = name.replace(' + ', '_and_').replace(' ', '_')
    return read_bag(folder / 'bags' / bag)[0]


def _reference(record: Record) -> FloatArray:
    assert record.reference is not None
    return record.reference


def _tail(record: Record, frequency: float) -> slice:
    return slice(-round(2 / (frequency * record.dt)) - 1, None)


def _traces(axis: Any, runs: dict[str, Record], frequency: float) -> None:
    for name, record in runs.items():
        tail = _tail(record, frequency)
        time = 1e3 * (record.time[tail] - record.time[tail][0])
        if name == 'no compensation':
            axis.plot(time, MICRO * _reference(record)[tail], color=GREY, lw=4, label='reference')
        axis.plot(time, MICRO * record.displacement[tail], color=COLOURS[name], lw=1.4, label=name)
    axis.set(xlabel='time [ms]', ylabel='displacement [µm]', title=f'tracking {frequency:g} Hz')


def _loops(axis: Any, runs: dict[str, Record], frequency: float) -> None:
    for name, record in runs.items():
        tail = _tail(record, frequency)
        x, y = MICRO * _reference(record)[tail], MICRO * record.displacement[tail]
        axis.plot(x, y, color=COLOURS[name], lw=1.4)
    axis.set(xlabel='reference [µm]', ylabel='displacement [µm]', title='loop')


def _spectra(axis: Any, runs: dict[str, Record], seconds: float) -> None:
    for name, record in runs.items():
        error = (record.displacement - _reference(record))[-round(seconds / record.dt) :]
        frequency, amplitude = amplitude_spectrum(error, record.dt)
        shown = frequency < 180
        rms = MICRO * np.sqrt(np.mean(error**2))
        axis.semilogy(frequency[shown], MICRO * amplitude[shown], color=COLOURS[name], lw=1.1)
        axis.annotate(
            f'{rms:.3g} µm rms', (0.98, 0.92 - 0.08 * list(runs).index(name)),
            xycoords='axes fraction', ha='right', color=COLOURS[name], fontsize='small',
        )  # fmt: skip
    axis.set(xlabel='frequency [Hz]', ylabel='amplitude [µm]', title='tracking error')
    axis.set_ylim(1e-4, 1e4)


if __name__ == '__main__':
    sys.exit(main())
