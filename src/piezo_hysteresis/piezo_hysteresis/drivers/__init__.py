"""Drivers of laboratory controllers: sweeps that run in the controller at its servo rate."""

from piezo_hysteresis.drivers.addresses import open_controller
from piezo_hysteresis.drivers.controller import Controller, Identity, Measurement
from piezo_hysteresis.drivers.driver_sweep import measured, planned_sweep, sweep, write_measured
from piezo_hysteresis.drivers.wires import DriverError

__all__ = [
    'Controller',
    'DriverError',
    'Identity',
    'Measurement',
    'measured',
    'open_controller',
    'planned_sweep',
    'sweep',
    'write_measured',
]
