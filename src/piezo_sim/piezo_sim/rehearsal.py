"""What runs compiled kernels, once and briefly, so that set-up can compile them."""

from __future__ import annotations

import numpy as np

from piezo_sim.plant import Plant


def plant() -> None:
    """Run a plant and change it meanwhile; one kernel serves every actuator and effect."""
    simulated = Plant()
    simulated.exchange(0.0)
    simulated.run(np.zeros(4))
    simulated.switch('creep')


REHEARSALS = (plant,)
