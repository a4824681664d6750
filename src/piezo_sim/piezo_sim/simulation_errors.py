"""Errors that tell the user what to do; the command line prints them as one line, exit code 2."""


class SimulationError(ValueError):
    """Base of every error of the simulator that a user can cause and mend."""


class PlantError(SimulationError):
    """A parameter, effect or fault is unknown, out of range or physically impossible."""


class PresetError(SimulationError):
    """A preset cannot be found or read."""


class SweepError(SimulationError):
    """A sweep was asked for that cannot be run or written."""
