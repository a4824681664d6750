"""The bimorph of Fujii 2018 and Tatebatake 2017: its records, its models and its control."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.compensation.harmonics.harmonic_attenuation import (
    AttenuationSettings,
    HarmonicAttenuation,
)
from piezo_hysteresis.compensation.inverses.inverse_choice import inverse_for, model_gain
from piezo_hysteresis.compensation.inverses.physical import ExtendedInverse, PhysicalInverse
from piezo_hysteresis.compensation.linear_gain import ModeGain
from piezo_hysteresis.compensation.link import Limits, Link
from piezo_hysteresis.compensation.offline_loop import LoopResult
from piezo_hysteresis.identification import OnlineRls, RlsSettings
from piezo_hysteresis.identification.fit import fit
from piezo_hysteresis.models import Model, named
from piezo_hysteresis.numerics.harmonics import line_amplitudes
from piezo_hysteresis.records import Record, RecordInfo
from piezo_hysteresis.waveforms import Sine
from studies.papers import runs

NAME = 'fdk_pzba_00030'
DT = 1e-3
LIMITS = Limits(-5.0, 5.0, 1e4)


@functools.cache
def record(frequency: float, seconds: float = 6.0) -> Record:
    """Return the bimorph driven by 1 V, as Fujii 2018 (13) does."""
    info = RecordInfo(frequency=frequency, amplitude=1.0, warm_up=0.5 * seconds)
    return runs.record(NAME, Sine(1.0, frequency, seconds), DT, info)


@functools.cache
def amplitude(frequency: float) -> float:
    """Return the amplitude of the reference [m], Fujii 2018 (25), Tatebatake 2017 (14)."""
    each = record(frequency)
    part = slice(each.warm_up_samples, None)
    u, y = each.voltage[part], each.displacement[part]
    return abs(float((y - y.mean()) @ u / (u @ u)))


@functools.cache
def identified() -> tuple[Model, Mapping[str, float]]:
    """Return Bouc-Wen and one mode, identified jointly from five frequencies."""
    model = named('bouc_wen_mode')
    records = [record(f) for f in (1.0, 7.0, 14.0, 23.0, 40.0)]
    return model, fit(model, records, weights='relative').values


THIRD = tuple(float(f) for f in range(18, 29))

FIFTH = (14.0,)


@dataclass(frozen=True)
class Length:
    """Durations and frequencies of the runs."""

    identify: float = 100.0  # durations of identification [s]
    track: float = 40.0  # tracking [s]
    begin: float = 20.0  # time from which errors are evaluated [s]
    frequencies: tuple[float, ...] = tuple(float(f) for f in range(1, 51))  # [Hz]


FULL = Length()

QUICK = Length(20.0, 10.0, 6.0, (1.0, 10.0, 14.0, 22.0, 23.0, 35.0))


def length_of(quick: bool) -> Length:
    """Return the durations of the runs of a figure."""
    return QUICK if quick else FULL


def lines(signal: FloatArray, frequency: float, orders: Sequence[int]) -> dict[int, complex]:
    """Return the complex amplitudes of whole periods at the end of `signal`."""
    periods = max(1, int(signal.size * DT * frequency * 0.5))
    last = round(periods / frequency / DT)
    phase = 2.0 * np.pi * frequency * DT * np.arange(signal.size, dtype=np.float64)
    _, phasors = line_amplitudes(signal[-last:], phase[-last:], orders)
    return dict(zip(orders, map(complex, phasors), strict=True))


def order_of(frequency: float) -> int:
    """Return the harmonic with which Fujii 2018 enhances the model at `frequency`, 0 for none."""
    return 5 if frequency in FIFTH else 3 if frequency in THIRD else 0


@functools.cache
def rls(frequency: float, harmonic: int, seconds: float) -> OnlineRls:
    """Return the papers' RLS after a record of one sine."""
    online = OnlineRls(RlsSettings(harmonic=harmonic, frequency=frequency))
    each = record(frequency, seconds)
    online.update_many(each.voltage, each.displacement)
    return online


@functools.cache
def basic(frequency: float, seconds: float) -> Mapping[str, float]:
    """Return Tatebatake 2017's basic model (18) after one record, from its start."""
    online = OnlineRls(RlsSettings(variant='basic'))
    each = record(frequency, seconds)
    online.update_many(each.voltage, each.displacement)
    return {**online.estimate().parameters(), 'A0': 0.0}


def free_run(frequency: float, kind: str, seconds: float) -> tuple[FloatArray, FloatArray]:
    """Return the last fifth of a record and of the free run of a model, means removed [m]."""
    each = record(frequency, seconds)
    if kind == 'basic':
        model = named('classical_euler')
        answer = model.respond(each.voltage, model.pack(basic(frequency, seconds)), DT)
    else:
        harmonic = order_of(frequency) if kind == 'enhanced' else 0
        answer = rls(frequency, harmonic, seconds).free_run(each.voltage)
    part = slice(-(len(each) // 5), None)
    measured, modelled = each.displacement[part], answer[part]
    return measured - measured.mean(), modelled - modelled.mean()


def modelling_error(frequency: float, kind: str, seconds: float) -> float:
    """Return the rms error of the free run, mean removed [m]."""
    measured, modelled = free_run(frequency, kind, seconds)
    return runs.rms(measured - modelled)


def phase_difference(a: FloatArray, b: FloatArray, frequency: float) -> float:
    """Return the phase lead of the fundamental of `a` over that of `b` [degrees]."""
    first, second = lines(a, frequency, (1,))[1], lines(b, frequency, (1,))[1]
    return float(np.degrees(np.angle(first / second)))


def mean_missed(frequency: float, seconds: float) -> float:
    """Return the mean of a record less that of the free run of the enhanced model [m]."""
    each = record(frequency, seconds)
    answer = rls(frequency, order_of(frequency), seconds).free_run(each.voltage)
    return float(np.mean((each.displacement - answer)[-(len(each) // 5) :]))


def papers_feedforward(frequency: float, kind: str, seconds: float, offset: float = 0.0) -> Link:
    """Return the feedforward that a paper derives from the model of this frequency."""
    if kind == 'basic':
        return PhysicalInverse(basic(frequency, seconds), DT, law='delayed', limits=LIMITS)
    harmonic = order_of(frequency) if kind == 'enhanced' else 0
    values = rls(frequency, harmonic, seconds).estimate().parameters()
    seven = {name: values[name] for name in ('A1', 'A', 'A0', 'beta', 'gamma', 'c1', 'c2')}
    seven |= {'offset': offset} if offset else {}
    law = 'printed' if kind == 'printed' else 'solved'
    return ExtendedInverse(seven, DT, law=law, limits=LIMITS)


def links(frequency: float, kind: str, seconds: float) -> list[Link]:
    """Return the chain called `kind`.

    ``basic``, ``extended``: the papers' feedforward, the latter by Fujii 2018 (16), (17);
    ``printed`` by Tatebatake 2017 (12) as it stands; ``proposed``: Fujii 2018's feedforward from
    the enhanced model with its RLS attenuation (18) to (23); ``proposed, computed sign``, whose
    sign follows from the gain of the model of `identified`; ``proposed, with offset``, whose
    feedforward has the mean of the record that its free run misses; ``ours``: the identified
    physical inverse with cancellation of several orders.
    """
    if kind == 'ours':
        model, values = identified()
        settings = AttenuationSettings(
            orders=(0, 1, 2, 3, 5, 7), resonance=values['natural_frequency'],
            settle=0.5, span=0.5, step_size=0.6,
        )  # fmt: skip
        gain = model_gain(model, values, DT)
        return [
            inverse_for(model, values, DT, limits=LIMITS),
            HarmonicAttenuation(settings, gain, DT),
        ]
    if not kind.startswith('proposed'):
        return [papers_feedforward(frequency, kind, seconds)]
    offset = mean_missed(frequency, seconds) if kind.endswith('with offset') else 0.0
    chain = [papers_feedforward(frequency, 'enhanced', seconds, offset)]
    if order_of(frequency):
        _, values = identified()
        settings = AttenuationSettings(
            method='rls',
            orders=(order_of(frequency),),
            forgetting=1.0,
            sign_rule='computed' if kind.endswith('computed sign') else 'printed',
        )
        mode = values['natural_frequency'], values['damping_ratio']
        plant = ModeGain(values['A1'] - values['A'], *mode, DT, values.get('delay', 0.0))
        chain.append(HarmonicAttenuation(settings, plant, DT))
    return chain


@functools.cache
def tracked(frequency: float, kind: str, length: Length) -> LoopResult:
    """Return a run of Fujii 2018 (24), (25): a sine of the amplitude that 1 V gives."""
    wave = Sine(amplitude(frequency), frequency, length.track, ramp=1.0)
    return runs.run(
        wave, lambda: links(frequency, kind, length.identify), runs.plant(NAME, 3), LIMITS, DT
    )


def tracking_error(frequency: float, kind: str, length: Length, mean: bool = False) -> float:
    """Return the rms tracking error, with or without its mean [m]."""
    error = tracked(frequency, kind, length).error[round(length.begin / DT) :]
    return runs.rms(error if mean else error - error.mean())


_LOOPS = 3.0
"""Seconds of a record of the bimorph; the last periods are drawn."""

# Like those of Tatebatake 2017, chosen to show the shape: its RLS finds no loop in the basic model
# at 1 Hz.
_FICTITIOUS = {'A1': 170e-6, 'A': 60e-6, 'beta': 2.0, 'gamma': 0.5}


def modelled(
    frequency: float, kind: str, identified_at: float = 0.0
) -> tuple[FloatArray, FloatArray]:
    """Return voltage and displacement of a model of Fujii 2018 or Tatebatake 2017, two periods.

    The extended model is identified at `identified_at` [Hz], by default at `frequency`.
    """
    each = record(frequency, _LOOPS)
    if kind == 'extended':
        answer = rls(identified_at or frequency, 0, 20.0).free_run(each.voltage)
    else:
        model = named('classical_euler' if kind == 'basic' else 'modified_euler')
        values = {**_FICTITIOUS, 'A0': 0.0 if kind == 'basic' else 0.1 * _FICTITIOUS['A']}
        answer = model.respond(each.voltage, model.pack(values), DT)
    part = slice(-round(2.0 / (frequency * DT)), None)
    return each.voltage[part], answer[part]


def state(frequency: float, kind: str) -> tuple[FloatArray, FloatArray]:
    """Return voltage and state h = A1 u - y of the basic or the modified model, two periods."""
    u, y = modelled(frequency, kind)
    return u, _FICTITIOUS['A1'] * u - y
