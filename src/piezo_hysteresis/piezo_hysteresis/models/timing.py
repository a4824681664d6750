"""At which tick a chain answers a voltage, and what that means for a recording."""

from __future__ import annotations

from collections.abc import Mapping

from piezo_hysteresis.models.chain import Model


def answers_at_once(model: Model, values: Mapping[str, float], dt: float) -> bool:
    """Return whether the chain's answer at a tick includes the voltage of that tick.

    A chain with inertia answers at the tick, before its voltage acts, as a measurement does. Every
    other chain answers at the end of the tick, just before the next voltage acts: it is to be
    compared with the measurement of the next tick. That is a matter of the blocks alone, so that
    no value of a parameter moves the clock.

    Parameters
    ----------
    model : Model
        The chain.
    values : mapping of str to float
        Its parameters, which do not matter.
    dt : float
        Sampling interval [s], which does not matter either.
    """
    return not any(block.inertia for block in model.blocks)
