"""Errors with a remedy for the user; the command line prints them as one line, exit code 2."""


class SimulationError(ValueError):
    """Base class of errors of the simulator that a user can cause and correct."""


class PlantError(SimulationError):
    """A parameter, effect or fault is unknown, out of range or physically impossible."""


class PresetError(SimulationError):
    """A preset cannot be found or read."""


class SweepError(SimulationError):
    """A sweep cannot be run or written."""
