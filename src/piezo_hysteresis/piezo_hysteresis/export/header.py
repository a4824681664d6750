"""Header of the C library: the settable fields, with units and ranges of the tables."""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.common.parameter_table import ParameterSpec, ParameterTable
from piezo_hysteresis.compensation.link import OK
from piezo_hysteresis.jit import inline_jit
from piezo_hysteresis.models.chain import Model

# Answers of `set` and `init` too: no state yet; a rejected field is REFUSED - its index.
UNINITIALISED, REFUSED = -2, -100


class Field(NamedTuple):
    """One field of a struct: a parameter under its C name, and its value at export."""

    spec: ParameterSpec
    value: float
    fixed: bool = False  # whether it is a constant in the code, which only a new export changes


def of_table(table: ParameterTable, name: str, value: float, c_name: str = '') -> Field:
    """Return the field of a node's parameter."""
    spec = next(spec for spec in table.specs if spec.name == name)
    return Field(replace(spec, name=c_name or c_identifier(name)), float(value))


def of_model(model: Model, packed: FloatArray, live: Sequence[int]) -> list[Field]:
    """Return the fields of a model's parameters; those that are not `live` are fixed."""
    found = []
    for place, q in enumerate(replace(model, held={}).parameters):
        value = float(packed[place])
        low, high = min(q.low, value), max(q.high, value)
        spec = ParameterSpec(c_identifier(q.name), value, q.description, q.unit, low, high)
        found.append(Field(spec, value, fixed=place not in live))
    return found


def c_identifier(name: str) -> str:
    """Return a name as a C identifier."""
    return re.sub(r'\W', '_', name)


def checking(fields: Sequence[Field]) -> Callable[[FloatArray], int]:
    """Return the kernel ``check(values)``: 0, or the first rejected field."""
    count = len(fields)
    low = np.array(
        [f.value if f.fixed else max(f.spec.low, f.spec.above) for f in fields] or [0.0]
    )
    high = np.array([f.value if f.fixed else f.spec.high for f in fields] or [0.0])
    above = np.array([f.spec.above > f.spec.low and not f.fixed for f in fields] or [False])

    @inline_jit
    def check(values: FloatArray) -> int:
        for k in range(count):
            value = values[k]
            if not (math.isfinite(value) and value >= low[k] and value <= high[k]):
                return REFUSED - k
            if above[k] and value == low[k]:
                return REFUSED - k
        return OK

    return check


class Component(NamedTuple):
    """A state, its functions and its fields."""

    step: Callable[..., int]
    begin: Callable[[FloatArray, FloatArray], int]
    change: Callable[[FloatArray, FloatArray], int]
    reset: Callable[[FloatArray], int]  # ``reset(s)``
    size: int  # size of the state
    fields: tuple[Field, ...]  # settable fields
    rows: tuple[tuple[str, int], ...]  # sections of the state and their sizes


def component(
    step: Callable[..., int],
    judge: Callable[[FloatArray], int],  # returns the reason of a rejection of values
    take: Callable[[FloatArray, FloatArray, bool], int],  # sets values in a state
    reset: Callable[[FloatArray], None],
    start: FloatArray,  # the state before it takes values; its first number is its mark
    mark: float,
    fields: Sequence[Field],
    rows: Sequence[tuple[str, int]],
) -> Component:
    """Return a state with the kernels that initialise, change and reset it."""
    places = np.flatnonzero((start != 0.0) | np.signbit(start))
    numbers, total, size = start[places], places.size, start.size
    if total == 0:
        places, numbers = np.zeros(1, dtype=np.int64), np.zeros(1)

    @inline_jit
    def begin(s: FloatArray, values: FloatArray) -> int:
        s[0] = 0.0
        code = judge(values)
        if code != OK:
            return int(code)
        for k in range(size):
            s[k] = 0.0
        for k in range(total):
            s[places[k]] = numbers[k]
        code = take(values, s, True)
        if code != OK:
            return int(code)
        reset(s)
        s[0] = mark
        return OK

    @inline_jit
    def change(s: FloatArray, values: FloatArray) -> int:
        if s[0] != mark:
            return UNINITIALISED
        code = judge(values)
        if code != OK:
            return int(code)
        return int(take(values, s, False))

    @inline_jit
    def reset_marked(s: FloatArray) -> int:
        if s[0] != mark:
            return UNINITIALISED
        reset(s)
        return OK

    return Component(step, begin, change, reset_marked, size, tuple(fields), tuple(rows))


_ENVIRONMENT = Environment(
    loader=PackageLoader('piezo_hysteresis.export'),
    undefined=StrictUndefined,
    keep_trailing_newline=True,
    autoescape=False,  # no HTML
)


def filled(file: str, **values: object) -> str:
    """Return the text of a template with its values."""
    return _ENVIRONMENT.get_template(file).render(values)


_MAGIC = b'!<arch>\n'


def archive(name: str, code: bytes, symbols: list[str]) -> bytes:
    """Return an archive in the format of ar (SysV), with the symbol table for linkers.

    It is written directly, so that the export needs no compiler.
    """
    names = b''.join(symbol.encode() + b'\0' for symbol in symbols)
    size = 4 + 4 * len(symbols) + len(names)
    first = len(_MAGIC) + 60 + size + size % 2
    table = struct.pack(f'>{1 + len(symbols)}I', len(symbols), *([first] * len(symbols))) + names
    return _MAGIC + _member('/', table) + _member(f'{name}/', code)


def _member(name: str, content: bytes) -> bytes:
    head = f'{name:<16}{0:<12}{0:<6}{0:<6}{"644":<8}{len(content):<10}'.encode() + b'`\n'
    return head + content + b'\n' * (len(content) % 2)


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


def header(
    about: About, chain: Component | None, plant: Component | None, axes: int | None = None
) -> str:
    """Return the text of the header; `axes` is their number for a loop of several."""
    n, whole = about.name, f'{about.name}_plant'
    values = {
        'upper': n.upper(),
        'short_rate': f'{about.rate:.10g}',
        'axes': axes,
        **{key: _harmless(v) for key, v in vars(about).items()},
    }
    parts = [filled('head.h', **values)]
    if chain is not None:
        text = f'What may be set, with {n}_init and between steps with {n}_set.'
        parts += [
            _struct(f'{n}_parameters', text, chain.fields),
            filled('input.h', **values),
            _state(f'{n}_state', chain.rows),
            filled('loop.h' if axes is None else 'coupled.h', **values),
            filled('common.h', **values),
        ]
    if plant is not None:
        text, plain = 'The model as a plant: what may be set.', {**values, 'name': whole}
        parts += [
            _struct(f'{whole}_parameters', text, plant.fields),
            _state(f'{whole}_state', plant.rows),
            filled('plant.h', **plain),
            filled('common.h', **plain),
        ]
    return '\n'.join([*parts, filled('foot.h', **values)])


def _harmless(value: object) -> str:
    """Return a text that cannot end a C comment."""
    return ' '.join(str(value).replace('*/', '* /').split())


def _struct(name: str, text: str, fields: Sequence[Field]) -> str:
    rows = [f'/* {text} */', 'typedef struct {']
    for k, field in enumerate(fields):
        rows.append(f'    double {field.spec.name}; /* {k}: {_words(field)} */')
    return '\n'.join([*rows, f'}} {name};', ''])


def _words(field: Field) -> str:
    spec, text = field.spec, field.spec.description.rstrip('.')
    if field.fixed:
        return f'[{spec.unit}] {text}; only a new export changes it'
    low = max(spec.low, spec.above)
    if math.isinf(low) and math.isinf(spec.high):
        span = 'any number'
    else:
        first = 'above ' if spec.above > spec.low else ''
        span = f'{first}{low:g} .. {spec.high:g}'
    return f'[{spec.unit}] {text}; {span}'


def _state(name: str, rows: Sequence[tuple[str, int]]) -> str:
    lines = [
        '/* Everything that is remembered; place it where you like, copies are independent. */',
        'typedef struct {',
        *(f'    double {row}[{size}];' for row, size in rows if size),
        f'}} {name};',
        '',
    ]
    return '\n'.join(lines)
