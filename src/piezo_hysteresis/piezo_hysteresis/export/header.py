"""The header of a library: its structs with units and ranges, and its functions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from piezo_hysteresis.export.fields import Component, Field
from piezo_hysteresis.export.programs import filled


@dataclass(frozen=True)
class About:
    """Description of a library for its header."""

    name: str  # name of the library, and prefix of every name in it
    model: str  # name of the model
    chain: str
    fingerprint: str  # fingerprint of the model file
    version: str  # version of the suite
    rate: float  # sampling rate [Hz]
    target: str  # target machine
    links: str  # description of the links


def header(about: About, chain: Component | None, plant: Component) -> str:
    """Return the text of the header."""
    n, whole = about.name, f'{about.name}_plant'
    values = {
        'upper': n.upper(),
        'short_rate': f'{about.rate:.10g}',
        **{key: _harmless(v) for key, v in vars(about).items()},
    }
    parts = [filled('head.h', **values)]
    if chain is not None:
        text = f'What may be set, with {n}_init and between steps with {n}_set.'
        parts += [
            _struct(f'{n}_parameters', text, chain.fields),
            filled('input.h', **values),
            _state(f'{n}_state', chain.rows),
            filled('loop.h', **values),
            filled('common.h', **values),
        ]
    plain = {**values, 'name': whole}
    parts += [
        _struct(f'{whole}_parameters', 'The model as a plant: what may be set.', plant.fields),
        _state(f'{whole}_state', plant.rows),
        filled('plant.h', **plain),
        filled('common.h', **plain),
        filled('foot.h', **values),
    ]
    return '\n'.join(parts)


def _harmless(value: object) -> str:
    """Return a text that cannot end a C comment."""
    return ' '.join(str(value).replace('*/', '* /').split())


def _struct(name: str, text: str, fields: Sequence[Field]) -> str:
    rows = [f'/* {text} */', 'typedef struct {']
    for k, field in enumerate(fields):
        rows.append(f'    double {field.name}; /* {k}: {_words(field)} */')
    return '\n'.join([*rows, f'}} {name};', ''])


def _words(field: Field) -> str:
    text = field.text.rstrip('.')
    if field.fixed:
        return f'[{field.unit}] {text}; only a new export changes it'
    if math.isinf(field.low) and math.isinf(field.high):
        span = 'any number'
    else:
        first = 'above ' if field.above else ''
        span = f'{first}{field.low:g} .. {field.high:g}'
    return f'[{field.unit}] {text}; {span}'


def _state(name: str, rows: Sequence[tuple[str, int]]) -> str:
    lines = [
        '/* Everything that is remembered; place it where you like, copies are independent. */',
        'typedef struct {',
        *(f'    double {row}[{size}];' for row, size in rows if size),
        f'}} {name};',
        '',
    ]
    return '\n'.join(lines)
