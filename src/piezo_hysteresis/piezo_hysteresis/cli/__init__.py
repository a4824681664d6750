"""The command line: one file per verb, errors as one line with exit code 2."""

from piezo_hysteresis.memory import kept_for_arrays
from piezo_hysteresis.threads import one_for_linear_algebra

one_for_linear_algebra()
kept_for_arrays()
