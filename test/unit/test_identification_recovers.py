"""Every named model is recovered from records of its own kind, however these begin."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from scipy.stats import chi2

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.identification import identify
from piezo_hysteresis.identification.fit import FitResult
from piezo_hysteresis.identification.fit_data import whole
from piezo_hysteresis.identification.free_run import simulated
from piezo_hysteresis.identification.output_error import suited
from piezo_hysteresis.models import NAMES, Model, named
from piezo_hysteresis.records import Record, RecordInfo
from studies.worlds.foreign_world import DAHL, NOISE, RATE
from studies.worlds.investigate_foreign import Stage, ramped

AMPLITUDE, STROKE = 1.0, 100e-6
NOISES = {'equal': (2e-8, 2e-8), 'unequal': (1e-8, 8e-8)}
#: How records begin; unequal noise is the harder of both, so a start that is hard meets it too.
BEGINS = {'rest': 'equal', 'step': 'unequal', 'mid_period': 'unequal'}

_MODE = {'natural_frequency': 90.0, 'damping_ratio': 0.05}
_STRUCTURE = {'mass': 2.5, 'damping': 140.0}  # 90 Hz
_EULER = {'A0': -1e-6, 'c1': 0.42, 'c2': -0.70}
#: What is put in, where a default is 0, tells nothing or lies at the edge of what is stable;
#: everything else is a default moved.
TRUTH: dict[str, dict[str, float]] = {
    'linear_mode': {**_MODE, 'A1': 1e-4},
    'bouc_wen_mode': _MODE,
    'second_order': _STRUCTURE,
    'second_order_power': {**_STRUCTURE, 'exponent': 1.3},
    'classical_power': {'exponent': 1.3},
    'modified': {'A0': -3e-6},
    'modified_euler': {'A0': -3e-6},
    'extended': _EULER,
    'enhanced3': {**_EULER, 'al1': 2e-6, 'al2': 1e-6},
    'enhanced5': {**_EULER, 'al3': 2e-6, 'al4': 1e-6},
    'enhanced3_sine': {**_EULER, 'sine3': 2e-6, 'cosine3': 1e-6},
    'enhanced5_sine': {**_EULER, 'sine5': 2e-6, 'cosine5': 1e-6},
    'rate_dependent': {'epsilon': 5e-6, 'bias': 0.2, 'rate_exponent': 0.15, 'rate_corner': 5.0},
}
#: What records like these need not determine, and why: a steady harmonic shows two of the four
#: numbers of the printed recursion, the others only where it is seen to set in; cells of the plane
#: that no reversal visits move nothing; no filter of a rate.
LOOSE: dict[str, tuple[str, ...]] = {
    'inverse_selector': ('offset',),  # every record has a zero of its own
    'enhanced3': ('c3', 'c4', 'al1', 'al2'),
    'enhanced5': ('c5', 'c6', 'al3', 'al4'),
    'preisach': ('mu_',),
    'rate_dependent': ('rate_memory',),
}


def two_tones() -> tuple[float, FloatArray]:
    """Return an interval [s] and two tones with inner loops, which begin at 0 V."""
    t = 1e-3 * np.arange(3000)
    return 1e-3, AMPLITUDE * (0.65 * np.sin(4 * np.pi * t) + 0.35 * np.sin(14 * np.pi * t))


def triangles(frequency: float) -> tuple[float, FloatArray]:
    """Return an interval [s] and triangles of several heights of one frequency [Hz]."""
    dt = 2e-4
    cycle = np.arange(round(1 / frequency / dt)) * frequency * dt
    triangle = 4 * np.abs((cycle + 0.75) % 1.0 - 0.5) - 1.0
    shares = (1.0, 1.0, 0.5, 0.8, 0.3, 1.0)
    return dt, AMPLITUDE * np.concatenate([share * triangle for share in shares])


def drives_of(name: str) -> list[tuple[float, FloatArray]]:
    """Return intervals and drives of the records: a selector needs triangles of every slope."""
    if name == 'inverse_selector':
        return [triangles(frequency) for frequency in np.arange(10.0, 121.0, 10.0)]
    return [two_tones(), two_tones()]


def model_of(name: str) -> Model:
    model = named(name)
    # the last knot where the truth has it: else it is put at the steepest record
    model = model.hold(selector_slope=0.02) if name == 'inverse_selector' else model
    dt, drive = two_tones()
    return suited(model, [Record('p', dt, drive, STROKE / 2 * drive)])


def truth_of(model: Model, name: str) -> dict[str, float]:
    usual = model.defaults()
    if name == 'inverse_selector':
        # from knot to knot as smoothly as an actuator: jumps would make the slope itself jump
        bent = {'gain': (0.96, 1.05), 'A': (0.93, 1.2), 'beta': (1.08, 0.9)}
        moved = {
            f'inverse_{word}_at{i + 1}': usual[f'inverse_{word}_at1'] * float(share)
            for word, (first, last) in bent.items()
            for i, share in enumerate(np.linspace(first, last, 10))
        }
        return {**usual, **moved}
    rng = np.random.default_rng(len(name))
    moved = {
        q.name: float(np.clip(q.default * rng.uniform(0.85, 1.15), q.low, q.high))
        for q in model.parameters
        if not q.held
    }
    return {**usual, **moved, **TRUTH.get(name, {})}


def records_of(
    model: Model, values: dict[str, float], name: str, begin: str, noises: tuple[float, ...]
) -> Iterator[Record]:
    """Simulate records that begin at rest, with a step or in mid-period."""
    rng = np.random.default_rng(5)
    packed = model.pack(values)
    for k, (dt, drive) in enumerate(drives_of(name)):
        u = drive + (0.3 * AMPLITUDE * (1 + k % 2) if begin == 'step' else 0.0)
        info = RecordInfo(excitation='sum', frequency=0.0 if dt < 1e-3 else 2.0)
        noise = noises[k % 2]
        clean = Record(f'r{k}', dt, u, np.zeros(u.size), info=info)
        y = simulated(model, packed, whole(clean))[-u.size :]
        record = replace(clean, displacement=y + noise * rng.standard_normal(u.size))
        first = round(u.size * (0.21 + 0.07 * (k % 2)))
        yield record.section(first, u.size) if begin == 'mid_period' else record


def distance(found: FitResult, truth: dict[str, float], sure: list[str]) -> float:
    """Return the squared distance from the truth in standard deviations, all together."""
    places = [found.free.index(name) for name in sure]
    away = np.array([(found.values[name] - truth[name]) / found.std[name] for name in sure])
    together = found.correlation[np.ix_(places, places)]
    return float(away @ np.linalg.pinv(together, rcond=1e-10, hermitian=True) @ away)


#: What takes longer than a second even from rest.
LONG = ('enhanced3', 'enhanced5_sine', 'inverse_selector', 'bouc_wen_oscillator', 'modified_euler')


#: One of the knots ends 4.9 standard deviations from the truth: the state in which one of the
#: records begins does not go where its derivative says, and is then judged by that derivative.
MISSED = pytest.mark.xfail(strict=True, reason='a state at the start is judged by its derivative')


def marks_of(name: str, begin: str) -> list[pytest.MarkDecorator]:
    marks = [] if begin == 'rest' and name not in LONG else [pytest.mark.slow]
    return [*marks, MISSED] if (name, begin) == ('inverse_selector', 'mid_period') else marks


CASES = [
    pytest.param(*each, marks=marks_of(*each), id='-'.join(each))
    for each in product(NAMES, BEGINS)
]


@pytest.mark.component
@pytest.mark.parametrize(('name', 'begin'), CASES)
def test_a_model_is_recovered(name: str, begin: str) -> None:
    noises = NOISES[BEGINS[begin]]
    model = model_of(name)
    truth = truth_of(model, name)
    records = list(records_of(model, truth, name, begin, noises))
    found = identify(records, model).fit
    assert found is not None
    assert found.converged, found.message
    each = noises * (len(records) // 2)
    left = [found.residuals[r.name] / noise for r, noise in zip(records, each, strict=True)]
    # every unknown takes a sample with it
    freedom = sum(e.size for e in left) - len(found.free)
    assert sum(float(e @ e) for e in left) / freedom == pytest.approx(1.0, abs=0.15)
    # a level may stand for the state of a record of two hundred samples, and miss a little
    assert max(float(np.sqrt(np.mean(e**2))) for e in left) < 1.5
    sure = [n for n in found.free if n in truth and np.isfinite(found.std[n])]
    lost = [n for n in found.free if n not in sure and n in truth]
    assert all(n.startswith(LOOSE.get(name, ())) for n in lost), lost
    # what is not determined is said, not made up; a common zero beside own ones by its deviation
    assert all(any(n in text for text in found.warnings) for n in lost if n != 'offset')
    away = {n: (found.values[n] - truth[n]) / found.std[n] for n in sure}
    assert max(map(abs, away.values())) < 4.0, away
    assert distance(found, truth, sure) < chi2.ppf(0.999, len(sure)), away


@pytest.mark.component
def test_a_mode_is_recovered_from_samples_taken_a_tick_later() -> None:
    """A friction loop before a mode is a Bouc-Wen model; the drive at 50 Hz excites the mode."""
    stage = Stage(DAHL, 'nothing', 0.0, np.random.default_rng([0, 5]))
    drives = [(a, f) for f in (1.0, 5.0, 20.0, 50.0) for a in (0.5, 1.0)]
    records = [stage.measured(f'{f:g} Hz {a:g} V', ramped(a, f)) for a, f in drives]
    found = identify(records, 'bouc_wen_mode')
    assert found.values['natural_frequency'] == pytest.approx(95.0, rel=2e-3)
    assert found.values['damping_ratio'] == pytest.approx(0.04, rel=0.02)
    assert found.values['beta'] == pytest.approx(5.0, rel=0.02)
    assert found.sampling_offset == pytest.approx(0.95 / RATE, abs=0.02 / RATE)
    assert max(row.free_run_rms for row in found.records) < 1.1 * NOISE * STROKE
