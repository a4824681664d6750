"""Decision rules for effects that improve the prediction, as functions of plain numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.discovery.selection.policy import POLICY, number
from piezo_hysteresis.discovery.selection.rules import is_no_worse
from piezo_hysteresis.numerics.linalg import solve_square


@dataclass(frozen=True)
class ChoicePolicy:
    """Thresholds in addition to `FITS`; fields have ``metadata`` as those of `SelectionPolicy`."""

    trained: float = number(
        0.7,
        '1',
        'Share of each record that is fitted; the rest is held out.',
        'chosen: usual in other tools',
    )
    min_gain: float = number(
        0.02,
        '1',
        'Share by which an effect must lower the fitted or the held-out error.',
        'chosen: less has no effect on tracking',
    )
    min_standard_errors: float = number(
        3.0,
        'standard deviations',
        'Joint deviation of the parameters of an effect from their neutral values.',
        'derived: one in 370 of a normal distribution; held-out data are also tested',
    )
    inner_loops: float = number(
        1.25,
        '1',
        'Held-out error of play operators, relative to Bouc-Wen, up to which they are selected: '
        'their inner loops close as in actuators, which records of few amplitudes do not show.',
        'chosen: accepts a quarter more error for loops that were not recorded',
    )
    one_level: float = number(
        0.8,
        '1',
        'Smallest reversal level, relative to the largest, of a voltage that counts as one '
        'amplitude.',
        'chosen: closer loops look alike',
    )
    rough: float = number(1e-4, '1', 'Relative change at which a trial stops.', 'effort')


CHOICE = ChoicePolicy()
#: Evaluations of the fits, and the accepted increase of the held-out error.
FITS = POLICY.but(first_evaluations=10, final_evaluations=80, worse=0.01)


@dataclass(frozen=True)
class HeldOutScore:
    """Error of the selected model on the held-out rest of a record."""

    record: str  # name of the record
    free_run_rms: float  # free-run error after the cut [m]
    nrmse_percent: float  # [%]


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
