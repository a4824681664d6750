"""Plants of the papers, models identified from them, and runs: shared by the other scripts here.

Nothing below knows the numbers of a plant: every model is identified from sweeps of it.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks import named_block
from piezo_hysteresis.compensation.base import Limits, Link, Measured, ReferencePoint
from piezo_hysteresis.compensation.loop import LoopResult, closed_loop
from piezo_hysteresis.identification.fit import fit
from piezo_hysteresis.identification.identify import Identification, identify
from piezo_hysteresis.models import Model, named
from piezo_hysteresis.records import Record, RecordInfo
from piezo_hysteresis.waveforms import Sine, Triangle, Waveform
from piezo_sim.plant import Plant

BIMORPH, STACK, FLAP, STAGE = 'fdk_pzba_00030', 'xiao_pi_stack', 'zhou_tef', 'fang_p845_stage'
BIMORPH_DT, STACK_DT, FLAP_DT, STAGE_DT = 1e-3, 1e-4, 2e-4, 1e-3
BIMORPH_LIMITS = Limits(-5.0, 5.0, 1e4)
STACK_LIMITS = Limits(-30.0, 130.0, 1e7)
FLAP_LIMITS = Limits(-60.0, 60.0, 1e6)
STAGE_LIMITS = Limits(0.0, 10.0, 1e6)
# Xiao 2014 asks for 30 um at 100 Hz from a stack that gives 26 um at 100 V: its amplifier has to
# go beyond the nominal range, as that maker's amplifiers do (-30 .. 130 V).
STACK_RANGE = {'amplifier.range_low': -30.0, 'amplifier.range_high': 130.0}

Links = Callable[[], Sequence[Link]]


class Straight:
    """No compensation: displacement over one gain, about a bias."""

    def __init__(self, gain: float, bias: float = 0.0, middle: float = 0.0) -> None:
        self._gain, self._bias, self._middle = gain, bias, middle

    def step(
        self, point: ReferencePoint, received: float, measured: Measured | None = None
    ) -> float:
        """Return the voltage of a straight line."""
        return received + self._bias + (point.displacement - self._middle) / self._gain

    def reset(self) -> None:
        """Do nothing; a straight line remembers nothing."""

    def counters(self) -> dict[str, int]:
        """Return nothing; a straight line cannot go wrong."""
        return {}


def plant(name: str, seed: int = 1, overrides: Mapping[str, float | bool] | None = None) -> Plant:
    """Return a simulated actuator at the rate of its preset."""
    known = STACK_RANGE if name == STACK else {}
    return Plant.from_preset(name, seed=seed, overrides={**known, **(overrides or {})})


def run(
    waveform: Waveform,
    links: Links,
    actuator: Plant,
    limits: Limits,
    dt: float,
) -> LoopResult:
    """Run a reference through fresh links on an actuator."""
    time = np.arange(round(waveform.duration / dt), dtype=np.float64) * dt
    return closed_loop(waveform.sample(time), links(), actuator, limits, dt)


def record(name: str, waveform: Waveform, dt: float, info: RecordInfo, seed: int = 1) -> Record:
    """Return an open-loop record of the actuator `name`."""
    time = np.arange(round(waveform.duration / dt), dtype=np.float64) * dt
    voltage = waveform.sample(time).value
    displacement = plant(name, seed).run(voltage)
    return Record(f'{info.frequency:g} Hz', dt, voltage, displacement, info=info)


@functools.cache
def bimorph_record(frequency: float, seconds: float = 6.0) -> Record:
    """Return the bimorph driven by 1 V, as Fujii 2018 (13) does."""
    info = RecordInfo(frequency=frequency, amplitude=1.0, warm_up=0.5 * seconds)
    return record(BIMORPH, Sine(1.0, frequency, seconds), BIMORPH_DT, info)


@functools.cache
def bimorph_amplitude(frequency: float) -> float:
    """Return Fujii 2018's amplitude of the reference (25) [m]."""
    each = bimorph_record(frequency)
    part = slice(each.warm_up_samples, None)
    u, y = each.voltage[part], each.displacement[part]
    return abs(float((y - y.mean()) @ u / (u @ u)))


@functools.cache
def bimorph_model() -> tuple[Model, Mapping[str, float]]:
    """Return Bouc-Wen and one mode, identified jointly from five frequencies."""
    model = named('bouc_wen_mode')
    records = [bimorph_record(f) for f in (1.0, 7.0, 14.0, 23.0, 40.0)]
    return model, fit(model, records, weights='relative').values


@functools.cache
def bimorph_plays() -> tuple[Model, Mapping[str, float]]:
    """Return Prandtl-Ishlinskii and one mode, identified from the same records."""
    model = Model(
        'plays',
        tuple(map(named_block, ('prandtl_ishlinskii', 'mode', 'offset'))),
        {'pi_range': 1.0},
    )
    records = [bimorph_record(f) for f in (1.0, 7.0, 14.0, 23.0, 40.0)]
    return model, fit(model, records, weights='relative').values


@functools.cache
def stack_record(frequency: float) -> Record:
    """Return the stack of Xiao 2014 driven by triangles from 0 to 100 V."""
    wave = Triangle(50.0, 1.0, offset=50.0, frequency=frequency, phase=-0.5 * np.pi)
    info = RecordInfo(frequency=frequency, amplitude=50.0, warm_up=0.4)
    return record(STACK, wave, STACK_DT, info)


@functools.cache
def stack_steps() -> Record:
    """Return the stack of Xiao 2014 after steps of up to 2 V, small against its hysteresis."""
    levels = np.random.default_rng(3).uniform(-2.0, 2.0, 60)
    voltage = np.concatenate([np.zeros(200), np.repeat(levels, 150)])
    return Record('steps', STACK_DT, voltage, plant(STACK).run(voltage))


@functools.cache
def stack_model() -> tuple[Model, Mapping[str, float]]:
    """Return Bouc-Wen, one mode and creep, identified from three triangles."""
    names = ('bouc_wen_exact', 'mode', 'creep', 'offset')
    model = Model('stack', tuple(map(named_block, names)), {'A0': 0.0})
    start = {**model.defaults(), 'A1': 3.5e-7, 'A': 1e-7, 'A0': 0.0, 'beta': 0.03, 'gamma': 0.01,
             'natural_frequency': 350.0, 'damping_ratio': 0.9, 'creep_share': 0.05,
             'creep_time': 0.03}  # fmt: skip
    return model, fit(model, [stack_record(f) for f in (10.0, 40.0, 100.0)], start).values


def stage_records(frequencies: Sequence[float]) -> list[Record]:
    """Return sines of the stage of Fang 2019 about its bias, each in its steady state."""
    records = []
    for frequency in frequencies:
        seconds = max(4.0, 4.0 / frequency)
        wave = Sine(4.8, frequency, seconds, offset=4.9, phase=-0.5 * np.pi)
        info = RecordInfo(frequency=frequency, amplitude=4.8, warm_up=0.5 * seconds)
        records.append(record(STAGE, wave, STAGE_DT, info))
    return records


@functools.cache
def stage_model() -> tuple[Model, Mapping[str, float]]:
    """Return a delay and Bouc-Wen with a rate, from four sines about Fang 2019's bias."""
    names = ('transport_delay', 'bouc_wen_rate', 'offset')
    model = Model('stage', tuple(map(named_block, names)), {'A0': 0.0})
    start = {**model.defaults(), 'delay': 1e-3, 'A1': 1.8e-6, 'A': 0.8e-6, 'A0': 0.0,
             'beta': 2.0, 'gamma': 1.5, 'rate_corner': 20.0, 'rate_exponent': 0.05}  # fmt: skip
    return model, fit(model, stage_records((0.5, 1.0, 5.0, 10.0)), start).values


@functools.cache
def slow_stage_model() -> tuple[Model, Mapping[str, float]]:
    """Return a delay and the classical model, from sines up to 1 Hz, as Fang 2019 has it."""
    names = ('transport_delay', 'bouc_wen_exact', 'offset')
    model = Model('slow_stage', tuple(map(named_block, names)), {'A0': 0.0})
    start = {**model.defaults(), 'delay': 1e-3, 'A1': 1.8e-6, 'A': 0.8e-6, 'A0': 0.0,
             'beta': 2.0, 'gamma': 1.5}  # fmt: skip
    return model, fit(model, stage_records((0.5, 1.0)), start).values


def flap_records() -> list[Record]:
    """Return the sines that Zhou 2021 identifies from: 60 V at 1 and at 30 Hz."""
    records = []
    for frequency, seconds in ((1.0, 3.0), (30.0, 0.4)):
        wave = Sine(60.0, frequency, seconds)
        info = RecordInfo(frequency=frequency, amplitude=60.0, warm_up=0.5 * seconds)
        records.append(record(FLAP, wave, FLAP_DT, info))
    return records


@functools.cache
def flap_by_002() -> Identification:
    """Return Zhou 2021's identification: d, k and m by (5) known, two steps by particle swarm."""
    known = {'A1': 5.5e-6, 'stiffness': 8e5, 'mass': 8e5 / (2 * np.pi * 628.0) ** 2}
    chain = named('second_order').hold(**known)
    return identify(flap_records(), chain, method='zhou2021', seed=1, max_evaluations=4000)


@functools.cache
def flap_model() -> tuple[Model, Mapping[str, float]]:
    """Return Bouc-Wen and one mode, by one joint fit to 1 Hz and 30 Hz."""
    model = named('bouc_wen_mode')
    records = flap_records()
    start = {**model.defaults(), 'A1': 5e-6, 'A': 2.5e-6, 'A0': 0.0, 'beta': 0.03, 'gamma': 0.01,
             'natural_frequency': 628.0, 'damping_ratio': 1.0}  # fmt: skip
    free = ('A1', 'A', 'beta', 'gamma', 'damping_ratio', 'offset')
    return model, fit(model, records, start, free=free).values


def rms(error: FloatArray) -> float:
    """Return the root of the mean square."""
    return float(np.sqrt(np.mean(error**2)))
