"""Short runs of all compiled kernels, so that set-up can compile them."""

from __future__ import annotations

import numpy as np

from piezo_sim.plant import Plant


def plant() -> None:
    """Run a plant and change it during the run; one kernel serves all actuators and effects."""
    simulated = Plant()
    simulated.exchange(0.0)
    simulated.run(np.zeros(4))
    simulated.switch('creep')


REHEARSALS = (plant,)
