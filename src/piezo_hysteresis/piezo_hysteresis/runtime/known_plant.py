"""The plant that controllers on the tracking error are computed with: one place for every node."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from piezo_hysteresis.compensation.inverses.inverse_choice import mode_of, model_gain
from piezo_hysteresis.compensation.linear_gain import LinearGain, ModeGain
from piezo_hysteresis.models import ModelFile

#: Quasi-static gain that is assumed where nothing is known of the plant [m/V].
GUESS = 1e-4


def known_gain(values: Mapping[str, Any], dt: float, model: ModelFile | None) -> LinearGain | None:
    """Return the gain of the plant, None where nothing is known of it.

    Parameters
    ----------
    values : mapping
        Parameters of the node: ``plant.*``, which come first where ``plant.gain`` is not 0, and
        ``limits.*``.
    dt : float
        Sampling interval [s].
    model : ModelFile or None
        The loaded model, whose whole chain is linearised for small tones on a drive of the whole
        range.
    """
    gain = values['plant.gain']
    if gain != 0.0:
        frequency, damping = values['plant.natural_frequency'], values['plant.damping_ratio']
        return ModeGain(gain, frequency, damping, dt)
    if model is None:
        return None
    amplitude = 0.5 * (values['limits.high'] - values['limits.low'])
    return model_gain(model.model, model.values, dt, amplitude)


def known_mode(values: Mapping[str, Any], dt: float, model: ModelFile | None) -> ModeGain | None:
    """Return the plant of `known_gain` as a gain and a mode."""
    gain = known_gain(values, dt, model)
    if gain is None or isinstance(gain, ModeGain):
        return gain
    assert model is not None
    return mode_of(model.model.unpack(model.packed), abs(gain(0.0)), dt)
