"""What decides whether an effect makes a model predict better, as functions of plain numbers."""

from __future__ import annotations

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.discovery.choice.policy import CHOICE, FITS, ChoicePolicy
from piezo_hysteresis.discovery.selection.rules import is_no_worse
from piezo_hysteresis.numerics.linalg import solve_square


def predicts_better(
    trained: tuple[float, float], held_out: tuple[float, float], policy: ChoicePolicy = CHOICE
) -> bool:
    """Return whether errors (before, after) with an effect are lower, and nowhere higher.

    Held-out data veto as they do in discovery. Here they may propose as well: the model shall
    predict, and nothing is given a name.
    """
    lower = any(after <= (1.0 - policy.min_gain) * before for before, after in (trained, held_out))
    return lower and is_no_worse(*held_out, FITS)


def differs_from_none(
    away: FloatArray, std: FloatArray, correlation: FloatArray, policy: ChoicePolicy = CHOICE
) -> bool:
    """Return whether parameters together are surely not those of no effect.

    Parameters
    ----------
    away : ndarray, shape (q,)
        Parameters minus those with which the effect does nothing.
    std : ndarray, shape (q,)
        Their standard deviations.
    correlation : ndarray, shape (q, q)
        Their correlation.
    policy : ChoicePolicy
        What decides.
    """
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
    """Return whether a bank of plays is taken, by the held-out errors of both chains."""
    return one_amplitude or plays <= policy.inner_loops * bouc_wen


def has_one_amplitude(
    voltage: FloatArray, turns: FloatArray, policy: ChoicePolicy = CHOICE
) -> bool:
    """Return whether a voltage turns back at one high and one low level.

    Parameters
    ----------
    voltage : ndarray
        Of all records [V].
    turns : ndarray
        Where it turns back [V].
    policy : ChoicePolicy
        What decides.
    """
    middle = 0.5 * (float(voltage.max()) + float(voltage.min()))
    levels = np.abs(turns - middle)
    return bool(levels.size and np.quantile(levels, 0.1) >= policy.one_level * levels.max())
