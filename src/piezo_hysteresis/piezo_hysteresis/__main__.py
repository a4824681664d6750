"""``python -m piezo_hysteresis``."""

import sys

from piezo_common.interrupts import run_command_line

if __name__ == '__main__':
    sys.exit(run_command_line('piezo_hysteresis.cli.main'))
