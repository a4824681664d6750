"""Settings of a law, stated once: a frozen dataclass that makes its parameter table.

A field states default, sentence, unit and range. The checks at construction, the rows of a node's
table, the command-line options and the section of the docstring are derived from it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any, TypeVar

from piezo_hysteresis.common.parameter_table import ParameterSpec, Value

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
