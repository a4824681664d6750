"""``python -m piezo_hysteresis.kernels``: compile every kernel before its first use."""

import sys

from piezo_hysteresis.kernels.rehearse import main

if __name__ == '__main__':
    sys.exit(main())
