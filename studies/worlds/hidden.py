"""Discovery test: effects added to measured records of an identified actuator.

    python studies/study.py hidden --data ../shared/data --exams docs/exams.json

A baseline is identified on untouched records of a measured actuator and saved. Then an effect of
random size is put into the measured displacement, by code that shares nothing with the suite, and
`discover` gets the changed records and the ``model.yaml``. An untouched control must be ``none``.
With ``--reference repeated`` the untouched records are the reference, and the effect hides in the
same records with noise of their own; with ``--reference parts`` the reference is the beginning of
a sine, and the effect hides in the rest of it. With ``--second`` a curve of the sensor or of the
actuator is hidden, and the records, and a repeated reference, have a second channel that the
sensor does not bend. With ``--bends`` odd and even curves of the sensor are hidden, and a gain as
large as that of the curve.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks import named_block
from piezo_hysteresis.discovery import Verdict, discover
from piezo_hysteresis.discovery.selection.start import as_on
from piezo_hysteresis.identification import identify
from piezo_hysteresis.models import Model, ModelFile, named
from piezo_hysteresis.records import Record, load
from studies.exams import Exam, counted, hits
from studies.worlds.scores import in_a_cell
from studies.worlds.stand_ins import records_in

#: Held-out error, relative to the unchanged actuator, up to which an effect counts as removed.
AS_CONTROL = 1.2


@dataclass(frozen=True)
class Case:
    """Records of one actuator: file to fit and up to which time [s], files to hide effects in."""

    name: str
    fitted: str
    until: float
    evaluated: tuple[str, ...]
    baselines: tuple[str, ...]
    slow: float  # time in which a drift or a loss reaches its size [s]
    delay: float  # largest delay or lag [s]
    noise: float = 0.0  # rms at rest [m]
    parted: float = np.inf  # where the sine is parted for a reference [s]


CASES = (
    Case(
        'P-885',
        'p885_stack/train_1Hz_sine.csv',
        np.inf,
        ('p885_stack/train_1Hz_sine.csv', 'p885_stack/test_growing_amplitude.csv'),
        ('prandtl_ishlinskii', 'classical'),
        70.0,
        0.04,
        6e-8,
        20.0,
    ),
    Case(
        '150 V',
        'piezo_150v_1hz/piezo_150V_1Hz.csv',
        7.0,
        ('piezo_150v_1hz/piezo_150V_1Hz.csv',),
        ('prandtl_ishlinskii+creep', 'classical'),
        10.0,
        0.008,
        4.5e-8,
        7.0,
    ),
)

Hide = Callable[[FloatArray, FloatArray, float, float, float, Case], FloatArray]
# Each takes displacement [m], time [s], middle and stroke [m], and a size from 0.25 to 1.


def delayed(
    y: FloatArray, t: FloatArray, middle: float, stroke: float, size: float, case: Case
) -> FloatArray:
    """Return the displacement a constant time later.

    Linear interpolation would be a low-pass, too: 7 % at 119 Hz in records of 1 kHz.
    """
    return np.asarray(CubicSpline(t, y)(np.maximum(t - size * case.delay, t[0])))


def lagging(
    y: FloatArray, t: FloatArray, middle: float, stroke: float, size: float, case: Case
) -> FloatArray:
    """Return the displacement behind a low-pass of first order.

    Exact for a displacement that is linear between samples. A recursion without the previous
    sample would be half a sample early.
    """
    share = size * case.delay / (t[1] - t[0])
    a = float(np.exp(-1.0 / share))
    new = 1.0 - share * (1.0 - a)
    return np.asarray(lfilter([new, 1.0 - a - new], [1.0, -a], y, zi=[(1.0 - new) * y[0]])[0])


def curved(
    y: FloatArray, t: FloatArray, middle: float, stroke: float, size: float, case: Case
) -> FloatArray:
    """Return what a sensor reads that is steeper at both ends."""
    z = y - middle
    return np.asarray(y + 0.1 * size * z * np.abs(z) / stroke)


def curved_evenly(
    y: FloatArray, t: FloatArray, middle: float, stroke: float, size: float, case: Case
) -> FloatArray:
    """Return what a sensor reads that is steeper at one end."""
    return np.asarray(y + 0.1 * size * (y - middle) ** 2 / stroke)


def stronger(
    y: FloatArray, t: FloatArray, middle: float, stroke: float, size: float, case: Case
) -> FloatArray:
    """Return the displacement of an actuator with more gain, as much as a curve has of it."""
    return np.asarray(y + 0.1 * size * 4.0 / (3.0 * np.pi) * (y - middle))


def humming(
    y: FloatArray, t: FloatArray, middle: float, stroke: float, size: float, case: Case
) -> FloatArray:
    """Return the displacement with a tone that is no multiple of the drive."""
    return np.asarray(y + 0.015 * size * stroke * np.sin(2 * np.pi * (13.3 + 37.0 * size) * t))


def drifting(
    y: FloatArray, t: FloatArray, middle: float, stroke: float, size: float, case: Case
) -> FloatArray:
    """Return the displacement with a steady drift."""
    return np.asarray(y + 0.15 * size * stroke * t / case.slow)


def fading(
    y: FloatArray, t: FloatArray, middle: float, stroke: float, size: float, case: Case
) -> FloatArray:
    """Return the displacement with a gain that falls steadily."""
    return np.asarray(y - 0.16 * size * (y - middle) * t / case.slow)


def untouched(
    y: FloatArray, t: FloatArray, middle: float, stroke: float, size: float, case: Case
) -> FloatArray:
    """Return the displacement as it was measured."""
    return y


HIDDEN: dict[str, tuple[Hide, str]] = {
    'nothing': (untouched, ''),
    'delay': (delayed, 'transport_delay'),
    'lag': (lagging, 'amplifier_lag'),
    'curved sensor': (curved, 'sensor_nonlinearity'),
    'tone': (humming, 'mains_hum'),
    'drift': (drifting, 'drift'),
    'falling gain': (fading, 'gain_decay'),
}
#: With a second channel: a curve of one sensor, or of the actuator and thus in both channels.
CURVED: dict[str, tuple[Hide, str]] = {
    'nothing': HIDDEN['nothing'],
    'curved sensor': HIDDEN['curved sensor'],
    'curved actuator': (curved, 'stiffness'),
}
#: Curves of the sensor, and the gain that is most of the odd one.
BENT: dict[str, tuple[Hide, str]] = {
    'nothing': HIDDEN['nothing'],
    'curved sensor': HIDDEN['curved sensor'],
    'even curve': (curved_evenly, 'sensor_nonlinearity'),
    'changed gain': (stronger, 'parameter_shift'),
}
EVERY = HIDDEN | CURVED | BENT


@dataclass(frozen=True)
class Search:
    """How `discover` is asked, and how many of `HIDDEN` are."""

    workers: int = 1
    limit: float = math.inf
    effects: int = len(HIDDEN)
    second: int = 0  # draws of each curve with a second channel
    bends: bool = False  # whether those of `BENT` are hidden instead

    def kinds(self) -> list[str]:
        """Return what is hidden, in this order."""
        if self.second:
            return [*CURVED, *self.second * list(CURVED)[1:]][: 1 + 2 * self.second]
        return list(BENT if self.bends else HIDDEN)[: self.effects]


@dataclass(frozen=True)
class Row:
    """One examination."""

    case: str
    baseline: str
    hidden: str
    size: float
    verdict: Verdict
    control: float
    seconds: float

    @property
    def names(self) -> list[str]:
        """What was named, in order."""
        return [effect.name for effect in self.verdict.effects]

    @property
    def classes(self) -> list[tuple[str, ...]]:
        """The class of each named effect, in order."""
        return [effect.effect_class for effect in self.verdict.effects]

    @property
    def kind(self) -> str:
        """Whether one effect is hidden or none."""
        return 'single' if self.truth else 'null'

    @property
    def truth(self) -> set[str]:
        """Name of what is hidden, none for nothing."""
        return {EVERY[self.hidden][1]} - {''}

    @property
    def right(self) -> bool:
        """Whether the right name is ranked first; for no hidden effect, verdict `none`."""
        if not self.truth:
            return self.verdict.verdict == 'none'
        if self.hidden == 'curved actuator':  # no sensor, whichever law of the actuator
            return bool(self.names) and HIDDEN['curved sensor'][1] not in self.names
        return set(self.names[:1]) == self.truth

    @property
    def told(self) -> str:
        """The verdict in a cell."""
        return in_a_cell(self.verdict)

    @property
    def ratio(self) -> float:
        """Held-out error after over that of the control."""
        return self.verdict.held_out.gap_after_rms_m / self.control

    @property
    def cells(self) -> dict[str, Any]:
        """The row of the exam."""
        gap = self.verdict.held_out
        return {
            'actuator': self.case, 'baseline': self.baseline, 'hidden': self.hidden,
            'size': round(self.size, 2), 'reported': self.told, 'right': self.right,
            'before_um': round(1e6 * gap.gap_before_rms_m, 3),
            'after_um': round(1e6 * gap.gap_after_rms_m, 3),
            'over_unchanged': round(self.ratio, 2),
        }  # fmt: skip


def cut(record: Record, until: float) -> Record:
    """Return the record up to a time [s]."""
    return record.section(0, min(len(record), int(until / record.dt))) if until < 1e9 else record


def chain(word: str) -> Model:
    """Return the model that ``NAME+BLOCK`` names."""
    name, *blocks = word.split('+')
    model = named(name)
    for block in blocks:
        model = model.with_block(named_block(block))
    return model


def hide(records: Sequence[Record], kind: str, size: float, case: Case) -> list[Record]:
    """Return the records with an effect in their displacement."""
    stroke = max(float(np.ptp(r.displacement)) for r in records)
    middle = float(np.mean(records[0].displacement))
    function = EVERY[kind][0]
    return [
        replace(
            r,
            displacement=np.ascontiguousarray(
                function(
                    r.displacement, r.dt * np.arange(float(len(r))), middle, stroke, size, case
                )
            ),
        )
        for r in records
    ]


def with_second(
    changed: Sequence[Record],
    records: Sequence[Record],
    kind: str,
    case: Case,
    generator: np.random.Generator,
) -> list[Record]:
    """Return changed records with a second channel [V], which only an actuator bends.

    It has as much noise as the first one has at rest.
    """
    seen = changed if kind == 'curved actuator' else records
    stroke = max(float(np.ptp(r.displacement)) for r in records)
    return [
        replace(
            new,
            second=10.0
            * (old.displacement + case.noise * generator.standard_normal(len(old)))
            / stroke,
        )
        for new, old in zip(changed, seen, strict=True)
    ]


def baseline_of(case: Case, word: str, data: Path) -> ModelFile:
    """Return the model that was fitted before, as its file says it."""
    fitted = [cut(record, case.until) for record in load([data / case.fitted])]
    return ModelFile.parse(identify(fitted, chain(word)).model.text())


def noisy(records: Sequence[Record], rms: float, seed: Sequence[int]) -> list[Record]:
    """Return the records with white noise more [m], as if they had been taken again."""
    generator = np.random.default_rng(seed)
    return [
        replace(r, displacement=r.displacement + rms * generator.standard_normal(len(r)))
        for r in records
    ]


def compared(
    case: Case, word: str, data: Path, how: str, seed: Sequence[int], workers: int
) -> tuple[ModelFile, list[Record], Case]:
    """Return what is known from a reference, the records to hide effects in, and their times."""
    if how == 'repeated':
        before = load([data / file for file in case.evaluated])
        known = as_on(before, chain(word), workers=workers)
        return known, noisy(before, case.noise, (*seed, 1)), case
    whole = load([data / case.fitted])[0]
    middle = int(case.parted / whole.dt)
    after = whole.section(middle, len(whole))
    known = as_on([whole.section(0, middle)], chain(word), workers=workers)
    return known, [after], replace(case, slow=after.dt * len(after))


def examined(
    case: Case, word: str, data: Path, seed: Sequence[int], how: Search, reference: str = ''
) -> list[Row]:
    """Return one row per effect, and that of the control."""
    if reference:
        known, records, case = compared(case, word, data, reference, seed, how.workers)
    else:
        known, records = baseline_of(case, word, data), load([data / f for f in case.evaluated])
    generator = np.random.default_rng(seed)
    rows: list[Row] = []
    control = float('nan')
    for kind in how.kinds():
        size = float(np.exp(generator.uniform(np.log(0.25), 0.0)))
        started = time.perf_counter()
        changed = hide(records, kind, size, case)
        baseline: Model | ModelFile = known
        before: list[Record] = []
        if how.second:
            changed = with_second(changed, records, kind, case, generator)
            if reference == 'repeated':
                unchanged = load([data / file for file in case.evaluated])
                before = with_second(unchanged, unchanged, 'nothing', case, generator)
                baseline = chain(word)
        found = discover(
            changed, baseline, reference=before, workers=how.workers, time_limit=how.limit
        )
        verdict = found.verdict
        if kind == 'nothing':
            control = verdict.held_out.gap_before_rms_m
        seconds = time.perf_counter() - started
        rows.append(Row(case.name, word, kind, size, verdict, control, seconds))
        print(f'{case.name} {word} {kind} {size:.2f}: {rows[-1].told} ({seconds:.0f} s)')
        sys.stdout.flush()
    return rows


def exam(world: str, rows: Sequence[Row], seed: int, variant: str = '') -> Exam:
    """Return the exam of a world with effects from `HIDDEN`."""
    back = hits([row.ratio <= AS_CONTROL for row in rows if row.truth])
    counts = {**counted(rows), 'held_out': back}
    longest = max(row.seconds for row in rows)
    return Exam(world, seed, counts, [row.cells for row in rows], variant, round(longest))


def everything(asked: argparse.Namespace, data: Path) -> list[Row]:
    """Examine every actuator whose records are there."""
    how = Search(asked.workers, asked.time_limit, asked.effects, asked.second, asked.bends)
    rows: list[Row] = []
    for case in CASES:
        if all((data / file).exists() for file in (case.fitted, *case.evaluated)):
            for place, word in enumerate(case.baselines[: asked.baselines]):
                drawn = asked.seed, CASES.index(case), place
                rows += examined(case, word, data, drawn, how, asked.reference)
    return rows


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the options of this world."""
    parser.set_defaults(seed=7)
    add = parser.add_argument
    add('--data', type=Path, default=Path('../shared/data'))
    add('--reference', choices=['parts', 'repeated'], default='')
    add('--bends', action='store_true', help='hide curves of the sensor and gains')
    add('--second', type=int, default=0, metavar='N', help='draws of each curve')
    add('--baselines', type=int, help='so many of each actuator')
    add('--effects', type=int, default=len(HIDDEN), help='so many, and none')


QUICK = {'data': None, 'baselines': 1, 'effects': 2, 'time_limit': 2.0}


def run(asked: argparse.Namespace) -> list[Exam]:
    """Examine every actuator."""
    files = {file for case in CASES[:1] for file in (case.fitted, *case.evaluated)}
    with records_in(asked.data, sorted(files)) as data:
        rows = everything(asked, data)
    if not rows:
        sys.exit(f'no measured record in {asked.data}')
    how = ('second' if asked.second else '', 'bends' if asked.bends else '', asked.reference)
    return [exam('hidden', rows, asked.seed, ' '.join(filter(None, how)))]
