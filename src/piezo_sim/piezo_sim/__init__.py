"""Simulated piezo actuator with switchable imperfections, independent of the models."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from piezo_sim.axes_plant import AxesPlant
    from piezo_sim.plant import FAULTS, Plant
    from piezo_sim.plant_parameters import PlantEffect, PlantParameter
    from piezo_sim.presets import Preset, load_preset, preset_names
    from piezo_sim.simulation_errors import PlantError, PresetError, SimulationError, SweepError

__version__ = '0.2.0'

__all__ = [
    'FAULTS',
    'AxesPlant',
    'Plant',
    'PlantEffect',
    'PlantError',
    'PlantParameter',
    'Preset',
    'PresetError',
    'SimulationError',
    'SweepError',
    'load_preset',
    'preset_names',
]

# Imported on first access: the import of numba would delay the response to Ctrl-C.
_MODULES = {
    **dict.fromkeys(
        ('PlantError', 'PresetError', 'SimulationError', 'SweepError'), 'simulation_errors'
    ),
    'AxesPlant': 'axes_plant',
    **dict.fromkeys(('FAULTS', 'Plant'), 'plant'),
    **dict.fromkeys(('Preset', 'load_preset', 'preset_names'), 'presets'),
    **dict.fromkeys(('PlantEffect', 'PlantParameter'), 'plant_parameters'),
}


def __getattr__(name: str) -> Any:
    """Return a name of the package from the module that defines it."""
    if name not in _MODULES:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    return getattr(importlib.import_module(f'{__name__}.{_MODULES[name]}'), name)
