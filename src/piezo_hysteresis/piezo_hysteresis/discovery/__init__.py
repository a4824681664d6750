"""Discovery of missing effects: check, locate, select, validate, advise.

``data`` splits the records, ``selection`` finds the effects, ``verdict`` reports them, and
``gap_monitor`` monitors a running actuator.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from piezo_hysteresis.discovery.verdict.verdict import Verdict
    from piezo_hysteresis.discovery.workflow import Discovery, discover, limits_of

__all__ = ['Discovery', 'Verdict', 'discover', 'limits_of']

_HOMES = {
    'Verdict': 'verdict.verdict',
    'Discovery': 'workflow',
    'discover': 'workflow',
    'limits_of': 'workflow',
}


def __getattr__(name: str) -> Any:
    # Imported on first access: these modules import SciPy, which the gap monitor does not need.
    if name not in _HOMES:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    return getattr(importlib.import_module(f'{__name__}.{_HOMES[name]}'), name)
