"""Sections of links that fewer people ask for: two inverses by frequency, repetitive control."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.compensation.harmonics import repetitive
from piezo_hysteresis.compensation.harmonics.repetitive import OddRepetitive, forget_repetitive
from piezo_hysteresis.compensation.inverses import frequency_switch as switch
from piezo_hysteresis.compensation.inverses.frequency_switch import FrequencySwitch
from piezo_hysteresis.compensation.sensor_guard import FREQUENCY, forget_watch
from piezo_hysteresis.export.fields import OK, Field
from piezo_hysteresis.export.sections import Section, inverse_section
from piezo_hysteresis.jit import leaf, scratch

# Fields behind the parameters of an inverse's model: how long its start and a change take.
_TIMES = 2


def frequency_section(
    link: FrequencySwitch, slow_fields: Sequence[Field], fast_fields: Sequence[Field]
) -> Section:
    """Return two inverses and what chooses between them.

    Its fields are those of the fast one, which have the times of both, the parameters of the slow
    model, and the frequency that divides them.
    """
    slow, fast = inverse_section(link.slow, slow_fields), inverse_section(link.fast, fast_fields)
    settings = link.settings.size
    own = settings + switch.SWITCH_SIZE
    middle = own + slow.start.size
    fast_count, slow_count = len(fast.fields), len(slow.fields) - _TIMES
    times, size = fast_count - _TIMES, middle - own
    step_slow, step_fast = slow.step, fast.step
    reset_slow, reset_fast, take_slow, take_fast = slow.reset, fast.reset, slow.take, fast.take
    choose, forget = switch.choose, switch.forget_switch

    @leaf
    def step(point: FloatArray, read: FloatArray, received: float, s: FloatArray) -> float:
        slow_voltage = step_slow(point, read, received, s[own:middle])
        fast_voltage = step_fast(point, read, received, s[middle:])
        return choose(
            slow_voltage, fast_voltage, received, point[FREQUENCY], s[settings:own], s[:settings]
        )

    @leaf
    def reset(s: FloatArray) -> None:
        forget(s[settings:own])
        reset_slow(s[own:middle])
        reset_fast(s[middle:])

    @leaf
    def take(values: FloatArray, bounds: FloatArray, s: FloatArray, first: bool) -> int:
        of_slow, changed = scratch(slow_count + _TIMES), scratch(size)
        for k in range(slow_count):
            of_slow[k] = values[fast_count + k]
        for k in range(_TIMES):
            of_slow[slow_count + k] = values[times + k]
        for k in range(size):
            changed[k] = s[own + k]
        code = take_slow(of_slow, bounds, changed, first)
        if code == OK:
            code = take_fast(values[:fast_count], bounds, s[middle:], first)
        if code != OK:
            return int(code)
        for k in range(size):
            s[own + k] = changed[k]
        s[switch.BORDER] = values[fast_count + slow_count]
        s[switch.DURATION], s[switch.SLEW] = values[times + 1], bounds[2]
        return OK

    renamed = [replace(field, name=f'slow_{field.name}') for field in slow.fields[:slow_count]]
    border = Field(
        'switch_frequency', 'Hz', float(link.settings[switch.BORDER]), 0.0, 1e5,
        'Fundamental of the reference up to which the slow model is inverted.', above=True,
    )  # fmt: skip
    start = np.concatenate([link.settings, np.zeros(switch.SWITCH_SIZE), slow.start, fast.start])
    return Section('feedforward', step, reset, take, start, (*fast.fields, *renamed, border))


def repetitive_section(link: OddRepetitive) -> Section:
    """Return repetitive control; what it knows of the plant is worked into its numbers."""
    repeat, n = repetitive.repeat, link.numbers.size

    @leaf
    def step(point: FloatArray, read: FloatArray, received: float, s: FloatArray) -> float:
        return repeat(point, read, received, s[n:], s[:n])

    @leaf
    def reset(s: FloatArray) -> None:
        forget_watch(s[n:])
        forget_repetitive(s[n:])

    @leaf
    def take(values: FloatArray, bounds: FloatArray, s: FloatArray, first: bool) -> int:
        s[repetitive.LEARNING], s[repetitive.LEAD] = values[0], values[1]
        return OK

    fields = (
        Field(
            'attenuation_learning', '1', float(link.numbers[repetitive.LEARNING]), 0.0, 1.0,
            'Share of the error that half a period removes.', above=True,
        ),
        Field(
            'attenuation_lead_ticks', '1', float(link.numbers[repetitive.LEAD]), 0.0, 1e4,
            'Steps by which the learning looks ahead.',
        ),
    )  # fmt: skip
    start = np.concatenate([link.numbers, np.zeros(link.memory.size)])
    return Section('attenuation', step, reset, take, start, fields)
