"""Models, identification, compensation and discovery of piezo actuator hysteresis.

The names below are the Python interface; each is imported when it is first used::

    import piezo_hysteresis as ph

    records = ph.load('sweep')                       # files, arrays or data frames
    found = ph.identify(records, 'bouc_wen_mode')    # a model with its values
    check = ph.validate(ph.load('check.csv'), found) # errors on other records
    missing = ph.discover(records, 'bouc_wen_mode')  # effects that the model lacks
    study = ph.compensate(found, 'sine:frequency=23,amplitude=80e-6,duration=4')
    displacement = found.simulate(voltage, dt)       # from rest
    found.save('model.yaml')
    model = ph.Model.load('model.yaml')

Functions take one record or several, and a model by its name, its file or as an object. Results
have ``plot()``, ``to_frame()`` and ``report(path)``. Units are SI: volts, metres, seconds.

The rooms, and which way imports may point (``test/unit/test_architecture.py`` holds it)::

    records, waveforms, blocks <- models <- identification, compensation
        <- discovery <- reporting, cli, nodes

Only ``nodes`` and ``ros`` import rclpy.
"""

from __future__ import annotations

import importlib
import sys
import types
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from piezo_hysteresis.axes.axes_load import load_axes
    from piezo_hysteresis.axes.axes_record import AxesRecord
    from piezo_hysteresis.axes.modal_model import ModalModel as AxesModel
    from piezo_hysteresis.batch import Batch
    from piezo_hysteresis.batch import run_batch as batch
    from piezo_hysteresis.discovery import Discovery
    from piezo_hysteresis.errors import PiezoError
    from piezo_hysteresis.identification import (
        METHODS,
        Identification,
        Validation,
        simulate,
        validate,
    )
    from piezo_hysteresis.interface.compensate_runs import Compensation, compensate
    from piezo_hysteresis.interface.investigate import investigate
    from piezo_hysteresis.interface.model_functions import export
    from piezo_hysteresis.interface.verbs import discover, identify
    from piezo_hysteresis.models import EFFECT_NAMES as EFFECTS
    from piezo_hysteresis.models import NAMES as MODELS
    from piezo_hysteresis.models import ModelFile as Model
    from piezo_hysteresis.records import ReadOptions, Record, RecordInfo, load, write_bag

__version__ = '0.2.0'

__all__ = [
    'EFFECTS',
    'METHODS',
    'MODELS',
    'AxesModel',
    'AxesRecord',
    'Batch',
    'Compensation',
    'Discovery',
    'Identification',
    'Model',
    'PiezoError',
    'ReadOptions',
    'Record',
    'RecordInfo',
    'Validation',
    'batch',
    'compensate',
    'discover',
    'export',
    'identify',
    'investigate',
    'load',
    'load_axes',
    'simulate',
    'validate',
    'write_bag',
]

_HOMES = {
    'EFFECTS': 'models.EFFECT_NAMES',
    'METHODS': 'identification.METHODS',
    'MODELS': 'models.NAMES',
    'AxesModel': 'axes.modal_model.ModalModel',
    'AxesRecord': 'axes.axes_record.AxesRecord',
    'Batch': 'batch.Batch',
    'Compensation': 'interface.compensate_runs.Compensation',
    'Discovery': 'discovery.Discovery',
    'Identification': 'identification.Identification',
    'Model': 'models.ModelFile',
    'PiezoError': 'errors.PiezoError',
    'ReadOptions': 'records.ReadOptions',
    'Record': 'records.Record',
    'RecordInfo': 'records.RecordInfo',
    'Validation': 'identification.Validation',
    'batch': 'batch.run_batch',
    'compensate': 'interface.compensate_runs.compensate',
    'discover': 'interface.verbs.discover',
    'export': 'interface.model_functions.export',
    'investigate': 'interface.investigate.investigate',
    'identify': 'interface.verbs.identify',
    'load': 'records.load',
    'load_axes': 'axes.axes_load.load_axes',
    'simulate': 'identification.simulate',
    'validate': 'identification.validate',
    'write_bag': 'records.write_bag',
}


class _Interface(types.ModuleType):
    """Keeps the functions of the interface where a room has the same name, such as ``export``."""

    def __setattr__(self, name: str, value: Any) -> None:
        if not (name in _HOMES and isinstance(value, types.ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Interface


def __getattr__(name: str) -> Any:
    # Imported when asked for: SciPy and the compiler take a second.
    if name not in _HOMES:
        from piezo_hysteresis.common.wording import missing

        what = f'module {__name__!r} has no attribute {name!r}'
        raise AttributeError(what + missing(name, __all__))
    home, _, known = _HOMES[name].rpartition('.')
    found = getattr(importlib.import_module(f'{__name__}.{home}'), known)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return [*__all__, '__version__']
