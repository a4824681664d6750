"""``python -m piezo_hysteresis``, and ``piezo`` where pip has installed it."""

import sys

from piezo_hysteresis.common.interrupts import run_command_line


def run() -> None:
    """Run the command line; end with its exit code."""
    sys.exit(run_command_line('piezo_hysteresis.cli.main'))


if __name__ == '__main__':
    run()
