"""Studies that write pages and tables of `docs`; set up as the commands of the suite are."""

from piezo_hysteresis.process_setup import kept_for_arrays, one_for_linear_algebra

one_for_linear_algebra()  # before numpy
kept_for_arrays()
