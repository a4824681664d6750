"""The header of a library: its structs with units and ranges, and its functions."""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass

from jinja2 import Environment, PackageLoader, StrictUndefined

from piezo_hysteresis.export.fields import Component, Field

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
