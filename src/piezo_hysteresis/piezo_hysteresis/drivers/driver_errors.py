"""Errors of a controller."""

from __future__ import annotations

from piezo_hysteresis.errors import PiezoError


class DriverError(PiezoError):
    """A controller cannot be reached, or refuses."""


class ConnectionLostError(DriverError):
    """The controller no longer responds; a new connection is required."""


class UnknownCommandError(DriverError):
    """A controller does not know a command."""
