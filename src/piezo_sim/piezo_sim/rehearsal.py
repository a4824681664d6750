"""Short runs of all compiled kernels, so that set-up can compile them."""

from __future__ import annotations

import numpy as np

from piezo_sim.axes_plant import AxesPlant
from piezo_sim.plant import Plant


def plant() -> None:
    """Run a plant and change it during the run; one kernel serves all actuators and effects."""
    simulated = Plant()
    simulated.exchange(0.0)
    simulated.run(np.zeros(4))
    simulated.switch('creep')


def axes() -> None:
    """Run the plants of several axes."""
    AxesPlant.from_preset('xy_scanner').run(np.zeros((4, 2)))


REHEARSALS = (plant, axes)
