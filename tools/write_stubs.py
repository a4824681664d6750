"""Write type stubs of the interface files.

    python tools/write_stubs.py [--check]

tools/stubs/ defines for mypy the messages, services and actions of this workspace, and of
those standard packages that it uses, as the generated Python classes give and take them. With
--check nothing is written; the exit code is 1 where a stub is out of date.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from rosidl_adapter.parser import (
    MessageSpecification,
    Type,
    parse_action_file,
    parse_message_file,
    parse_service_file,
)

ROOT = Path(__file__).resolve().parents[1]
OWN = ROOT / 'src' / 'piezo_interfaces'
STUBS = ROOT / 'tools' / 'stubs'
STANDARD = (
    *('action_msgs', 'builtin_interfaces', 'diagnostic_msgs', 'lifecycle_msgs', 'rcl_interfaces'),
    *('rosgraph_msgs', 'std_msgs', 'std_srvs', 'unique_identifier_msgs'),
)
IMPORTS = {
    'array': 'from array import array',
    'Sequence': 'from collections.abc import Sequence',
    'ClassVar': 'from typing import ClassVar',
    'numpy': 'import numpy',
    'NDArray': 'from numpy.typing import NDArray',
}
PLAIN = {'bool': 'bool', 'byte': 'bytes', 'string': 'str', 'wstring': 'str'}
HEAD = '# Written by tools/write_stubs.py from the interface files.\n'


def stubs() -> dict[Path, str]:
    """Return the text of each stub."""
    texts = {}
    for package in (OWN.name, *STANDARD):
        share = OWN if package == OWN.name else Path(get_package_share_directory(package))
        texts[STUBS / package / '__init__.pyi'] = HEAD
        for kind in ('msg', 'srv', 'action'):
            if files := sorted((share / kind).glob(f'*.{kind}')):
                lines = [line for file in files for line in _interface(package, kind, file)]
                texts[STUBS / package / f'{kind}.pyi'] = _module('\n'.join(lines))
    return texts


def _module(body: str) -> str:
    words = set(re.findall(r'\w+', body))
    imports = [line for word, line in IMPORTS.items() if word in words]
    others = sorted(f'import {name}' for name in set(re.findall(r'\w+\.msg(?=\.)', body)))
    return '\n'.join([*HEAD.splitlines(), *imports, *others, '', body])


def _interface(package: str, kind: str, file: Path) -> Iterator[str]:
    """Yield the lines of one message, service or action."""
    name = file.stem
    if kind == 'msg':
        yield from _message(name, parse_message_file(package, str(file)), package)
        return
    yield f'class {name}:'
    parse = parse_service_file if kind == 'srv' else parse_action_file
    spec = parse(package, str(file))
    for part in ('request', 'response') if kind == 'srv' else ('goal', 'result', 'feedback'):
        for line in _message(part.capitalize(), getattr(spec, part)):
            yield f'    {line}'.rstrip()


def _message(name: str, spec: MessageSpecification, beside: str = '') -> Iterator[str]:
    """Yield the lines of a class; messages of the package `beside` are in the same module."""
    if not spec.fields and not spec.constants:
        yield from (f'class {name}: ...', '')
        return
    yield f'class {name}:'
    for constant in spec.constants:
        yield f'    {constant.name}: ClassVar[{_single(constant.type)}]'
    fields = {field.name: _given_and_taken(field.type, beside) for field in spec.fields}
    for field, (given, taken) in fields.items():
        if given == taken:
            yield f'    {field}: {given}'
        else:
            yield from ('    @property', f'    def {field}(self) -> {given}: ...')
            yield f'    @{field}.setter'
            yield f'    def {field}(self, value: {taken}) -> None: ...'
    if fields:
        words = [f'        {field}: {taken} = ...,' for field, (_, taken) in fields.items()]
        yield from ('    def __init__(', '        self,', '        *,', *words)
        yield '    ) -> None: ...'
    yield ''


def _given_and_taken(kind: Type, beside: str) -> tuple[str, str]:
    """Return the type of what reading a field gives, and of what it can be set to."""
    plain = kind.pkg_name is None
    package = '' if kind.pkg_name in (None, beside) else f'{kind.pkg_name}.msg.'
    one = _single(kind.type) if plain else f'{package}{kind.type}'
    if not kind.is_array:
        return one, one
    if one == 'str':  # which is a sequence of str itself
        return 'Sequence[str]', 'list[str] | tuple[str, ...]'
    if not plain or one in ('bool', 'bytes'):
        return f'Sequence[{one}]', f'Sequence[{one}]'
    if kind.is_fixed_size_array():
        array = f'NDArray[numpy.{kind.type}]'
        return array, f'Sequence[{one}] | {array}'
    return f'array[{one}]', f'Sequence[{one}]'


def _single(kind: str) -> str:
    return PLAIN.get(kind, 'float' if kind.startswith('float') else 'int')


def main() -> int:
    """Write or check the stubs."""
    texts = stubs()
    old = {path for path, text in texts.items() if not _holds(path, text)}
    old |= set(STUBS.rglob('*.pyi')) - texts.keys()
    if '--check' in sys.argv[1:]:
        for path in sorted(old):
            name = path.relative_to(ROOT)
            print(f'{name} is out of date: run python tools/write_stubs.py', file=sys.stderr)
        return 1 if old else 0
    for path in old:
        path.unlink(missing_ok=True)
        if path in texts:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(texts[path], encoding='utf-8')
    return 0


def _holds(path: Path, text: str) -> bool:
    return path.is_file() and path.read_text(encoding='utf-8') == text


if __name__ == '__main__':
    sys.exit(main())
