"""Controllers of PI with GCS 2: E-727, E-712, E-753 and similar ones."""

from piezo_hysteresis.drivers.gcs.gcs_controller import GcsConnection, GcsController

__all__ = ['GcsConnection', 'GcsController']
