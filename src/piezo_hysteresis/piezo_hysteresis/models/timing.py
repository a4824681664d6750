"""At which tick a chain answers a voltage, and what that means for a recording."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from piezo_hysteresis.blocks.base import Slot
from piezo_hysteresis.models.chain import Model

# Blocks of the structure that have no inertia, or are a delay, which is an effect.
_MASSLESS = ('backlash', 'stiction', 'stiffness', 'delayed_motion')


def answers_at_once(model: Model, values: Mapping[str, float], dt: float) -> bool:
    """Tell whether the chain answers the voltage of a tick at that tick.

    A structure with inertia holds the voltage over the tick and answers at the next one, as a
    measurement does that is taken before the voltage acts; every other chain is one tick ahead of
    such a measurement. A transport delay is no part of this: it is an effect.

    Parameters
    ----------
    model : Model
        The chain.
    values : mapping of str to float
        Its parameters; missing ones take their default.
    dt : float
        Sampling interval [s].
    """
    signal = np.full(2, 1e-6)
    rest = np.zeros(2)
    for block in model.blocks:
        if block.slot is not Slot.STRUCTURE or block.name in _MASSLESS:
            continue
        own = block.pack(model.block_values(values, block.name))
        signal = block.respond(signal, own, dt, state=block.initial_state(dt))
        rest = block.respond(rest, own, dt, state=block.initial_state(dt))
    return bool(abs(signal[0] - rest[0]) > 0.5e-6)
