"""Rule tables of the fuzzy PID from a YAML file that a person writes."""

from __future__ import annotations

from pathlib import Path
from typing import TypedDict

import numpy as np
import yaml

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.common import plain_yaml
from piezo_hysteresis.common.wording import reason_of
from piezo_hysteresis.compensation.feedback.fuzzy_pid import LEVELS
from piezo_hysteresis.errors import CompensationError

_TABLES = ('proportional', 'integral')


class Tables(TypedDict):
    """The tables as `FuzzyRules` takes them."""

    proportional_rules: FloatArray
    integral_rules: FloatArray


def read_tables(path: str | Path) -> Tables:
    """Return the tables of a file like ``config/fuzzy/symmetric.yaml``."""
    try:
        content = plain_yaml.load_file(path)
    except (OSError, yaml.YAMLError) as error:
        reason = reason_of(error)
        raise CompensationError(f'the fuzzy tables {path} cannot be read: {reason}') from error
    if not isinstance(content, dict) or set(content) != set(_TABLES):
        raise CompensationError(f'{path}: fuzzy tables are a mapping of {" and ".join(_TABLES)}')
    proportional, integral = (_table(content[name], f'{path}: {name}') for name in _TABLES)
    return {'proportional_rules': proportional, 'integral_rules': integral}


def _table(content: object, what: str) -> FloatArray:
    if not isinstance(content, dict) or set(content) != set(LEVELS):
        raise CompensationError(f'{what} has one row for each error {", ".join(LEVELS)}')
    return np.array([_row(content[level], f'{what} {level}') for level in LEVELS])


def _row(content: object, what: str) -> list[float]:
    if not isinstance(content, list) or len(content) != len(LEVELS):
        raise CompensationError(f'{what} lists {len(LEVELS)} levels, for the rates NB to PB')
    return [_level(each, what) for each in content]


def _level(content: object, what: str) -> float:
    if content in LEVELS:
        return float(LEVELS.index(str(content)) - 3)
    if isinstance(content, int | float) and not isinstance(content, bool) and abs(content) <= 3:
        return float(content)
    raise CompensationError(f'{what}: {content!r} is no level; write {", ".join(LEVELS)} or -3..3')
