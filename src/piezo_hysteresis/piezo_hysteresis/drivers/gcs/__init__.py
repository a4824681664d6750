"""Controllers of PI that speak GCS 2 over TCP: E-727, E-712, E-753 and their kin."""

from piezo_hysteresis.drivers.gcs.connection import Connection, DriverError
from piezo_hysteresis.drivers.gcs.controller import DriveLimits, GcsController, Identity
from piezo_hysteresis.drivers.gcs.sweep import sweep

__all__ = ['Connection', 'DriveLimits', 'DriverError', 'GcsController', 'Identity', 'sweep']
