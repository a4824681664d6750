"""``python -m piezo_sim``."""

import sys

from piezo_hysteresis.common.interrupts import run_command_line

sys.exit(run_command_line('piezo_sim.cli'))
