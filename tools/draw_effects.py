"""Draw docs/pictures/effects/NAME.png: what each effect does to a model, before and after.

    python tools/draw_effects.py [NAME ...]

The effect is added to the first named model that takes it, at that start of its fit that changes
most; the model and its other values stay. The loop is drawn at the drive at which it changes most.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from piezo_hysteresis import models
from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.models import Candidate, Model
from piezo_hysteresis.reporting.plots import GREY, PALETTE

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / 'docs' / 'pictures' / 'effects'
MICRO = 1e6
DT = 1e-3
SECONDS = 6.0
DRIVES = (2.0, 7.0, 20.0)  # [Hz]
SEEN = 0.05  # a change at the slowest drive, in parts of the largest, that is worth drawing
ORDERS = (0, 1, 2, 3, 5)
BASELINES = ('classical', 'bouc_wen_mode', 'linear_mode', 'enhanced3', 'extended')


def main() -> int:
    """Draw the pictures that are named, or all."""
    for name in sys.argv[1:] or models.EFFECT_NAMES:
        figure, _ = draw(name)
        FOLDER.mkdir(parents=True, exist_ok=True)
        figure.savefig(FOLDER / f'{name}.png', dpi=80, metadata={'Software': None})
    return 0


def draw(name: str) -> tuple[Figure, dict[float, FloatArray]]:
    """Return the picture of an effect, and what it changes at each drive [Hz] [m]."""
    candidate, baseline = suited(name)
    before = baseline.defaults()
    values = max(
        (candidate.values(before, start) for start in _starts(candidate)),
        key=lambda each: _size(_change(baseline, before, candidate.model, each, DRIVES[0])),
    )
    changes = {
        frequency: _change(baseline, before, candidate.model, values, frequency)
        for frequency in DRIVES
    }
    most = max(DRIVES, key=lambda frequency: _size(changes[frequency]))
    plain = _answer(baseline, before, _voltage(most), most)
    figure = Figure(figsize=(11.0, 3.1), layout='constrained')
    FigureCanvasAgg(figure)
    axes = figure.subplots(1, 3)
    _loops(axes[0], most, (plain, plain + changes[most]), baseline.name)
    shown = most if _size(changes[DRIVES[0]]) < SEEN * _size(changes[most]) else DRIVES[0]
    _course(axes[1], shown, changes[shown])
    _harmonics(axes[2], changes)
    figure.suptitle(f'{name}, variant {candidate.effect.variant}', fontsize='medium')
    return figure, changes


def suited(name: str) -> tuple[Candidate, Model]:
    """Return an effect as a candidate of the first named model that takes it, and that model."""
    for baseline in BASELINES:
        model = models.named(baseline)
        for known in (model, _without_offset(model)):
            for effect in models.described(name) if known is not None else ():
                assert known is not None
                if models.applicable(known, effect):
                    return models.add_effect(known, effect), known
    raise ValueError(f'no model of {", ".join(BASELINES)} takes {name}')


def _without_offset(model: Model) -> Model | None:
    return model.without_block('offset') if 'offset' in model.block_names else None


def _starts(candidate: Candidate) -> list[dict[str, float]]:
    """Return the starts of a fit, and one off zero where all of them are zero."""
    starts = [dict(start) for start in candidate.starts]
    if any(value for start in starts for value in start.values()):
        return starts
    scales = {each.name: each.scale for each in candidate.model.parameters}
    return [{name: SEEN * scales[name] for name in candidate.added}]


def _voltage(frequency: float) -> FloatArray:
    time = np.arange(round(SECONDS / DT)) * DT
    return np.asarray(np.sin(2 * np.pi * frequency * time), np.float64)


def _answer(
    model: Model, values: Mapping[str, float], voltage: FloatArray, frequency: float
) -> FloatArray:
    return model.respond(voltage, model.pack(values), DT, frequency=frequency)


def _change(
    one: Model, before: Mapping[str, float], other: Model, after: Mapping[str, float], f: float
) -> FloatArray:
    voltage = _voltage(f)
    return _answer(other, after, voltage, f) - _answer(one, before, voltage, f)


def _size(signal: FloatArray) -> float:
    return float(np.abs(signal).max())


def _loops(axis: Any, frequency: float, pair: tuple[FloatArray, FloatArray], model: str) -> None:
    tail = slice(-round(1.0 / frequency / DT) - 1, None)
    voltage, before, after = (x[tail] for x in (_voltage(frequency), *pair))
    axis.plot(voltage, MICRO * before, color=GREY, lw=4, label=f'{model} without it')
    axis.plot(voltage, MICRO * after, color=PALETTE[0], lw=1.5, label='with it')
    axis.set(
        xlabel='voltage [V]', ylabel='displacement [µm]', title=f'Last loop at {frequency:g} Hz'
    )
    axis.legend(frameon=False, fontsize='small')


def _course(axis: Any, frequency: float, change: FloatArray) -> None:
    time = np.arange(change.size) * DT
    cut = slice(0, None) if frequency == DRIVES[0] else slice(-round(4.0 / frequency / DT), None)
    axis.plot(time[cut], MICRO * change[cut], color=PALETTE[DRIVES.index(frequency)], lw=1.2)
    axis.ticklabel_format(axis='y', useOffset=False)
    low, high = axis.get_ylim()
    if MICRO * float(np.ptp(change)) < 1e-6:  # a constant
        axis.set_ylim(min(low, 0.0) - 0.1, max(high, 0.0) + 0.1)
    where = 'from rest' if frequency == DRIVES[0] else 'last periods'
    axis.set(xlabel='time [s]', ylabel='with minus without [µm]',
             title=f'What it changes at {frequency:g} Hz, {where}')  # fmt: skip


def _harmonics(axis: Any, changes: dict[float, FloatArray]) -> None:
    width = 0.8 / len(changes)
    for k, (frequency, change) in enumerate(changes.items()):
        sizes = [MICRO * amplitude(change, order * frequency) for order in ORDERS]
        sizes.append(MICRO * rest(change, frequency))
        places = np.arange(len(sizes)) + (k - 1) * width
        axis.bar(places, sizes, width, color=PALETTE[k], label=f'{frequency:g} Hz')
    names = ['mean', *(f'{order}×' for order in ORDERS[1:]), 'rest']
    axis.set_xticks(range(len(names)), names)
    axis.set(ylabel='amplitude [µm]', title='By harmonic of the drive, last 2 s')
    axis.legend(frameon=False, fontsize='small')


def amplitude(signal: FloatArray, frequency: float) -> float:
    """Return the amplitude of a signal at a frequency [Hz] over its last two seconds."""
    tail = signal[-round(2.0 / DT) :]
    if frequency == 0.0:
        return abs(float(np.mean(tail)))
    turn = np.exp(-2j * np.pi * frequency * DT * np.arange(tail.size))
    return 2.0 * abs(complex(np.mean(tail * turn)))


def rest(signal: FloatArray, frequency: float) -> float:
    """Return the amplitude of a sine as strong as what is on none of the harmonics drawn."""
    tail = signal[-round(2.0 / DT) :]
    known = sum(0.5 * amplitude(signal, n * frequency) ** 2 for n in ORDERS[1:])
    return float(np.sqrt(max(2.0 * (float(np.var(tail)) - known), 0.0)))


if __name__ == '__main__':
    sys.exit(main())
