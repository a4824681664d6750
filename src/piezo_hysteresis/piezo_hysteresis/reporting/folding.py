"""Parameters of many equal elements on one line, ``fine_memory1 .. 39``, and as a figure."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from piezo_hysteresis.common.wording import counted
from piezo_hysteresis.reporting.display_units import shown, with_deviation
from piezo_hysteresis.reporting.page import Plot
from piezo_hysteresis.reporting.plots import PALETTE, new_axes

# Number of elements from which they are combined.
FEWEST = 6
# Number of values equal to zero within their standard deviations from which they are combined.
_FEWEST_ZEROS = 2
_NUMBERED = re.compile(r'^(.*?)(\d+)$')


@dataclass(frozen=True)
class Value:
    """One reported parameter."""

    name: str  # name of the parameter
    value: float  # in SI units
    std: float | None  # standard deviation; None if the parameter is fixed or the value unknown
    unit: str  # SI unit


def groups_of(values: Iterable[Value]) -> list[list[Value]]:
    """Return the values grouped by the kind of element; all others are separate."""
    found: list[list[Value]] = []
    for value in values:
        same = bool(found and _stem(value)) and (
            (_stem(found[-1][0]), found[-1][0].unit) == (_stem(value), value.unit)
        )
        if same:
            found[-1].append(value)
        else:
            found.append([value])
    return [
        part
        for group in found
        for part in ([group] if len(group) >= FEWEST else [[each] for each in group])
    ]


def folded(values: Iterable[Value]) -> list[tuple[str, str, str]]:
    """Return name, value with deviation and unit of each parameter, equal elements combined."""
    groups = groups_of(values)
    nothing = [g[0].name for g in groups if len(g) == 1 and _is_nothing(g[0])]
    if len(nothing) < _FEWEST_ZEROS:
        return [_line(group) for group in groups]
    lines = [_line(g) for g in groups if len(g) > 1 or g[0].name not in nothing]
    return [*lines, (', '.join(nothing), '0 within one deviation', '')]


def _is_nothing(value: Value) -> bool:
    return value.std is not None and abs(value.value) < value.std < np.inf


def _line(group: Sequence[Value]) -> tuple[str, str, str]:
    shown_unit, factor = shown(group[0].unit)
    if len(group) == 1:
        value = group[0]
        std = None if value.std is None else abs(factor) * value.std
        number, deviation = with_deviation(factor * value.value, std)
        if deviation == 'not determined':
            return value.name, deviation, ''
        text = f'{number} ± {deviation}' if _is_number(deviation) else number
        return value.name, text, shown_unit
    sizes = np.array([factor * value.value for value in group])
    largest = int(np.argmax(np.abs(sizes)))
    text = (
        f'{counted(len(group), "value")}, the largest {group[largest].name}, sum '
        f'{sizes.sum():.3g}, {sizes.min():.3g} .. {sizes.max():.3g}'
    )
    return f'{group[0].name} .. {_number(group[-1])}', text, shown_unit


def weights_figures(values: Iterable[Value]) -> tuple[Plot, ...]:
    """Draw the values of each kind of element over their number, with standard deviations."""
    return tuple(_weights(group) for group in groups_of(values) if len(group) > 1)


def _weights(group: Sequence[Value]) -> Plot:
    shown_unit, factor = shown(group[0].unit)
    stem = _stem(group[0]) or group[0].name
    unit = f' [{shown_unit}]' if shown_unit else ''
    plot = new_axes(f'Elements of {stem}', 'number of the element', f'value{unit}')
    x = [_number(value) for value in group]
    y = [factor * value.value for value in group]
    spread = [abs(factor) * (value.std or 0.0) for value in group]
    source = {
        'x': x,
        'y': y,
        'low': [a - b for a, b in zip(y, spread, strict=True)],
        'high': [a + b for a, b in zip(y, spread, strict=True)],
    }
    plot.vbar('x', top='y', width=0.7, source=source, fill_color=PALETTE[0], line_color=None)
    plot.segment('x', 'low', 'x', 'high', source=source, line_color='#000000')
    caption = 'One bar per element, with one standard deviation. All numbers are in model.yaml.'
    return Plot(plot, caption)


def values_of(
    numbers: Mapping[str, float], std: Mapping[str, float], units: Mapping[str, str]
) -> list[Value]:
    """Return the reported parameters, in their order."""
    return [Value(name, value, std.get(name), units[name]) for name, value in numbers.items()]


def _stem(value: Value) -> str:
    match = _NUMBERED.match(value.name)
    return match.group(1) if match else ''


def _number(value: Value) -> int:
    match = _NUMBERED.match(value.name)
    return int(match.group(2)) if match else 0


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
