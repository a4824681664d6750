"""One table states every parameter of a node; declaration, checks and documents come from it.

It does not depend on ROS, so that parameter files are checked without starting a node.
"""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite
from typing import Any, TypeAlias, TypeVar

from piezo_hysteresis.common.wording import near


def range_refusal(low: float | None, high: float | None) -> str:
    """Return '' if `low` .. `high` [V] is a range or neither is given, else the error."""
    if low is None and high is None:
        return ''
    if low is None or high is None:
        missing = 'lowest' if low is None else 'highest'
        return f'the {missing} voltage is not given: give both voltage limits, or neither'
    if not (isfinite(low) and isfinite(high)):
        return f'the voltage limits {low:g} .. {high:g} V are not finite: give two numbers in V'
    if not low < high:
        return (
            f'the voltage limits are empty: low = {low:g} V is not below high = {high:g} V; '
            'exchange or widen them'
        )
    return ''


Value: TypeAlias = bool | int | float | str | list[float] | list[int] | list[str]
Rule: TypeAlias = Callable[[Mapping[str, Value]], str]

EXPONENT = re.compile(r'[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+')
LIST = re.compile(r'\[[^\[\]]*\]')


@dataclass(frozen=True)
class ParameterSpec:
    """One parameter of a node."""

    name: str  # full name; dots group
    default: Value  # also fixes the type
    description: str  # one sentence
    unit: str = ''  # SI unit, ``1`` for dimensionless numbers, '' for other types
    low: float = -math.inf
    high: float = math.inf
    above: float = -math.inf  # the value must be strictly larger than this
    choices: tuple[str, ...] = ()  # permitted texts; empty for any
    read_only: bool = False  # whether the value is fixed while the node runs
    from_model: bool = False  # whether the model file of the node sets it at the start

    def coerce(self, value: object) -> object:
        """Return `value` with numbers that are meant as floats converted.

        These are integers, and ``5e-05`` or ``1.4e5``, which are texts in YAML 1.1 for want of a
        decimal point or a sign: ``ros2 param set`` and ``ros2 param load`` pass them as they are.
        """
        if isinstance(self.default, float):
            return _as_float(value)
        if isinstance(self.default, list):
            return self._coerce_list(value)
        return value

    def _coerce_list(self, value: object) -> object:
        """Return the intended list: ``ros2 param set`` sends ``[1, 2.5]`` as a text."""
        if isinstance(value, str) and LIST.fullmatch(value.strip()) and self.element is not str:
            items = value.strip()[1:-1].split(',')
            try:
                found = [_number(item) for item in items if item.strip()]
            except ValueError:
                return value
            if self.element is int and any(type(each) is float for each in found):
                return value
            value = found
        if self.element is float and _is_list(value):
            return [_as_float(each) for each in value]  # type: ignore[attr-defined]
        return value

    @property
    def element(self) -> type:
        """Type of the list elements."""
        assert isinstance(self.default, list)
        return type(self.default[0]) if self.default else float

    def judge(self, value: object) -> str:
        """Return '' if `value` is allowed, else the reason and the permitted values."""
        if isinstance(self.default, list):
            if not _is_list(value):
                return f'{self.name} must be a list of {self.element.__name__}, got {value!r}'
            reasons = (self._judge_one(v, self.element) for v in value)  # type: ignore[attr-defined]
            return next((reason for reason in reasons if reason), '')
        return self._judge_one(value, type(self.default))

    def _judge_one(self, value: object, kind: type) -> str:
        if type(value) is not kind:
            return (
                f'{self.name} must be of type {kind.__name__}, got {value!r}; '
                f'{"write for example " + repr(self.default)}'
            )
        if isinstance(value, str):
            if self.choices and value not in self.choices:
                known = ', '.join(self.choices)
                guess = near(value, self.choices)
                return f'{self.name} must be one of {known}, got {value!r}{guess}'
            return ''
        if isinstance(value, bool):
            return ''
        assert isinstance(value, int | float)
        if not math.isfinite(value):
            return f'{self.name} must be a finite number, got {value}'
        if not (self.low <= value <= self.high and value > self.above):
            what = 'its range, ' if math.isfinite(self.above) else ''  # not "outside above"
            given = f'{self.name} = {value:g}{self._unit_text}'
            return f'{given} is outside {what}{self.range_text()}'
        return ''

    def range_text(self) -> str:
        """Return the range as text."""
        if math.isfinite(self.above):
            low = f'above {self.above:g}'
        else:
            low = f'{self.low:g}' if math.isfinite(self.low) else 'any'
        high = f'{self.high:g}' if math.isfinite(self.high) else 'any'
        return f'{low} .. {high}{self._unit_text}'

    @property
    def _unit_text(self) -> str:
        """Unit suffix of a number; empty if it is 1."""
        return f' {self.unit}' if self.unit not in ('', '1') else ''


def _as_float(value: object) -> object:
    """Return the intended float of an integer or of a text such as ``5e-05``, else the value."""
    if type(value) is int or (isinstance(value, str) and EXPONENT.fullmatch(value)):
        return float(value)
    return value


def _number(text: str) -> int | float:
    try:
        return int(text)
    except ValueError:
        return float(text)


def _is_list(value: object) -> bool:
    return isinstance(value, Sequence | Iterable) and not isinstance(value, str | bytes | Mapping)


@dataclass(frozen=True)
class ParameterTable:
    """Every parameter of a node, and the rules that bind several of them."""

    specs: tuple[ParameterSpec, ...]  # one row per parameter
    rules: tuple[Rule, ...] = field(default=())  # each takes all values

    def __post_init__(self) -> None:
        names = [spec.name for spec in self.specs]
        double = {name for name in names if names.count(name) > 1}
        if double:
            raise ValueError(f'parameters stated twice: {sorted(double)}')

    def spec(self, name: str) -> ParameterSpec | None:
        """Return the row of `name`, or None."""
        return next((spec for spec in self.specs if spec.name == name), None)

    def defaults(self) -> dict[str, Value]:
        """Return every parameter at its default."""
        return {spec.name: spec.default for spec in self.specs}

    def judge(self, current: Mapping[str, Value], changes: Mapping[str, object]) -> str:
        """Return '' if `changes` of `current` are allowed, else the reason."""
        merged: dict[str, Value] = dict(current)
        for name, value in changes.items():
            spec = self.spec(name)
            if spec is None:
                continue  # parameters that ROS itself declares
            reason = spec.judge(value)
            if reason:
                return reason
            merged[name] = value  # type: ignore[assignment]
        return next((reason for rule in self.rules if (reason := rule(merged))), '')

    def markdown(self) -> str:
        """Return the reference table of the parameters."""
        lines = [
            '| parameter | default | range | changes while running | what it is |',
            '|---|---|---|---|---|',
        ]
        for spec in self.specs:
            allowed = ', '.join(spec.choices) if spec.choices else spec.range_text()
            if not spec.choices and not isinstance(spec.default, int | float | list):
                allowed = ''
            if isinstance(spec.default, bool):
                allowed = 'true, false'
            lines.append(
                f'| `{spec.name}` | `{spec.default}` | {allowed} | '
                f'{"no" if spec.read_only else "yes"} | {spec.description} |'
            )
        return '\n'.join(lines)


Kind = TypeVar('Kind')

_SPEC = 'spec'


def setting(default: object, description: str, unit: str = '', **bounds: Any) -> Any:
    """Return the field of a dataclass for one setting."""
    value: Value = list(default) if isinstance(default, tuple) else default  # type: ignore[assignment]
    spec = ParameterSpec('', value, description, unit, **bounds)
    return dataclasses.field(default=default, metadata={_SPEC: spec})


def specs_of(kind: Any, prefix: str = '') -> tuple[ParameterSpec, ...]:
    """Return the rows of a parameter table for the settings of `kind`, named with `prefix`."""
    return tuple(
        dataclasses.replace(field.metadata[_SPEC], name=prefix + field.name)
        for field in dataclasses.fields(kind)
        if _SPEC in field.metadata
    )


def judge(settings: Any) -> str:
    """Return '' if every setting is within its range, else the first reason."""
    for spec in specs_of(settings):
        value = getattr(settings, spec.name)
        reason = spec.judge(spec.coerce(list(value) if isinstance(value, tuple) else value))
        if reason:
            return reason
    return ''


def rule_of(
    kind: Callable[..., object], error: type[Exception], prefix: str = ''
) -> Callable[[Any], str]:
    """Return a rule of a table: '' where `kind` takes the values together, else why not."""
    names = [spec.name for spec in specs_of(kind)]

    def rule(values: Any) -> str:
        chosen = {name: values[prefix + name] for name in names}
        try:
            kind(**{k: tuple(v) if isinstance(v, list) else v for k, v in chosen.items()})
        except error as refused:
            return str(refused)
        return ''

    return rule


def documented(kind: type[Kind]) -> type[Kind]:
    """Give the docstring of `kind` the section that lists its settings."""
    lines = [(kind.__doc__ or '').rstrip(), '', '    Attributes', '    ----------']
    for spec in specs_of(kind):
        what = ', '.join(map(repr, spec.choices))
        types: dict[type, str] = {list: 'tuple of int', str: f'{{{what}}}' if what else 'str'}
        unit = f' [{spec.unit}]' if spec.unit else ''
        name = types.get(type(spec.default), type(spec.default).__name__)
        lines += [f'    {spec.name} : {name}', f'        {spec.description.rstrip(".")}{unit}.']
    kind.__doc__ = '\n'.join(lines) + '\n    '
    return kind
