"""Decision rules for effects that improve the prediction, as functions of plain numbers."""

from __future__ import annotations

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.discovery.choice.choice_policy import CHOICE, FITS, ChoicePolicy
from piezo_hysteresis.discovery.selection.rules import is_no_worse
from piezo_hysteresis.numerics.linalg import solve_square


def predicts_better(
    trained: tuple[float, float], held_out: tuple[float, float], policy: ChoicePolicy = CHOICE
) -> bool:
    """Return whether an effect reduces one of two errors and does not increase the held-out one.

    Each error is a pair (before, after). Held-out data can reject an effect as in discovery. Here
    they can also propose one, because the model must predict and no effect is named.
    """
    lower = any(after <= (1.0 - policy.min_gain) * before for before, after in (trained, held_out))
    return lower and is_no_worse(*held_out, FITS)


def differs_from_none(
    away: FloatArray, std: FloatArray, correlation: FloatArray, policy: ChoicePolicy = CHOICE
) -> bool:  # away, std (q,); correlation (q, q)
    """Return whether parameters jointly differ significantly from those of no effect."""
    if not away.size:
        return True
    if not np.all(np.isfinite(std)) or np.any(std <= 0.0):
        return False
    scaled = away / std
    solved = solve_square(correlation, scaled)
    return bool(scaled @ solved.values >= policy.min_standard_errors**2 * away.size)


def plays_are_bearable(
    plays: float, bouc_wen: float, one_amplitude: bool, policy: ChoicePolicy = CHOICE
) -> bool:
    """Return whether the bank of plays is selected, given the held-out errors of both models."""
    return one_amplitude or plays <= policy.inner_loops * bouc_wen


def has_one_amplitude(
    voltage: FloatArray, turns: FloatArray, policy: ChoicePolicy = CHOICE
) -> bool:  # voltage, turns [V]
    """Return whether a voltage has one high and one low reversal level."""
    middle = 0.5 * (float(voltage.max()) + float(voltage.min()))
    levels = np.abs(turns - middle)
    return bool(levels.size and np.quantile(levels, 0.1) >= policy.one_level * levels.max())
