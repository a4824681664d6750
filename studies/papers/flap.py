"""The actuator of Zhou 2021: its records, the models from them and its chains."""

from __future__ import annotations

import functools
from collections.abc import Mapping

import numpy as np

from piezo_hysteresis.compensation.feedback.pid import Pid, PidGains
from piezo_hysteresis.compensation.harmonics.harmonic_attenuation import (
    AttenuationSettings,
    HarmonicAttenuation,
)
from piezo_hysteresis.compensation.inverses.inverse_choice import inverse_for, model_gain
from piezo_hysteresis.compensation.link import Limits, Link
from piezo_hysteresis.compensation.offline_loop import tracking_metrics
from piezo_hysteresis.identification.fit import fit
from piezo_hysteresis.identification.identify import Identification, identify
from piezo_hysteresis.models import Model, named
from piezo_hysteresis.records import Record, RecordInfo
from piezo_hysteresis.waveforms import Sine
from studies.papers import runs

NAME = 'zhou_tef'
DT = 2e-4
LIMITS = Limits(-60.0, 60.0, 1e6)


def records() -> list[Record]:
    """Return the sines that Zhou 2021 identifies from: 60 V at 1 and at 30 Hz."""
    found = []
    for frequency, seconds in ((1.0, 3.0), (30.0, 0.4)):
        wave = Sine(60.0, frequency, seconds)
        info = RecordInfo(frequency=frequency, amplitude=60.0, warm_up=0.5 * seconds)
        found.append(runs.record(NAME, wave, DT, info))
    return found


@functools.cache
def by_zhou() -> Identification:
    """Return Zhou 2021's identification: d, k and m by (5) known, two steps by particle swarm."""
    known = {'A1': 5.5e-6, 'stiffness': 8e5, 'mass': 8e5 / (2 * np.pi * 628.0) ** 2}
    model = named('second_order').hold(**known)
    return identify(records(), model, method='zhou2021', seed=1, max_evaluations=4000)


@functools.cache
def identified() -> tuple[Model, Mapping[str, float]]:
    """Return Bouc-Wen and one mode, by one joint fit to 1 Hz and 30 Hz."""
    model = named('bouc_wen_mode')
    start = {**model.defaults(), 'A1': 5e-6, 'A': 2.5e-6, 'A0': 0.0, 'beta': 0.03, 'gamma': 0.01,
             'natural_frequency': 628.0, 'damping_ratio': 1.0}  # fmt: skip
    free = ('A1', 'A', 'beta', 'gamma', 'damping_ratio', 'offset')
    return model, fit(model, records(), start, free=free).values


STROKE, STRAIGHT = 200e-6, 4.3e-6


def chain(kind: str, values: Mapping[str, float] | None) -> list[Link]:
    """Return the chain called `kind` for Zhou 2021's actuator with a model of these values.

    Without values those of Zhou 2021's own identification, inverted by its equation (8).
    """
    model, _ = identified()
    if kind == 'none':
        return [runs.Straight(STRAIGHT)]
    law = 'auto'
    if values is None:
        found = by_zhou()
        model, values, law = found.chain, found.values, 'zhou2021'
    links: list[Link] = [inverse_for(model, values, DT, limits=LIMITS, scale=60.0, law=law)]
    if kind in ('PID', 'compound'):
        links.append(Pid(PidGains(1e5, 5e7), DT, limits=LIMITS))
    if kind == 'compound':
        settings = AttenuationSettings(
            orders=(1, 2, 3, 5), largest_step=20.0, largest_correction=40.0
        )
        links.append(HarmonicAttenuation(settings, model_gain(model, values, DT, 60.0), DT))
    return links


def mismatches() -> dict[str, dict[str, float]]:
    """Return the model as found and with each parameter wrong by 10 %, by words."""
    _, found = identified()
    cases = {'as identified': dict(found)}
    for name in ('A1', 'A', 'beta', 'gamma', 'damping_ratio'):
        for factor in (0.9, 1.1):
            values = {**found, name: factor * found[name]}
            if name == 'A1':  # d of Zhou 2021 scales the linear and the hysteretic share
                values['A'] = factor * found['A']
            cases[f'{name} {100 * (factor - 1):+.0f} %'] = values
    return cases


def largest_error(kind: str, frequency: float, values: Mapping[str, float]) -> float:
    """Return the largest error in the steady state [m]."""
    wave = Sine(STROKE, frequency, 4.0, ramp=0.5)
    result = runs.run(wave, lambda: chain(kind, values), runs.plant(NAME), LIMITS, DT)
    return tracking_metrics(result, 2.0).largest
