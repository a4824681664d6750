"""PID with filtered derivative and anti-windup, and the fuzzy PID that schedules its gains.

Zhou 2021 figure 10, Fang 2019 figure 5.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import astuple, dataclass, field, fields
from pathlib import Path
from typing import ClassVar, TypedDict

import numpy as np
import yaml

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.common import plain_yaml
from piezo_hysteresis.common.wording import reason_of
from piezo_hysteresis.compensation.feedback.feedback_link import (
    OWN,
    FeedbackLaw,
    FeedbackLink,
    FuzzyScales,
    PidGains,
    stepping,
)
from piezo_hysteresis.compensation.link import Limits
from piezo_hysteresis.errors import CompensationError
from piezo_hysteresis.jit import inline_jit, jit

__all__ = ['FuzzyPid', 'FuzzyRules', 'Pid', 'PidGains']

# Places in the memory of the law: integral [V], filtered slope of the error [m/s], the last error
# [m] and whether there was one.
_INTEGRAL, SLOPE, _LAST, _STARTED = range(4)
PID_SIZE = 4
# Places in the parameters, in the order of `PidGains`.
PROPORTIONAL, INTEGRAL, _DERIVATIVE, _FILTER, _TRACKING = range(5)
GAINS = 5


@inline_jit
def pid(
    error: float,
    proportional: float,
    integral: float,
    memory: FloatArray,
    p: FloatArray,
    dt: float,
) -> float:
    """Return the share of the voltage [V] by gains that may differ from those in `p`."""
    last = memory[_LAST] if memory[_STARTED] > 0.0 else error
    memory[_INTEGRAL] += 0.5 * dt * integral * (error + last)
    twice = 2.0 * p[_FILTER]
    memory[SLOPE] = ((twice - dt) * memory[SLOPE] + 2.0 * (error - last)) / (twice + dt)
    memory[_LAST], memory[_STARTED] = error, 1.0
    return float(proportional * error + memory[_INTEGRAL] + p[_DERIVATIVE] * memory[SLOPE])


@inline_jit
def plain(error: float, memory: FloatArray, p: FloatArray, dt: float) -> float:
    """Return the share of the voltage [V]."""
    return pid(error, p[PROPORTIONAL], p[INTEGRAL], memory, p, dt)


@inline_jit
def hold(memory: FloatArray, p: FloatArray) -> float:
    """Return the share without a measurement: the integral [V]."""
    return float(memory[_INTEGRAL])


@inline_jit
def cut(excess: float, memory: FloatArray, p: FloatArray, dt: float) -> None:
    """Anti-windup: let the integral follow the limited voltage [V]."""
    memory[_INTEGRAL] += excess * min(1.0, dt / p[_TRACKING])


@jit
def take_gains(memory: FloatArray, p: FloatArray, values: FloatArray) -> None:
    """Bumpless change of the proportional gain: the integral compensates it."""
    if memory[_STARTED] > 0.0:
        memory[_INTEGRAL] += (p[PROPORTIONAL] - values[PROPORTIONAL]) * memory[_LAST]


_PLAIN = stepping(FeedbackLaw(plain, hold, cut))


class Pid(FeedbackLink):
    """PID feedback as a link of the chain, Fang 2019 (PID).

    The integral is trapezoidal; the derivative is of the error, behind a first-order low-pass by
    the bilinear rule. Gains may be changed while running without a jump: the integral is kept in
    volts.

    Parameters
    ----------
    gains : PidGains
        The gains.
    dt : float
        Sampling interval [s].
    limits : Limits, optional
        As in `FeedbackLink`.
    """

    _kernel: ClassVar[Callable[..., float]] = staticmethod(_PLAIN)
    change = staticmethod(take_gains)

    def __init__(self, gains: PidGains, dt: float, *, limits: Limits | None = None) -> None:
        self._gains = gains
        super().__init__(dt, limits, self._kernel, self._pack(), PID_SIZE)

    @property
    def gains(self) -> PidGains:
        """Gains in force."""
        return self._gains

    def set_gains(self, gains: PidGains) -> None:
        """Change the gains without a jump; the integral compensates the difference."""
        self._gains = gains
        packed = self._pack()
        take_gains(self.memory[OWN:], self.packed, packed)
        self.packed[:] = packed

    def settable(self) -> tuple[str, ...]:
        """Return the parameters of its node that may change, in the order of its numbers."""
        return tuple(f'pid.{each.name}' for each in fields(PidGains))

    def _pack(self) -> FloatArray:
        return np.array(astuple(self._gains), dtype=np.float64)


_TABLES = ('proportional', 'integral')


class Tables(TypedDict):
    """The tables as `FuzzyRules` takes them."""

    proportional_rules: FloatArray
    integral_rules: FloatArray


def read_tables(path: str | Path) -> Tables:
    """Return the tables of a file like ``config/fuzzy/symmetric.yaml``."""
    try:
        content = plain_yaml.load_file(path)
    except (OSError, yaml.YAMLError) as error:
        reason = reason_of(error)
        raise CompensationError(f'the fuzzy tables {path} cannot be read: {reason}') from error
    if not isinstance(content, dict) or set(content) != set(_TABLES):
        raise CompensationError(f'{path}: fuzzy tables are a mapping of {" and ".join(_TABLES)}')
    proportional, integral = (_table(content[name], f'{path}: {name}') for name in _TABLES)
    return {'proportional_rules': proportional, 'integral_rules': integral}


def _table(content: object, what: str) -> FloatArray:
    if not isinstance(content, dict) or set(content) != set(LEVELS):
        raise CompensationError(f'{what} has one row for each error {", ".join(LEVELS)}')
    return np.array([_row(content[level], f'{what} {level}') for level in LEVELS])


def _row(content: object, what: str) -> list[float]:
    if not isinstance(content, list) or len(content) != len(LEVELS):
        raise CompensationError(f'{what} lists {len(LEVELS)} levels, for the rates NB to PB')
    return [_level(each, what) for each in content]


def _level(content: object, what: str) -> float:
    if content in LEVELS:
        return float(LEVELS.index(str(content)) - 3)
    if isinstance(content, int | float) and not isinstance(content, bool) and abs(content) <= 3:
        return float(content)
    raise CompensationError(f'{what}: {content!r} is no level; write {", ".join(LEVELS)} or -3..3')


LEVELS = ('NB', 'NM', 'NS', 'ZO', 'PS', 'PM', 'PB')

# Rows: error NB..PB, columns: rate of the error NB..PB; levels -3..3.
# A large growing error increases the proportional gain; a fast decreasing one reduces it.
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


# Places in the parameters behind the gains, then both tables, row by row.
_ERROR_SCALE, _RATE_SCALE, _PROPORTIONAL_RANGE, _INTEGRAL_RANGE = range(GAINS, GAINS + 4)
_PROPORTIONAL_RULES = GAINS + 4
_INTEGRAL_RULES = _PROPORTIONAL_RULES + 49


@jit
def level(rules: FloatArray, error: float, rate: float) -> float:
    """Return the output -1..1 of the rules for error and rate in -1..1 (clamped).

    Seven triangular sets that add up to one everywhere, product inference and weighted mean of
    the levels: this is bilinear interpolation of the table with 49 levels in row order.
    """
    x = (min(max(error, -1.0), 1.0) + 1.0) * 3.0
    y = (min(max(rate, -1.0), 1.0) + 1.0) * 3.0
    i, j = min(int(x), 5), min(int(y), 5)
    a, b, place = x - i, y - j, 7 * i + j
    levels = (
        (1.0 - a) * (1.0 - b) * rules[place]
        + a * (1.0 - b) * rules[place + 7]
        + (1.0 - a) * b * rules[place + 1]
        + a * b * rules[place + 8]
    )
    return float(levels / 3.0)


@inline_jit
def scheduled(error: float, memory: FloatArray, p: FloatArray, dt: float) -> float:
    """Return the share of the voltage [V] by gains that follow error and rate."""
    # The filtered slope of the tick before: the raw one is mostly noise.
    x, y = error / p[_ERROR_SCALE], memory[SLOPE] / p[_RATE_SCALE]
    levels = p[_PROPORTIONAL_RULES:_INTEGRAL_RULES]
    proportional = p[PROPORTIONAL] + p[_PROPORTIONAL_RANGE] * level(levels, x, y)
    integral = p[INTEGRAL] + p[_INTEGRAL_RANGE] * level(p[_INTEGRAL_RULES:], x, y)
    return pid(error, max(proportional, 0.0), max(integral, 0.0), memory, p, dt)


_FUZZY = stepping(FeedbackLaw(scheduled, hold, cut))


class FuzzyPid(Pid):
    """PID whose proportional and integral gain follow fuzzy rules, Fang 2019 (fuzzy PID).

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

    _kernel = staticmethod(_FUZZY)

    def __init__(
        self, gains: PidGains, rules: FuzzyRules, dt: float, *, limits: Limits | None = None
    ) -> None:
        self._rules = rules
        super().__init__(gains, dt, limits=limits)

    def settable(self) -> tuple[str, ...]:
        """Return the parameters of its node that may change, in the order of its numbers."""
        return (*super().settable(), *(f'fuzzy.{each.name}' for each in fields(FuzzyScales)))

    def _pack(self) -> FloatArray:
        rules = self._rules
        scales = [getattr(rules, each.name) for each in fields(FuzzyScales)]
        tables = (np.ravel(rules.proportional_rules), np.ravel(rules.integral_rules))
        return np.concatenate([super()._pack(), scales, *tables]).astype(np.float64)
