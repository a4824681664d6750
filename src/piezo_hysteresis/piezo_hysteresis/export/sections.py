"""The links of a chain as sections of one memory: their kernels, packed values and fields.

A section is created from the link in Python; its packed values are the initial ones of the C
library. ``step(given, received, s)`` returns the voltage for the next section, ``reset(s)``
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
from piezo_hysteresis.common.parameter_table import ParameterSpec
from piezo_hysteresis.compensation.feedback.feedback_link import FeedbackLink
from piezo_hysteresis.compensation.harmonics.harmonic_attenuation import HarmonicAttenuation
from piezo_hysteresis.compensation.inverses.inverse_link import InverseLink
from piezo_hysteresis.compensation.limiter import (
    LIMITER_SIZE,
    EnergyLimits,
    limiter_law,
    packed_limits,
)
from piezo_hysteresis.compensation.link import (
    CROSS_SIZE,
    OK,
    CompiledLaw,
    Limits,
    begin_cross,
    cross_fade,
    reset_cross,
)
from piezo_hysteresis.export.header import Field, c_identifier, of_table
from piezo_hysteresis.jit import inline_jit
from piezo_hysteresis.parameters.links import ATTENUATION, FEEDBACK, FEEDFORWARD

# Duration of the transition of a switched link [s].
_SWITCHING = 0.2

_TABLES = {'feedforward': FEEDFORWARD, 'attenuation': ATTENUATION, 'feedback': FEEDBACK}

Step = Callable[[FloatArray, float, FloatArray], float]
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
    return _section(limiter_law(dt), packed_limits(limits, dt), LIMITER_SIZE)


def section_of(link: HarmonicAttenuation | FeedbackLink) -> Section:
    """Return a link that can change while it runs; its fields are what its law lets change."""
    return _section(link.compiled(), link.numbers, link.memory.size)


def inverse_section(link: InverseLink, model_fields: Sequence[Field]) -> Section:
    """Return the feedforward; its fields are the parameters of the model, then two times."""
    names = [field.spec.name for field in model_fields]
    section = _section(link.compiled(names), link.numbers, link.memory.size)
    shown = [each._replace(fixed=each.spec.name not in link.live) for each in model_fields]
    return replace(section, fields=(*shown, *section.fields))


def _section(law: CompiledLaw, numbers: FloatArray, size: int) -> Section:
    """Return a law with its packed numbers and a memory of a given size."""
    law_step, law_reset, law_take, n = law.step, law.reset, law.take, numbers.size

    @inline_jit
    def step(given: FloatArray, received: float, s: FloatArray) -> float:
        return float(law_step(given, received, s[n:], s[:n]))

    @inline_jit
    def reset(s: FloatArray) -> None:
        law_reset(s[n:], s[:n])

    @inline_jit
    def take(values: FloatArray, bounds: FloatArray, s: FloatArray, first: bool) -> int:
        return int(law_take(values, bounds, s[n:], s[:n], first))

    prefix = 'attenuation_' if law.name == 'attenuation' else ''
    fields = [
        of_table(_TABLES[law.name], name, value, prefix + c_identifier(name))
        for name, value in law.settable
    ]
    start = np.concatenate([numbers, np.zeros(size)])
    return Section(law.name, step, reset, take, start, tuple(fields))


def in_chain(before: Section, behind: Section) -> Section:
    """Return two sections, of which one hands its voltage to the other, as one."""
    first_step, first_reset, first_take = before.step, before.reset, before.take
    last_step, last_reset, last_take = behind.step, behind.reset, behind.take
    n, count = before.start.size, len(before.fields)

    @inline_jit
    def step(given: FloatArray, received: float, s: FloatArray) -> float:
        return last_step(given, first_step(given, received, s[:n]), s[n:])

    @inline_jit
    def reset(s: FloatArray) -> None:
        first_reset(s[:n])
        last_reset(s[n:])

    @inline_jit
    def take(values: FloatArray, bounds: FloatArray, s: FloatArray, first: bool) -> int:
        # only the model can reject values, so it is first
        code = first_take(values[:count], bounds, s[:n], first)
        if code != OK:
            return int(code)
        return int(last_take(values[count:], bounds, s[n:], first))

    start = np.concatenate([before.start, behind.start])
    return Section('chain', step, reset, take, start, (*before.fields, *behind.fields))


def switched(section: Section, dt: float) -> Section:
    """Return a section that can be switched off and on like the laws of the nodes.

    The old share fades into the new one along a smooth step, so that a law that starts has no
    weight. Without a transition, the output is exactly that of the section.
    """
    inner_step, inner_reset, inner_take = section.step, section.reset, section.take
    # whether it is on, then the transition
    head = 1 + CROSS_SIZE

    @inline_jit
    def step(given: FloatArray, received: float, s: FloatArray) -> float:
        answer = received
        if s[0] > 0.0:
            answer = inner_step(given, received, s[head:])
        share = answer - received
        if not math.isfinite(share):  # rejected by the limiter, and no start of a later transition
            return answer
        faded = cross_fade(share, s[1:head], dt, _SWITCHING)
        return answer if faded == share else received + faded

    @inline_jit
    def reset(s: FloatArray) -> None:
        reset_cross(s[1:head])
        inner_reset(s[head:])

    @inline_jit
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

    text = f'1 for {section.name}, 0 for none of it.'
    field = Field(ParameterSpec(f'{section.name}_on', 1.0, text, '1', 0.0, 1.0), 1.0)
    start = np.concatenate([np.zeros(head), section.start])
    return Section(section.name, step, reset, take, start, (field, *section.fields))
