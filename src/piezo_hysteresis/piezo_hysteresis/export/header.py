"""Header of the C library: the settable fields, with units and ranges of the tables."""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.common.parameter_table import ParameterTable
from piezo_hysteresis.compensation.inverses import hysteresis_inverse as hysteresis
from piezo_hysteresis.compensation.inverses.block_inverse import mode_coefficients
from piezo_hysteresis.compensation.inverses.inverse_link import InverseLink
from piezo_hysteresis.compensation.inverses.physical import (
    BOUC_WEN,
    FIRST,
    K1,
    K2,
    LEAD,
    MINIMUM,
    PLAYS,
    ExtendedInverse,
    PhysicalInverse,
    monotonic_bouc_wen,
    monotonic_plays,
    saturation,
)
from piezo_hysteresis.compensation.inverses.physical import NAMES as EXTENDED
from piezo_hysteresis.jit import leaf, scratch
from piezo_hysteresis.models.chain import Model

# Return values of `set` and `init`; a rejected field is returned as REFUSED - its index.
OK, UNINITIALISED, IMPOSSIBLE, REFUSED = 0, -2, -3, -100


@dataclass(frozen=True)
class Field:
    """One field of a struct."""

    name: str  # its C name
    unit: str  # SI unit, ``1`` if there is none
    value: float  # value at export
    low: float
    high: float
    text: str  # one sentence
    above: bool = False  # whether `low` itself is out of range
    fixed: bool = False  # whether it is a constant in the code, which only a new export changes


def of_table(table: ParameterTable, name: str, value: float, c_name: str = '') -> Field:
    """Return the field of a node's parameter."""
    spec = next(spec for spec in table.specs if spec.name == name)
    above = spec.above > spec.low
    low = spec.above if above else spec.low
    return Field(
        c_name or c_identifier(name),
        spec.unit,
        float(value),
        low,
        spec.high,
        spec.description,
        above,
    )


def of_model(model: Model, packed: FloatArray, live: Sequence[int]) -> list[Field]:
    """Return the fields of a model's parameters; those that are not `live` are fixed."""
    return [
        Field(
            c_identifier(q.name), q.unit, float(value), min(q.low, float(value)),
            max(q.high, float(value)), q.description, fixed=place not in live,
        )
        for place, (q, value) in enumerate(
            zip(replace(model, held={}).parameters, packed, strict=True)
        )
    ]  # fmt: skip


def c_identifier(name: str) -> str:
    """Return a name as a C identifier."""
    return re.sub(r'\W', '_', name)


def checking(fields: Sequence[Field]) -> Callable[[FloatArray], int]:
    """Return the kernel ``check(values)``: 0, or the first rejected field."""
    count = len(fields)
    low = np.array([f.value if f.fixed else f.low for f in fields] or [0.0])
    high = np.array([f.value if f.fixed else f.high for f in fields] or [0.0])
    above = np.array([f.above and not f.fixed for f in fields] or [False])

    @leaf
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


#: ``repack(values, p, own, first)``: fills the packed values `p` from the parameters of the model
#: and converts the memory `own` unless `first`; returns 0 or the reason of a rejection.
Repack = Callable[[FloatArray, FloatArray, FloatArray, bool], int]

_MODE, _MASS, _RIGID = range(3)


class Numbers(NamedTuple):
    """Packed values of an inverse as a function of parameters."""

    repack: Repack  # see `Repack`
    live: tuple[str, ...]  # parameters that can change; the others are constants in the code


def numbers_of(link: InverseLink, names: Sequence[str], dt: float) -> Numbers:
    """Return the packed values of `link` as a function of parameters in the order of `names`."""
    place = {name: k for k, name in enumerate(names)}
    if isinstance(link, PhysicalInverse) and link.law != 'gain':
        return _physical(link.law, place, dt)
    if isinstance(link, ExtendedInverse):
        return _extended(place)
    return Numbers(_nothing, ())


@leaf
def _nothing(values: FloatArray, p: FloatArray, own: FloatArray, first: bool) -> int:
    return OK


def _physical(law: str, place: Mapping[str, int], dt: float) -> Numbers:
    plays = law == 'plays'
    known = tuple(name for name in (PLAYS if plays else BOUC_WEN) if name in place)
    at = tuple(place.get(name, -1) for name in (PLAYS if plays else BOUC_WEN))
    delay = place.get('delay', -1)
    if 'mass' in place:
        kind, structure = _MASS, tuple(place[n] for n in ('mass', 'damping', 'stiffness'))
    elif 'natural_frequency' in place:
        kind, structure = _MODE, (place['natural_frequency'], place['damping_ratio'], 0)
    else:
        kind, structure = _RIGID, (0, 0, 0)
    count, solved, slope = len(at), law != 'delayed', 1 if plays else 0

    @leaf
    def repack(values: FloatArray, p: FloatArray, own: FloatArray, first: bool) -> int:
        new, k1, k2 = scratch(count), 0.0, 0.0
        for k in range(count):
            new[k] = values[at[k]] if at[k] >= 0 else 0.0
        if kind == _MODE:
            k1, k2 = mode_coefficients(values[structure[0]], values[structure[1]])
        elif kind == _MASS:
            stiffness = values[structure[2]]
            k1, k2 = values[structure[1]] / stiffness, values[structure[0]] / stiffness
        if not (k1 >= 0.0 and k2 >= 0.0):
            return IMPOSSIBLE
        if plays and not monotonic_plays(new):
            return IMPOSSIBLE
        if not first and new[slope] * p[FIRST + slope] < 0.0:
            return IMPOSSIBLE
        inner, shift = (new[1], new[2]) if solved else (0.0, 0.0)
        if not plays and not monotonic_bouc_wen(new[0], inner, shift):
            return IMPOSSIBLE
        if not (plays or first):
            own[hysteresis.H] *= saturation(new) / max(saturation(p[FIRST:]), 1e-300)
        lead = 0.5 * dt if k2 > 0.0 else 0.0
        p[MINIMUM] = 0.1 * abs(new[slope])
        p[K1], p[K2] = k1, k2
        p[LEAD] = lead + (values[delay] if delay >= 0 else 0.0)
        for k in range(count):
            p[FIRST + k] = new[k]
        return OK

    names = (
        'natural_frequency',
        'damping_ratio',
        'mass',
        'damping',
        'stiffness',
        'delay',
        'offset',
    )
    return Numbers(repack, (*known, *(name for name in names if name in place)))


def _extended(place: Mapping[str, int]) -> Numbers:
    at = tuple(place.get(name, -1) for name in EXTENDED)
    count = len(EXTENDED)

    @leaf
    def repack(values: FloatArray, p: FloatArray, own: FloatArray, first: bool) -> int:
        new = scratch(count)
        for k in range(count):
            new[k] = values[at[k]] if at[k] >= 0 else 0.0
        if new[0] == 0.0 or (not first and new[0] * p[0] < 0.0):
            return IMPOSSIBLE
        if not first:
            own[hysteresis.H] *= saturation(new) / max(saturation(p), 1e-300)
        for k in range(count):
            p[k] = new[k]
        p[count] = 0.1 * abs(new[0])
        return OK

    return Numbers(repack, tuple(name for name in (*EXTENDED, 'offset') if name in place))


_ENVIRONMENT = Environment(
    loader=PackageLoader('piezo_hysteresis.export'),
    undefined=StrictUndefined,
    keep_trailing_newline=True,
    autoescape=False,  # no HTML
)


def filled(file: str, **values: object) -> str:
    """Return the text of a template with its values."""
    return _ENVIRONMENT.get_template(file).render(values)


@dataclass(frozen=True)
class Drive:
    """The reference of the example and of the vectors."""

    frequency: float  # frequency [Hz]
    amplitude: float  # [m]
    middle: float  # centre [m]
    gain: float  # displacement per volt without compensation [m/V]
    centre: float  # voltage in the middle of its range [V]


def example(name: str, drive: Drive, links: tuple[str, ...], moved: tuple[str, ...]) -> str:
    """Return the example: track a sine without, with feedforward, and with everything."""
    off = ''.join(f'        p.{link}_on = everything;\n' for link in links)
    moves = ''.join(
        f'    plant.{field} *= {1.0 + 0.002 * (-1) ** k!r};\n' for k, field in enumerate(moved)
    )
    return filled('example.c', name=name, drive=drive, links=links, off=off, moves=moves)


def selftest(name: str, stroke: float) -> str:
    """Return the self-test: test vectors, and the limits for any input."""
    return filled('selftest.c', name=name, stroke=stroke)


def plant_test(name: str, stroke: float) -> str:
    """Return the self-test of a plant alone."""
    return filled('plant_selftest.c', name=name, stroke=stroke)


def bench(name: str, drive: Drive) -> str:
    """Return the benchmark: time of single steps, and a real-time loop."""
    return filled('bench.c', name=name, drive=drive)


def makefile(name: str, with_loop: bool) -> str:
    """Return the Makefile of example, self-test and benchmark; for a plant only the test."""
    return filled('Makefile.txt', name=name, programs=_programs(with_loop))


def cmake(name: str, version: str, with_loop: bool) -> str:
    """Return the CMakeLists.txt."""
    return filled('CMakeLists.txt', name=name, version=version, programs=_programs(with_loop))


def _programs(with_loop: bool) -> str:
    return 'example selftest bench' if with_loop else 'selftest'


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


def coupled_header(about: About, chain: Component, axes: int) -> str:
    """Return the text of the header of a loop of several axes."""
    n = about.name
    values = {
        'upper': n.upper(),
        'short_rate': f'{about.rate:.10g}',
        **{key: _harmless(v) for key, v in vars(about).items()},
    }
    known = filled('input.h', **values).partition('\n')[2]
    text = f'What may be set, with {n}_init and between steps with {n}_set.'
    return '\n'.join([
        filled('head.h', **values),
        _struct(f'{n}_parameters', text, chain.fields),
        _state(f'{n}_state', chain.rows),
        filled('coupled.h', **values, axes=axes, input=known),
        filled('common.h', **values),
        filled('foot.h', **values),
    ])  # fmt: skip


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
