"""Fang 2019's fuzzy PID: the gains follow the error and its rate by 7 x 7 rules.

The rule table of Fang 2019 (its table 2) is missing from the text. The one used here follows what
the text says of it: a proportional gain that is too small is slow and inaccurate, an integral gain
that is too large overshoots. Both tables are symmetric to a change of sign of error and rate.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.compensation.base import Limits
from piezo_hysteresis.compensation.feedback.pid import Pid, PidGains
from piezo_hysteresis.compensation.feedback.settings import FuzzyScales
from piezo_hysteresis.errors import CompensationError

LEVELS = ('NB', 'NM', 'NS', 'ZO', 'PS', 'PM', 'PB')

# Rows: error NB..PB, columns: rate of the error NB..PB; levels -3..3.
# A large error that still grows asks for more proportional gain; one that closes fast for less.
PROPORTIONAL_RULES: FloatArray = np.array(
    [
        [3, 3, 3, 2, 1, 0, -1],
        [3, 3, 2, 1, 0, -1, -1],
        [2, 2, 1, 1, 0, -1, -2],
        [-1, -1, 0, 0, 0, -1, -1],
        [-2, -1, 0, 1, 1, 2, 2],
        [-1, -1, 0, 1, 2, 3, 3],
        [-1, 0, 1, 2, 3, 3, 3],
    ],
    dtype=np.float64,
)
# Near the goal and calm the integral may work; far from it or in haste it would wind up.
INTEGRAL_RULES: FloatArray = np.array(
    [
        [-3, -3, -2, -2, -2, -3, -3],
        [-3, -2, -1, 0, -1, -2, -3],
        [-2, -1, 1, 2, 1, -1, -2],
        [-1, 0, 2, 3, 2, 0, -1],
        [-2, -1, 1, 2, 1, -1, -2],
        [-3, -2, -1, 0, -1, -2, -3],
        [-3, -3, -2, -2, -2, -3, -3],
    ],
    dtype=np.float64,
)


@dataclass(frozen=True)
class FuzzyRules(FuzzyScales):
    """How error and rate move the gains: scales and tables.

    Attributes
    ----------
    proportional_rules, integral_rules : ndarray, shape (7, 7)
        Levels -3..3; rows error NB..PB, columns rate NB..PB.
    """

    proportional_rules: FloatArray = field(default_factory=lambda: PROPORTIONAL_RULES)
    integral_rules: FloatArray = field(default_factory=lambda: INTEGRAL_RULES)

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ('proportional_rules', 'integral_rules'):
            if np.shape(getattr(self, name)) != (7, 7):
                raise CompensationError(f'{name} must be a table of 7 x 7 levels')


def infer(rules: FloatArray, error: float, rate: float) -> float:
    """Answer the level -1..1 that the rules give, for error and rate in -1..1 (clamped).

    Seven triangular sets that add up to one everywhere, product inference and weighted mean of
    the levels: this is bilinear interpolation of the table.
    """
    x = (min(max(error, -1.0), 1.0) + 1.0) * 3.0
    y = (min(max(rate, -1.0), 1.0) + 1.0) * 3.0
    i, j = min(int(x), 5), min(int(y), 5)
    a, b = x - i, y - j
    level = (
        (1.0 - a) * (1.0 - b) * rules[i, j]
        + a * (1.0 - b) * rules[i + 1, j]
        + (1.0 - a) * b * rules[i, j + 1]
        + a * b * rules[i + 1, j + 1]
    )
    return float(level) / 3.0


class FuzzyPid(Pid):
    """PID whose proportional and integral gain are scheduled by fuzzy rules, Fang 2019 section 4.

    ``KP = KP0 + dKP(e, de/dt)``, ``KI = KI0 + dKI(e, de/dt)``, KD fixed; gains never fall
    below 0.

    Parameters
    ----------
    gains : PidGains
        KP0, KI0, KD and the time constants.
    rules : FuzzyRules
        Tables and scales.
    dt : float
        Sampling interval [s].
    limits : Limits, optional
        As in `FeedbackLink`.
    """

    def __init__(
        self,
        gains: PidGains,
        rules: FuzzyRules,
        dt: float,
        *,
        limits: Limits | None = None,
    ) -> None:
        super().__init__(gains, dt, limits=limits)
        self._rules = rules

    def _law(self, error: float) -> float:
        rules, gains = self._rules, self._gains
        # The filtered slope of the tick before: the raw one is mostly noise.
        x, y = error / rules.error_scale, self._slope / rules.rate_scale
        proportional = gains.proportional + rules.proportional_range * infer(
            rules.proportional_rules, x, y
        )
        integral = gains.integral + rules.integral_range * infer(rules.integral_rules, x, y)
        return self._pid(error, max(proportional, 0.0), max(integral, 0.0))
