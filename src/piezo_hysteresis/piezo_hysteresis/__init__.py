"""Models, identification, compensation and discovery of piezo actuator hysteresis.

What most programs need is here, and is imported when it is used::

    import piezo_hysteresis as ph

    records = ph.load(['sweep'])
    found = ph.identify(records, 'bouc_wen_mode')
    displacement = ph.simulate(found, records[0])
    missing = ph.discover(records, 'bouc_wen_mode')

The rooms, and which way imports may point (``test/unit/test_architecture.py`` holds it)::

    records, waveforms, blocks <- models <- identification, compensation
        <- discovery <- reporting, cli, nodes

Only ``nodes`` imports rclpy.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from piezo_hysteresis.discovery import Discovery, discover
    from piezo_hysteresis.errors import PiezoError
    from piezo_hysteresis.identification import Identification, identify, simulate
    from piezo_hysteresis.models import Model, ModelFile, named
    from piezo_hysteresis.records import Record, RecordInfo, load, write_bag

__version__ = '0.1.0'

__all__ = [
    'Discovery',
    'Identification',
    'Model',
    'ModelFile',
    'PiezoError',
    'Record',
    'RecordInfo',
    'discover',
    'identify',
    'load',
    'named',
    'simulate',
    'write_bag',
]

_HOMES = {
    'discovery': ('Discovery', 'discover'),
    'errors': ('PiezoError',),
    'identification': ('Identification', 'identify', 'simulate'),
    'models': ('Model', 'ModelFile', 'named'),
    'records': ('Record', 'RecordInfo', 'load', 'write_bag'),
}


def __getattr__(name: str) -> Any:
    # Imported when asked for: SciPy and the compiler take a second.
    for home, names in _HOMES.items():
        if name in names:
            return getattr(importlib.import_module(f'{__name__}.{home}'), name)
    raise AttributeError(f'module {__name__!r} has no attribute {name!r}')


def __dir__() -> list[str]:
    return [*__all__, '__version__']
