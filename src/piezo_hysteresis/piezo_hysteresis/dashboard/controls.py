"""Controls of the page, from the parameter descriptors of running nodes."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import TypeAlias

from piezo_hysteresis.reporting.display_units import shown

Value: TypeAlias = bool | int | float | str | list[float] | list[int] | list[str] | list[bool]

# sentence, then the unit in brackets, then the words that are allowed
_DESCRIPTION = re.compile(r'^(?P<sentence>.*?)(?: \[(?P<unit>[^\[\]]+)\])?(?: One of .*)?$', re.S)
_CHOICES = re.compile(r'^one of (.*)$')
# Range of a slider as a multiple of the current value.
_REACH = 3.0
_STEPS = 200


@dataclass(frozen=True)
class ParameterState:
    """One parameter of a running node."""

    node: str
    name: str  # name of the parameter
    value: Value  # current value, in SI units
    sentence: str = ''  # description
    unit: str = ''  # SI unit, '' for none
    low: float = -math.inf
    high: float = math.inf
    choices: tuple[str, ...] = ()  # allowed values, empty for any
    read_only: bool = False  # whether the node rejects every change

    @property
    def group(self) -> str:
        """First part of a dotted name, '' for the others."""
        return self.name.partition('.')[0] if '.' in self.name else ''

    @property
    def is_switch(self) -> bool:
        """Whether it is boolean."""
        return isinstance(self.value, bool)

    @property
    def is_number(self) -> bool:
        """Whether it is a number."""
        return isinstance(self.value, int | float) and not self.is_switch

    @property
    def shown_unit(self) -> str:
        """Displayed unit."""
        return shown(self.unit)[0]

    @property
    def factor(self) -> float:
        """Factor from the SI unit to the displayed one."""
        return shown(self.unit)[1]

    def with_value(self, value: Value) -> ParameterState:
        """Return the parameter with another value."""
        return replace(self, value=value)

    def parse(self, text: str) -> Value:
        """Return the value of an entered text; an invalid text is returned unchanged.

        The node then rejects it with its own reason.
        """
        if not isinstance(self.value, list):
            return text
        items = [item for item in re.split(r'[\s,]+', text.strip('[] ')) if item]
        try:
            if isinstance(next(iter(self.value), 0.0), int) and not any('.' in w for w in items):
                return [int(item) for item in items]
            if not isinstance(next(iter(self.value), 0.0), str):
                return [float(item) for item in items]
        except ValueError:
            pass
        return items


def described(
    node: str,
    name: str,
    value: Value,
    description: str = '',  # [unit]
    constraints: str = '',
    bounds: tuple[float, float] | None = None,
    read_only: bool = False,
) -> ParameterState:
    """Return the parameter of a descriptor."""
    found = _DESCRIPTION.match(description)
    listed = _CHOICES.match(constraints)
    low, high = bounds or (-math.inf, math.inf)
    return ParameterState(
        node,
        name,
        value,
        found['sentence'] if found else description,
        (found['unit'] or '') if found else '',
        low if abs(low) < 1e300 else -math.inf,
        high if abs(high) < 1e300 else math.inf,
        tuple(listed.group(1).split(', ')) if listed else (),
        read_only,
    )


def refusal_text(parameter: ParameterState, reason: str) -> str:
    """Return the reason of a rejected value, in the displayed unit.

    Nodes report it in metres where the page has micrometres, and other nodes without a unit.
    """
    ours = reason.startswith(f'{parameter.name} = ') and ' is outside ' in reason
    if not parameter.is_number or not (ours or 'out of range' in reason):
        return reason
    low, high = (f'{parameter.factor * end:.6g}' for end in (parameter.low, parameter.high))
    return f'{parameter.name} lies between {low} and {high} {parameter.shown_unit}'.rstrip()


@dataclass(frozen=True)
class SliderRange:
    """Range of a slider, in the displayed unit."""

    start: float
    end: float
    step: float

    def nearest(self, value: float) -> float:
        """Return `value` [displayed unit], limited to the range of the slider."""
        return min(max(value, self.start), self.end)


def reach(parameter: ParameterState, siblings: Iterable[ParameterState] = ()) -> SliderRange:
    """Return a useful range of a slider: the allowed one, limited to typical values.

    Ranges such as 0 .. 500 V apply to any actuator and are too wide for a slider. The slider ends
    at a round number above three times the current value, or, if that is zero, of the largest
    parameter of the group with the same unit. The field next to it accepts the whole range.
    """
    assert isinstance(parameter.value, int | float)
    factor = parameter.factor
    low, high = parameter.low * factor, parameter.high * factor
    size = abs(parameter.value) * factor
    if size == 0.0:
        relatives = (
            abs(s.value) * factor
            for s in siblings
            if s.unit == parameter.unit and isinstance(s.value, int | float) and not s.is_switch
        )
        size = max(relatives, default=0.0) or min(abs(high), 1.0) or 1.0
    far = round_up(_REACH * size)
    start, end = max(low, -far if low < 0.0 else 0.0), min(high, far)
    if math.isfinite(high - low) and high - low <= 2.0 * (end - start):
        start, end = low, high
    whole = isinstance(parameter.value, int)
    step = 1.0 if whole else 10.0 ** math.floor(math.log10((end - start) / _STEPS))
    return SliderRange(start, max(end, start + step), step)


def round_up(value: float) -> float:
    """Return the next of 1, 2, 5 times a power of ten."""
    size = 10.0 ** math.floor(math.log10(value))
    return next(k * size for k in (1.0, 2.0, 5.0, 10.0) if k * size >= value * (1 - 1e-9))


# Parameters of the excitation, shown first if their node is running.
DRIVE = (
    ('excitation', 'mode'),
    ('excitation', 'waveform'),
    ('excitation', 'frequency'),
    ('excitation', 'reference.amplitude'),
    ('excitation', 'reference.offset'),
    ('excitation', 'voltage.amplitude'),
    ('excitation', 'voltage.offset'),
    ('feedforward', 'follow_estimate'),
    ('attenuation', 'enabled'),
    ('attenuation', 'orders'),
    ('feedback', 'method'),
)

EFFECTS = 'effects'


def drive_parameters(nodes: Mapping[str, Mapping[str, ParameterState]]) -> list[ParameterState]:
    """Return the parameters of the excitation, of the nodes that are running."""
    return [nodes[node][name] for node, name in DRIVE if name in nodes.get(node, {})]


def effect_parameters(nodes: Mapping[str, Mapping[str, ParameterState]]) -> list[ParameterState]:
    """Return the effect switches of the simulated actuator."""
    return [
        parameter
        for parameters in nodes.values()
        for parameter in parameters.values()
        if parameter.group == EFFECTS and parameter.is_switch
    ]


def groups_of(parameters: Iterable[ParameterState]) -> dict[str, list[ParameterState]]:
    """Return tunable parameters by the first part of their name, those without one first."""
    found: dict[str, list[ParameterState]] = {}
    for parameter in sorted(parameters, key=lambda p: (p.group != '', p.group)):
        if not parameter.read_only and parameter.name != 'use_sim_time':
            found.setdefault(parameter.group, []).append(parameter)
    return found
