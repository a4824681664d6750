"""Command line: one module per verb; an error is one line with exit code 2."""

from piezo_hysteresis.process_setup import kept_for_arrays, one_for_linear_algebra

one_for_linear_algebra()
kept_for_arrays()
