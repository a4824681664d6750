"""``python -m piezo_sim``."""

import sys

from piezo_sim.cli import main

sys.exit(main())
