"""``python -m piezo_hysteresis``."""

import sys

from piezo_hysteresis.cli.main import main

if __name__ == '__main__':
    sys.exit(main())
