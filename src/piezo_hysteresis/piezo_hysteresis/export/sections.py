"""The links of a chain as sections of one memory: their kernels, packed values and fields.

A section is created from the link in Python; its packed values are the initial ones of the C
library. ``step(point, read, received, s)`` returns the voltage for the next section, ``reset(s)``
resets the state, and ``take(values, limits, s, first)`` sets the values of its fields and the
limits (in the order of `limits_fields`). It returns 0, or the reason of a rejection, in which case
nothing is changed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.compensation.feedback import feedback_link as feedback
from piezo_hysteresis.compensation.feedback.feedback_link import FeedbackLink, reset_link
from piezo_hysteresis.compensation.feedback.pid import (
    PROPORTIONAL,
    FuzzyPid,
    Pid,
    PidGains,
    take_gains,
)
from piezo_hysteresis.compensation.harmonics import harmonic_attenuation as attenuation
from piezo_hysteresis.compensation.harmonics import lines as places
from piezo_hysteresis.compensation.harmonics.harmonic_attenuation import (
    LAWS,
    STEPS,
    HarmonicAttenuation,
    reset_ramp,
)
from piezo_hysteresis.compensation.harmonics.harmonic_rls import GUARD_SIZE, reset_guard
from piezo_hysteresis.compensation.inverses import inverse_link as inverses
from piezo_hysteresis.compensation.inverses.inverse_link import InverseLink
from piezo_hysteresis.compensation.limiter import (
    HIGH,
    LIMITER_SIZE,
    LOW,
    PER_VOLT,
    POWER,
    SHARE,
    STEP,
    VOLTAGE,
    EnergyLimits,
    energy_numbers,
    limit,
    packed_limits,
)
from piezo_hysteresis.compensation.linear_gain import ModeGain
from piezo_hysteresis.compensation.link import (
    CROSS_SIZE,
    Limits,
    begin_cross,
    begin_fade,
    cross_fade,
    reset_cross,
    reset_fade,
    reset_watch,
)
from piezo_hysteresis.export.header import OK, Field, numbers_of, of_table
from piezo_hysteresis.jit import leaf, scratch
from piezo_hysteresis.parameters.links import ATTENUATION, FEEDBACK, FEEDFORWARD

# Duration of the transition of a switched link [s].
_SWITCHING = 0.2

Step = Callable[[FloatArray, FloatArray, float, FloatArray], float]
Reset = Callable[[FloatArray], None]
Take = Callable[[FloatArray, FloatArray, FloatArray, bool], int]


@dataclass(frozen=True)
class Section:
    """A link in the memory of the library."""

    name: str  # name for users
    step: Step
    reset: Reset
    take: Take
    start: FloatArray  # initial content of its part of the memory: the packed values
    fields: tuple[Field, ...]  # settable fields


def limits_fields(limits: Limits, energy: EnergyLimits) -> tuple[Field, ...]:
    """Return the fields of the limits, which every section receives."""
    rows = (
        ('limits.low', limits.low), ('limits.high', limits.high), ('limits.slew', limits.slew),
        ('energy_limit', energy.power), ('capacitance', energy.capacitance),
        ('energy_window', energy.window),
    )  # fmt: skip
    return tuple(of_table(FEEDFORWARD, name, value) for name, value in rows)


def limiter_section(limits: Limits, dt: float) -> Section:
    """Return the limiter, which is always the last section."""
    numbers = packed_limits(limits, dt)
    n = numbers.size

    @leaf
    def step(point: FloatArray, read: FloatArray, received: float, s: FloatArray) -> float:
        return limit(received, s[n : n + LIMITER_SIZE], s[:n])

    @leaf
    def reset(s: FloatArray) -> None:
        for k in range(LIMITER_SIZE):
            s[n + k] = 0.0
        s[n + VOLTAGE] = min(max(0.0, s[LOW]), s[HIGH])

    @leaf
    def take(values: FloatArray, bounds: FloatArray, s: FloatArray, first: bool) -> int:
        s[LOW], s[HIGH], s[STEP], s[POWER] = bounds[0], bounds[1], bounds[2] * dt, bounds[3]
        s[SHARE], s[PER_VOLT] = energy_numbers(bounds[4], bounds[5], bounds[1] - bounds[0], dt)
        return OK

    start = np.concatenate([numbers, np.zeros(LIMITER_SIZE)])
    return Section('limiter', step, reset, take, start, ())


def inverse_section(link: InverseLink, model_fields: Sequence[Field]) -> Section:
    """Return the feedforward; its fields are the parameters of the model, then two times."""
    kernel = inverses.stepping(link.run)
    known = numbers_of(link, [field.name for field in model_fields], link.dt)
    shown = [replace(each, fixed=each.name not in known.live) for each in model_fields]
    settings = link.settings.size
    packed = settings + link.packed.size
    own, fading = packed + inverses.OWN, packed + inverses.FADING
    count, repack, dt, rest = len(shown), known.repack, link.dt, link.initial_memory()
    at_rest, live = not np.any(rest), bool(known.live)
    offset = next((k for k, each in enumerate(shown) if each.name == 'offset'), -1)
    if rest.size == 0:
        rest = np.zeros(1)

    @leaf
    def step(point: FloatArray, read: FloatArray, received: float, s: FloatArray) -> float:
        return kernel(point, received, s[packed:], s[:settings], s[settings:packed])

    @leaf
    def reset(s: FloatArray) -> None:
        for k in range(packed, s.size):
            s[k] = 0.0 if at_rest or k < own else rest[k - own]
        reset_fade(s[fading:own])

    @leaf
    def take(values: FloatArray, bounds: FloatArray, s: FloatArray, first: bool) -> int:
        if live:
            before = scratch(packed)
            for k in range(packed):
                before[k] = s[k]
            code = repack(values, s[settings:packed], s[own:], first)
            if code != OK:
                return code
            if offset >= 0:
                s[inverses.OFFSET] = values[offset]
            moved = before[inverses.OFFSET] != s[inverses.OFFSET]
            for k in range(settings, packed):
                moved = moved or before[k] != s[k]
            if moved and not first:
                begin_fade(s[fading:own])
        s[inverses.EASING] = float(round(values[count] / dt))
        s[inverses.DURATION] = values[count + 1]
        s[inverses.LOW], s[inverses.HIGH], s[inverses.SLEW] = bounds[0], bounds[1], bounds[2]
        return OK

    times = (
        of_table(FEEDFORWARD, 'start', link.settings[inverses.EASING] * dt),
        of_table(FEEDFORWARD, 'transition', link.settings[inverses.DURATION]),
    )
    start = np.concatenate([link.settings, link.packed, np.zeros(link.memory.size)])
    return Section('feedforward', step, reset, take, start, (*shown, *times))


def feedback_section(link: FeedbackLink) -> Section:
    """Return a law on the error; its fields are the gains of a PID, fuzzy or not."""
    kernel, settings = link.kernel, link.settings.size
    packed = settings + link.packed.size
    own = packed + feedback.OWN
    is_pid = isinstance(link, Pid)
    fields = _pid_fields(link) if isinstance(link, Pid) else ()
    count = len(fields)

    @leaf
    def step(point: FloatArray, read: FloatArray, received: float, s: FloatArray) -> float:
        return float(kernel(point, read, received, s[packed:], s[:settings], s[settings:packed]))

    @leaf
    def reset(s: FloatArray) -> None:
        reset_watch(s[packed:])
        reset_link(s[packed:])

    @leaf
    def take(values: FloatArray, bounds: FloatArray, s: FloatArray, first: bool) -> int:
        if is_pid:
            if not first:
                take_gains(s[own:], s[settings + PROPORTIONAL], values[PROPORTIONAL])
            for k in range(count):
                s[settings + k] = values[k]
        s[feedback.LOW], s[feedback.HIGH], s[feedback.SLEW] = bounds[0], bounds[1], bounds[2]
        return OK

    start = np.concatenate([link.settings, link.packed, np.zeros(link.memory.size)])
    return Section('feedback', step, reset, take, start, fields)


def _pid_fields(link: Pid) -> tuple[Field, ...]:
    names = [f'pid.{name}' for name in PidGains.__dataclass_fields__]
    if isinstance(link, FuzzyPid):
        scales = ('error_scale', 'rate_scale', 'proportional_range', 'integral_range')
        names += [f'fuzzy.{name}' for name in scales]
    return tuple(
        of_table(FEEDBACK, name, value)
        for name, value in zip(names, link.packed[: len(names)], strict=True)
    )


#: Settings of the attenuation that can change at run time, and their indices.
_LIVE = {
    'settle': places.SETTLE, 'span': places.SPAN, 'step_size': places.STEP_SIZE,
    'largest_step': places.LARGEST_STEP, 'largest_correction': places.LARGEST,
    'forgetting': places.FORGETTING, 'gain': places.ERROR_GAIN,
    'switch_frequency': places.SWITCH,
}  # fmt: skip
#: Parameters of the mode that can change, and their indices in the packed gain, after its kind.
_GAIN = {
    name: 1 + ModeGain._fields.index(name)
    for name in ('gain', 'natural_frequency', 'damping_ratio')
}


def attenuation_section(link: HarmonicAttenuation) -> Section:
    """Return the attenuation; its fields are its settings, and the plant gain as a mode."""
    method = link.settings.method
    law, kernel = LAWS[method], STEPS[method]
    clear, regain, fading = law.clear, law.regain, law.fading
    first_of = np.cumsum([link.numbers.size, link.packed.size, link.packed_gain.size])
    numbers, packed, gain = (int(place) for place in first_of)
    own = gain + attenuation.OWN
    places_of = np.array(
        [numbers + k for k in _LIVE.values()] + [packed + k for k in _GAIN.values()]
    )
    count, dt = places_of.size, link.dt

    @leaf
    def step(point: FloatArray, read: FloatArray, received: float, s: FloatArray) -> float:
        return kernel(
            point, read, received, s[gain:], s[:numbers], s[numbers:packed], s[packed:gain]
        )

    @leaf
    def reset(s: FloatArray) -> None:
        reset_watch(s[gain:])
        reset_ramp(s[gain:])
        reset_guard(s[gain + attenuation.GUARD : gain + attenuation.GUARD + GUARD_SIZE], fading)
        clear(s[own:], s[numbers:packed], s[packed:gain], dt)

    @leaf
    def take(values: FloatArray, bounds: FloatArray, s: FloatArray, first: bool) -> int:
        for k in range(count):
            s[places_of[k]] = values[k]
        if not first:
            regain(s[own:], s[numbers:packed], s[packed:gain], dt)
        return OK

    start = np.concatenate(
        [link.numbers, link.packed, link.packed_gain, np.zeros(link.memory.size)]
    )
    rows = [(name, link.packed[k], name) for name, k in _LIVE.items()]
    rows += [(f'plant.{name}', link.packed_gain[k], f'plant_{name}') for name, k in _GAIN.items()]
    fields = tuple(
        of_table(ATTENUATION, name, value, f'attenuation_{c_name}') for name, value, c_name in rows
    )
    return Section('attenuation', step, reset, take, start, fields)


def switched(section: Section, dt: float) -> Section:
    """Return a section that can be switched off and on like the laws of the nodes.

    The old share fades into the new one along a smooth step, so that a law that starts has no
    weight. Without a transition, the output is exactly that of the section.
    """
    inner_step, inner_reset, inner_take = section.step, section.reset, section.take
    # whether it is on, then the transition
    head = 1 + CROSS_SIZE

    @leaf
    def step(point: FloatArray, read: FloatArray, received: float, s: FloatArray) -> float:
        given = received
        if s[0] > 0.0:
            given = inner_step(point, read, received, s[head:])
        share = given - received
        if not math.isfinite(share):  # rejected by the limiter, and no start of a later transition
            return given
        faded = cross_fade(share, s[1:head], dt, _SWITCHING)
        return given if faded == share else received + faded

    @leaf
    def reset(s: FloatArray) -> None:
        reset_cross(s[1:head])
        inner_reset(s[head:])

    @leaf
    def take(values: FloatArray, bounds: FloatArray, s: FloatArray, first: bool) -> int:
        on = 1.0 if values[0] >= 0.5 else 0.0
        code = inner_take(values[1:], bounds, s[head:], first)
        if code == OK and on != s[0]:
            s[0] = on
            if not first:
                begin_cross(s[1:head])
                if on > 0.0:
                    inner_reset(s[head:])
        return code

    field = Field(
        f'{section.name}_on', '1', 1.0, 0.0, 1.0, f'1 for {section.name}, 0 for none of it.'
    )
    start = np.concatenate([np.zeros(head), section.start])
    return Section(section.name, step, reset, take, start, (field, *section.fields))
