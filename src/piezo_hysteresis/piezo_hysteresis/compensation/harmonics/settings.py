"""What a user chooses about the attenuation of harmonics."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from piezo_hysteresis.errors import CompensationError

Method = Literal['afc', 'rls', 'filtered_rls']
SignRule = Literal['computed', 'printed', 'none']
Fit = Literal['sines', 'recursion']

_METHODS = ('afc', 'rls', 'filtered_rls')
_SIGN_RULES = ('computed', 'printed', 'none')
_FITS = ('sines', 'recursion')


@dataclass(frozen=True)
class AttenuationSettings:
    """Settings of `HarmonicAttenuation`.

    Attributes
    ----------
    method : {'afc', 'rls', 'filtered_rls'}
        ``afc``: complex-gain adaptive feedforward cancellation, which needs no sign rule;
        ``rls``: 000 (18)-(21); ``filtered_rls``: RLS on the reference filtered by the plant gain.
    orders : tuple of int
        Multiples of the fundamental to attenuate; 0 is the mean (``afc`` only).
    resonance : float
        Natural frequency whose orders ``round(fn / f)`` are added as the fundamental changes
        [Hz]; 0 adds none.
    settle : float
        ``afc``: seconds after each step of the correction that are not evaluated [s]; about two
        time constants of the mode.
    span : float
        ``afc``: seconds that are evaluated, rounded to whole periods, at least one [s].
    step_size : float
        ``afc``: share of the estimated error that one step removes, 0..1.
    largest_step : float
        ``afc``: bound on one step of an order's correction [V].
    largest_correction : float
        Bound on the correction amplitude of one order [V].
    forgetting : float
        ``rls``, ``filtered_rls``: forgetting factor per sample, 0.9..1; 000 gives none, i.e. 1.
    gain : float
        ``rls``: unit in which the error enters, and with it the strength of the feedback [V/m].
        000 gives no unit; 1/60e-6 V/m gives the 5 to 25 dB of its figures.
    fit : {'recursion', 'sines'}
        ``rls``: 000's recursion for y3 with c3, c4, or sines alone.
    sign_rule : {'computed', 'printed', 'none'}
        ``rls``: the complex factor computed from the plant gain, 000's (22)/(23) with the switch
        at `switch_frequency`, or ``e = y - d`` throughout.
    switch_frequency : float
        ``rls``, ``printed``: orders up to here use (22), above it (23) [Hz].
    """

    method: Method = 'afc'
    orders: tuple[int, ...] = (3,)
    resonance: float = 0.0
    settle: float = 0.3
    span: float = 0.25
    step_size: float = 0.9
    largest_step: float = 0.1
    largest_correction: float = 0.5
    forgetting: float = 0.9995
    gain: float = 1.0 / 60e-6
    fit: Fit = 'recursion'
    sign_rule: SignRule = 'computed'
    switch_frequency: float = 66.0

    def __post_init__(self) -> None:
        for name, value, choices in (
            ('method', self.method, _METHODS),
            ('sign_rule', self.sign_rule, _SIGN_RULES),
            ('fit', self.fit, _FITS),
        ):
            if value not in choices:
                raise CompensationError(
                    f'attenuation {name} {value!r} is not known; choose {", ".join(choices)}'
                )
        if any(order < 0 or order != int(order) for order in self.orders):
            raise CompensationError(
                f'orders must be whole numbers from 0, got {list(self.orders)}; e.g. [3] or [3, 5]'
            )
        positive = {
            'settle': self.settle,
            'span': self.span,
            'largest_step': self.largest_step,
            'largest_correction': self.largest_correction,
            'gain': self.gain,
        }
        for key, number in positive.items():
            if not (math.isfinite(number) and number > 0):
                raise CompensationError(f'attenuation {key} must be positive, got {number:g}')
        if not 0 < self.step_size <= 1:
            raise CompensationError(f'step_size must be in 0..1, got {self.step_size:g}')
        if not 0.9 <= self.forgetting <= 1:
            raise CompensationError(f'forgetting must be in 0.9..1, got {self.forgetting:g}')
