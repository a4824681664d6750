"""YAML of plain types with bounded effort: a text or file is read quickly or refused.

PyYAML takes one second for 100 kB, and a few lines of aliases can expand to 1e9 values: `LARGEST`
limits the text, `MOST` the expanded nodes.
"""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import yaml


@contextmanager
def write_atomically(path: Path) -> Iterator[Path]:
    """Provide a temporary name next to `path`, renamed to `path` on success.

    A file or folder with that name is deleted on an error. The name is unique to the process, so
    that two processes can write the same file.
    """
    temporary = path.with_name(f'.{path.name}.{os.getpid()}.tmp')
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        yield temporary
        temporary.replace(path)
    finally:
        if temporary.is_dir():
            shutil.rmtree(temporary, ignore_errors=True)
        else:
            temporary.unlink(missing_ok=True)


LARGEST = 1 << 20  # characters of a text, bytes of a file
LONGEST = 100  # characters of a number
DEEPEST = 100  # lists and mappings within each other
MOST = 1_000_000  # values, counted where aliases repeat them


class _Loader(yaml.SafeLoader):
    """Counts the expanded nodes of a document before it is constructed."""

    _depth = 0

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        """Refuse deep nesting before the recursion limit is reached."""
        self._depth += 1
        if self._depth > DEEPEST:
            raise yaml.YAMLError('it is nested too deeply')
        node = super().compose_node(parent, index)
        self._depth -= 1
        return node

    def construct_document(self, node: yaml.Node) -> Any:
        if _size(node, {}) > MOST:
            raise yaml.YAMLError('its aliases expand to too many values')
        return super().construct_document(node)

    def construct_yaml_int(self, node: yaml.ScalarNode) -> int:
        """Refuse long numbers: their digits alone, or 59:59:59:..., take seconds."""
        return int(super().construct_yaml_int(_short(node)))

    def construct_yaml_float(self, node: yaml.ScalarNode) -> float:
        """Refuse long numbers."""
        return float(super().construct_yaml_float(_short(node)))


_Loader.add_constructor('tag:yaml.org,2002:int', _Loader.construct_yaml_int)
_Loader.add_constructor('tag:yaml.org,2002:float', _Loader.construct_yaml_float)


def _short(node: yaml.ScalarNode) -> yaml.ScalarNode:
    if len(node.value) > LONGEST:
        raise ValueError(f'a number of {len(node.value)} characters')
    return node


def _size(node: yaml.Node, known: dict[int, int]) -> int:
    """Return the number of expanded nodes; `known` are those already counted."""
    if id(node) not in known:
        known[id(node)] = MOST + 1  # one that holds itself never ends
        children = node.value if isinstance(node, yaml.CollectionNode) else []
        pairs = [each if isinstance(each, tuple) else (each,) for each in children]
        known[id(node)] = 1 + sum(_size(each, known) for pair in pairs for each in pair)
    return known[id(node)]


def load(text: str) -> Any:
    """Return the content of a YAML text, in plain types only."""
    if len(text) > LARGEST:
        raise yaml.YAMLError(f'{len(text)} characters are too many, at most {LARGEST} are read')
    try:
        return yaml.load(text, Loader=_Loader)
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        reason = str(error).split(';')[0]  # such as a number of 200 000 digits
        raise yaml.YAMLError(f'it holds a value that cannot be read ({reason[:100]})') from None


def load_file(path: str | Path) -> Any:
    """Return the content of a YAML file, in plain types only."""
    path = Path(path)
    if path.exists() and not path.is_file():  # a pipe would be waited for
        raise OSError(errno.EINVAL, 'it is no regular file', os.fspath(path))
    if path.stat().st_size > LARGEST:
        raise yaml.YAMLError(f'more than {LARGEST} bytes are too many')
    try:
        return load(path.read_text(encoding='utf-8'))
    except UnicodeDecodeError:
        raise yaml.YAMLError('it is no text in UTF-8') from None
