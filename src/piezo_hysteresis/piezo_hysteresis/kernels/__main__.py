"""``python -m piezo_hysteresis.kernels [REHEARSAL ...]``: compile kernels in advance."""

import sys

from piezo_hysteresis.kernels.rehearse import main

if __name__ == '__main__':
    sys.exit(main())
