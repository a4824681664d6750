"""The stack of Xiao 2014: its records, the models from them and its chains."""

from __future__ import annotations

import functools
from collections.abc import Mapping

import numpy as np

from piezo_hysteresis.blocks import named_block
from piezo_hysteresis.compensation.feedback.feedback_link import HInfinityWeights
from piezo_hysteresis.compensation.feedback.hinf import (
    HInfinity,
    HInfinityDesign,
    design,
    transfer_function,
)
from piezo_hysteresis.compensation.inverses.inverse_choice import inverse_for
from piezo_hysteresis.compensation.inverses.physical import SlopeSelectedInverse
from piezo_hysteresis.compensation.link import Limits, Link
from piezo_hysteresis.compensation.offline_loop import tracking_metrics
from piezo_hysteresis.identification.arx import TransferFunction, fit_transfer_function
from piezo_hysteresis.identification.fit import fit
from piezo_hysteresis.identification.inverse_fit import row_of, selector_table
from piezo_hysteresis.models import Model
from piezo_hysteresis.records import Record, RecordInfo
from piezo_hysteresis.waveforms import Triangle, Waveform
from piezo_sim.plant import Plant
from studies.papers import runs

NAME = 'xiao_pi_stack'
DT = 1e-4
LIMITS = Limits(-30.0, 130.0, 1e7)
# Xiao 2014 tracks 30 µm at 100 Hz with a stack that has 26 µm at 100 V: the amplifier must exceed
# the nominal range, like those of this manufacturer (-30 .. 130 V).
AMPLIFIER = {'amplifier.range_low': -30.0, 'amplifier.range_high': 130.0}


@functools.cache
def record(frequency: float) -> Record:
    """Return the stack of Xiao 2014 driven by triangles from 0 to 100 V."""
    wave = Triangle(50.0, 1.0, offset=50.0, frequency=frequency, phase=-0.5 * np.pi)
    info = RecordInfo(frequency=frequency, amplitude=50.0, warm_up=0.4)
    return runs.record(NAME, wave, DT, info)


@functools.cache
def step() -> Record:
    """Return the response of the stack at rest to one step of 2 V, as Xiao 2014 takes it."""
    voltage = np.concatenate([np.zeros(50), np.full(5950, 2.0)])
    return Record('step', DT, voltage, runs.plant(NAME).run(voltage))


def plant() -> Plant:
    """Return the simulated stack with the amplifier range that control needs."""
    return runs.plant(NAME, overrides=AMPLIFIER)


@functools.cache
def identified() -> tuple[Model, Mapping[str, float]]:
    """Return Bouc-Wen, one mode and creep, identified from three triangles."""
    names = ('bouc_wen_exact', 'mode', 'creep', 'offset')
    model = Model('stack', tuple(map(named_block, names)), {'A0': 0.0})
    start = {**model.defaults(), 'A1': 3.5e-7, 'A': 1e-7, 'A0': 0.0, 'beta': 0.03, 'gamma': 0.01,
             'natural_frequency': 350.0, 'damping_ratio': 0.9, 'creep_share': 0.05,
             'creep_time': 0.03}  # fmt: skip
    return model, fit(model, [record(f) for f in (10.0, 40.0, 100.0)], start).values


# Xiao 2014 table 1: frequency, rms and largest error without and with its compensator [µm].
TABLE_1 = (
    (10.0, 4.4810, 5.7825, 1.2084, 1.4428),
    (20.0, 4.8418, 7.0556, 1.5451, 2.6404),
    (30.0, 5.3738, 8.4159, 1.5285, 3.3387),
    (40.0, 5.9573, 9.3596, 1.8950, 4.0637),
    (50.0, 6.5253, 10.0506, 2.3403, 4.1077),
    (60.0, 7.1025, 10.9270, 2.0906, 5.0068),
    (70.0, 7.6944, 11.2938, 2.9550, 5.0886),
    (80.0, 8.3190, 11.8209, 3.5554, 5.5489),
    (90.0, 8.8429, 12.0198, 3.0254, 5.4106),
    (100.0, 9.3656, 11.8839, 3.0701, 5.8218),
)


@functools.cache
def selector_values() -> dict[str, float]:
    """Return Xiao 2014's selector, fitted to ten triangles from rest, displacement to voltage."""
    return selector_table([row_of(record(row[0])) for row in TABLE_1])


@functools.cache
def transfer() -> TransferFunction:
    """Return Xiao 2014's transfer function (4), from one step."""
    return fit_transfer_function([step()], 3, 1)


def reference(frequency: float) -> Waveform:
    """Return Xiao 2014's triangle of 30 µm peak to peak, from rest at 0."""
    return Triangle(15e-6, 2.0, offset=15e-6, frequency=frequency, phase=-0.5 * np.pi)


@functools.cache
def controller() -> HInfinityDesign:
    """Return the controller for what was identified; Xiao 2014 prints no weights."""
    found = transfer()
    linear = transfer_function(found.numerator, found.denominator)
    weights = HInfinityWeights(150.0, peak=2.0, control=0.3)
    return design(linear, weights, DT).require_usable()


def chain(kind: str, selector: Mapping[str, float]) -> list[Link]:
    """Return the chain called `kind` for Xiao 2014's stack."""
    if kind == 'none':
        return [runs.Straight(0.3e-6)]
    if kind.startswith('selector'):
        links: list[Link] = [SlopeSelectedInverse(selector, DT, limits=LIMITS)]
    else:
        model, values = identified()
        links = [inverse_for(model, values, DT, limits=LIMITS, scale=50.0)]
    if kind.endswith('H-infinity'):
        links.append(HInfinity(controller().controller, DT, limits=LIMITS))
    return links


KINDS = ('none', 'selector', 'inverse', 'selector + H-infinity', 'inverse + H-infinity')


def errors(frequency: float, selector: Mapping[str, float]) -> dict[str, tuple[float, float]]:
    """Return rms and largest error by kind of chain, means included [m]."""
    found = {}
    for kind in KINDS:

        def links(kind: str = kind) -> list[Link]:
            return chain(kind, selector)

        result = runs.run(reference(frequency), links, plant(), LIMITS, DT)
        metrics = tracking_metrics(result, 1.2)
        found[kind] = metrics.rms, metrics.largest
    return found
