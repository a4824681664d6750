"""What goes wrong with a controller, in one sentence."""

from __future__ import annotations

from piezo_hysteresis.errors import PiezoError


class DriverError(PiezoError):
    """A controller cannot be reached, or refuses."""


class ConnectionLostError(DriverError):
    """A controller does not answer any more: it has to be connected to anew."""
