"""A simulated piezo actuator with every imperfection switchable; knows nothing of the models."""

from piezo_sim.errors import PlantError, PresetError, SimulationError, SweepError
from piezo_sim.plant import FAULTS, Plant
from piezo_sim.presets import Preset, load_preset, preset_names
from piezo_sim.table import PlantEffect, PlantParameter

__version__ = '0.1.0'

__all__ = [
    'FAULTS',
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
