"""Errors with a remedy for the user; the command line prints them as one line, exit code 2."""


class PiezoError(Exception):
    """Base of every error that a user can cause and correct.

    The message is one sentence with the cause and the remedy.
    """


class RecordError(PiezoError):
    """A record, bag or CSV file cannot be used as it is."""


class SeveralAxesError(RecordError):
    """The data are of several axes; they were read as those of one."""


class ModelError(PiezoError):
    """A model file, model name or parameter cannot be used as it is."""


class IdentificationError(PiezoError):
    """The data cannot identify what was asked for."""


class CompensationError(PiezoError):
    """A model cannot be inverted or a controller cannot be built."""


class DataNote(UserWarning):
    """Something about the data that their user should know."""
