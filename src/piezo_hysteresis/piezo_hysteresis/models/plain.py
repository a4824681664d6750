"""Input and output of plain YAML: atomic writing, and errors in one sentence."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from piezo_hysteresis.common import plain_yaml
from piezo_hysteresis.common.plain_yaml import write_atomically
from piezo_hysteresis.common.wording import near, reason_of
from piezo_hysteresis.errors import ModelError


class _Line(list[Any]):
    """A list that is written in one line."""


class _LineMap(dict[Any, Any]):
    """A mapping that is written in one line."""


class _Dumper(yaml.SafeDumper):
    """YAML writer of plain types."""


_Dumper.add_representer(
    _Line, lambda d, v: d.represent_sequence('tag:yaml.org,2002:seq', list(v), flow_style=True)
)
_Dumper.add_representer(
    _LineMap, lambda d, v: d.represent_mapping('tag:yaml.org,2002:map', dict(v), flow_style=True)
)


def _compact(content: object) -> object:
    """Return `content` with each list of numbers and each table row in one line."""
    if isinstance(content, dict):
        return {key: _compact(value) for key, value in content.items()}
    if isinstance(content, list):
        if all(isinstance(each, (int, float)) for each in content):
            return _Line(content)
        return [_LineMap(each) if isinstance(each, dict) else _compact(each) for each in content]
    return content


def yaml_text(content: Mapping[str, Any]) -> str:
    """Return `content` as YAML, in the given order."""
    plain = _compact(dict(content))
    return str(yaml.dump(plain, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=99))


def read_yaml(path: str | Path) -> object:
    """Return the content of a YAML file, of plain types only."""
    if not isinstance(path, (str, Path)):
        raise ModelError(f'a model file is given by its path, not by a {type(path).__name__}')
    try:
        return plain_yaml.load_file(path)
    except FileNotFoundError:
        near_by = [each.name for each in Path(path).parent.glob('*.y*ml')]
        guess = near(Path(path).name, near_by)
        raise ModelError(f'there is no model file {path}{guess}; give the path of one') from None
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise ModelError(f'cannot read the model file {path}: {reason_of(error)}') from error


def write_yaml(content: Mapping[str, Any], path: str | Path) -> None:
    """Write `content` as YAML under a temporary name first, then rename."""
    target = Path(path)
    text = yaml_text(content)
    try:
        with write_atomically(target) as temporary:
            temporary.write_text(text, encoding='utf-8')
    except OSError as error:
        raise ModelError(f'cannot write {target}: {reason_of(error)}') from error


def number(value: object, what: str) -> float:
    """Return `value` as a float, or raise an error that names `what`."""
    if isinstance(value, bool) or not isinstance(value, (int, float, str)):
        raise ModelError(f'{what} must be a number, got {value!r}')
    try:
        return float(value)  # YAML reads 1e-5 without a point as text
    except (ValueError, OverflowError) as error:
        raise ModelError(f'{what} must be a number, got {str(value)[:40]!r}') from error


def mapping(value: object, what: str) -> Mapping[str, Any]:
    """Return `value` with names as keys, or raise an error that names `what`."""
    if not isinstance(value, dict):
        raise ModelError(f'{what} must be a mapping, got {type(value).__name__}')
    return {str(key): each for key, each in value.items()}


def refuse_unknown(found: Mapping[str, Any], known: set[str], what: str) -> None:
    """Raise an error if `found` has unknown names; `what` is in the message."""
    stray = sorted(set(found) - known)
    if stray:
        raise ModelError(
            f'{what} has unknown {", ".join(stray)}; it knows {", ".join(sorted(known))}'
        )
