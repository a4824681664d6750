"""``python -m piezo_kernels``: compile every kernel, so that nobody waits for one later."""

import sys

from piezo_kernels.rehearse import main

if __name__ == '__main__':
    sys.exit(main())
