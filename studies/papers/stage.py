"""The stage of Fang 2019: its records, the models from them and its chains."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from piezo_hysteresis.blocks import named_block
from piezo_hysteresis.compensation.feedback.pid import FuzzyPid, FuzzyRules, Pid, PidGains
from piezo_hysteresis.compensation.inverses.inverse_choice import inverse_for
from piezo_hysteresis.compensation.link import Limits, Link
from piezo_hysteresis.compensation.offline_loop import LoopResult, tracking_metrics
from piezo_hysteresis.identification.fit import fit
from piezo_hysteresis.identification.identify import identify
from piezo_hysteresis.models import Model, named
from piezo_hysteresis.records import Record, RecordInfo
from piezo_hysteresis.waveforms import Sine, from_spec
from studies.papers import runs

NAME = 'fang_p845_stage'
DT = 1e-3
LIMITS = Limits(0.0, 10.0, 1e6)
SEEDS = tuple(range(1, 7))
SLOW, ALL = (0.5, 1.0), (0.5, 1.0, 5.0, 10.0)
"""Frequencies [Hz] that each of the two models is identified from: up to 1 Hz, and all."""

# Fang 2019 figures 7 to 11: largest error of PID and of the inverse with fuzzy PID [µm].
FIGURES = (
    ('6 µm, 0.5 Hz', {'kind': 'sine', 'frequency': 0.5, 'amplitude': 6e-6}, 0.182, 0.057),
    ('6 µm, 1 Hz', {'kind': 'sine', 'frequency': 1.0, 'amplitude': 6e-6}, 0.318, 0.045),
    ('4 µm, 5 Hz', {'kind': 'sine', 'frequency': 5.0, 'amplitude': 4e-6}, 0.429, 0.078),
    ('6 µm, 10 Hz', {'kind': 'sine', 'frequency': 10.0, 'amplitude': 6e-6}, 2.27, 0.179),
    ('composite', {'kind': 'composite_fang2019', 'amplitude': 6e-6}, 6.10, 0.36),
)
GAIN = 1.4e-6
# Fang 2019 prints KD = 120 without a unit; V s/m is an interpretation, the other gains are ours.
GAINS = PidGains(0.2 / GAIN, 200.0 / GAIN, 120.0)
RULES = FuzzyRules(0.1e-6, 2e-5, 0.1 / GAIN, 100.0 / GAIN)
FIXED = replace(RULES, integral_range=1e-9)

Found = tuple[Model, Mapping[str, float]]


@functools.cache
def records(frequencies: Sequence[float]) -> tuple[Record, ...]:
    """Return sines of the stage about its bias, each in its steady state."""
    found = []
    for frequency in frequencies:
        seconds = max(4.0, 4.0 / frequency)
        wave = Sine(4.8, frequency, seconds, offset=4.9, phase=-0.5 * np.pi)
        info = RecordInfo(frequency=frequency, amplitude=4.8, warm_up=0.5 * seconds)
        found.append(runs.record(NAME, wave, DT, info))
    return tuple(found)


@functools.cache
def by_fang(seed: int, evaluations: int = 6000) -> Found:
    """Return the modified model by the modified swarm, from sines up to 10 Hz."""
    model = named('rate_dependent')
    found = identify(records(ALL), model, method='fang2019', seed=seed,
                     max_evaluations=evaluations, begins='settled')  # fmt: skip
    return found.chain, found.values


@functools.cache
def slow_by_fang(seed: int, evaluations: int = 6000) -> Found:
    """Return the classical model by the modified swarm, from sines up to 1 Hz."""
    found = identify(records(SLOW), named('classical'), method='fang2019', seed=seed,
                     max_evaluations=evaluations, begins='settled')  # fmt: skip
    return found.chain, found.values


@functools.cache
def by_least_squares() -> Found:
    """Return a delay and Bouc-Wen with a rate, from the same sines up to 10 Hz."""
    names = ('transport_delay', 'bouc_wen_rate', 'offset')
    model = Model('stage', tuple(map(named_block, names)), {'A0': 0.0})
    start = {**model.defaults(), 'delay': 1e-3, 'A1': 1.8e-6, 'A': 0.8e-6, 'A0': 0.0,
             'beta': 2.0, 'gamma': 1.5, 'rate_corner': 20.0, 'rate_exponent': 0.05}  # fmt: skip
    return model, fit(model, records(ALL), start).values


@functools.cache
def slow_by_least_squares() -> Found:
    """Return a delay and the classical model, from the same sines up to 1 Hz."""
    names = ('transport_delay', 'bouc_wen_exact', 'offset')
    model = Model('slow_stage', tuple(map(named_block, names)), {'A0': 0.0})
    start = {**model.defaults(), 'delay': 1e-3, 'A1': 1.8e-6, 'A': 0.8e-6, 'A0': 0.0,
             'beta': 2.0, 'gamma': 1.5}  # fmt: skip
    return model, fit(model, records(SLOW), start).values


def chain(kind: str, model: Found | None = None) -> list[Link]:
    """Return the chain called `kind` for the stage."""
    links: list[Link] = []
    if model is not None and 'inverse' in kind:
        links.append(inverse_for(*model, DT, limits=LIMITS, scale=5.0))
    if 'fuzzy PID' in kind:
        rules = FIXED if kind.endswith('fixed') else RULES
        links.append(FuzzyPid(GAINS, rules, DT, limits=LIMITS))
    elif kind.endswith('PID'):
        links.append(Pid(GAINS, DT, limits=LIMITS))
    return links


def run(
    spec: Mapping[str, object], kind: str, fast: Found | None = None, slow: Found | None = None
) -> LoopResult:
    """Track the reference `spec` about the middle of the range for 12 s.

    A ``switched inverse`` is that of `slow` for references up to 1 Hz (Fang 2019 (switch)).
    """
    wave = from_spec({**spec, 'duration': 12.0, 'offset': 9e-6, 'ramp': 1.0})
    calm = kind.startswith('switched') and float(wave.sample(np.zeros(1)).frequency[0]) <= 1.0
    return runs.run(
        wave, lambda: chain(kind, slow if calm else fast), runs.plant(NAME), LIMITS, DT
    )


def largest_error(result: LoopResult) -> float:
    """Return the largest error in the second half of a run [µm]."""
    return 1e6 * tracking_metrics(result, 6.0).largest
