"""What a user chooses about the attenuation of harmonics."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.common.parameter_table import documented, judge, setting
from piezo_hysteresis.compensation.link import Limits
from piezo_hysteresis.errors import CompensationError

Method = Literal['afc', 'rls']
SignRule = Literal['computed', 'printed', 'none']
Fit = Literal['recursion', 'sines']

# Bounds on a step and on a correction as shares of the voltage range.
_STEP, _CORRECTION = 1.0 / 24.0, 5.0 / 24.0
# Time constants of the mode that a step settles, and bounds of that time [s].
_DECAYS, _SHORTEST, _LONGEST = 2.5, 0.02, 0.3
#: The order that stands for all that the plant follows.
EVERY = -1

METHODS: tuple[str, ...] = get_args(Method)


@documented
@dataclass(frozen=True)
class AttenuationSettings:
    """Settings of `HarmonicAttenuation`, and the parameters of the node that runs it.

    Raises
    ------
    CompensationError
        If one is impossible, or the method would ignore it.
    """

    method: Method = setting(
        'afc',
        'afc is adaptive feedforward cancellation by complex gain, which needs no sign rule; rls '
        'is Fujii 2018 (18)-(21).',
        choices=METHODS,
    )
    orders: tuple[int, ...] = setting(
        (-1,),
        'Harmonic orders to attenuate; 0 is the mean and -1 that and all orders that the plant '
        'follows, up to the 64th and a quarter of the rate; rls needs them by number, or takes by '
        '-1 the harmonic of each drive from a model identified per frequency.',
        '1',
        low=-1,
        high=99,
    )
    resonance: float = setting(
        0.0,
        'afc: natural frequency whose orders round(fn / f) are added as the fundamental changes; '
        '0 adds none.',
        'Hz',
        low=0.0,
        high=1e5,
    )
    settle: float = setting(
        0.0,
        'afc: waiting time after each step of the correction; 0 takes two and a half time '
        'constants of the mode, at most 0.3 s, which holds without a model too.',
        's',
        low=0.0,
        high=60.0,
    )
    span: float = setting(
        0.25,
        'afc: evaluated time, rounded to whole periods, at least one.',
        's',
        above=0.0,
        high=60.0,
    )
    step_size: float = setting(
        0.9, 'afc: fraction of the error that one step removes.', '1', above=0.0, high=1.0
    )
    first_step: float = setting(
        1.0,
        'afc: fraction of that step until one observation has confirmed the gain of the '
        'plant; at most 0.05 for an unknown plant.',
        '1',
        above=0.0,
        high=1.0,
    )
    largest_step: float = setting(
        0.0,
        'afc: bound on one step of an order; 0 takes 1/24 of the voltage range.',
        'V',
        low=0.0,
        high=2000.0,
    )
    largest_correction: float = setting(
        0.0,
        'Bound on the correction amplitude of one order; 0 takes 5/24 of the voltage range.',
        'V',
        low=0.0,
        high=2000.0,
    )
    forgetting: float = setting(
        0.9995,
        'rls: forgetting factor per sample; Fujii 2018 uses none, which is 1.',
        '1',
        low=0.9,
        high=1.0,
    )
    gain: float = setting(
        16666.7,
        'rls: gain from error to voltage; Fujii 2018 states no unit, and the default attenuates '
        'by up to 22 dB on its actuator.',
        'V/m',
        above=0.0,
        high=1e12,
    )
    fit: Fit = setting(
        'recursion',
        "rls: Fujii 2018's recursion for the harmonic with c3 and c4, or sines alone.",
        choices=get_args(Fit),
    )
    sign_rule: SignRule = setting(
        'computed',
        'rls: sign of the error: computed from the plant gain, printed as Fujii 2018 (22), (23), '
        'none.',
        choices=get_args(SignRule),
    )
    switch_frequency: float = setting(
        66.0,
        'rls, printed: orders up to this frequency use Fujii 2018 (22), above it (23); 66 Hz '
        'is from the paper.',
        'Hz',
        low=0.0,
        high=1e5,
    )

    def __post_init__(self) -> None:
        reason = judge(self) or self._ignored()
        if reason:
            raise CompensationError(f'attenuation: {reason}')

    def only(self, order: int) -> AttenuationSettings:
        """Return the settings for one order, with 0 for none."""
        return replace(self, orders=(order,) if order else ())

    def within(self, limits: Limits, decay: float = math.inf) -> AttenuationSettings:
        """Return the settings with all that is chosen by itself.

        Parameters
        ----------
        limits : Limits
            Of the voltage, for the bounds on step and correction.
        decay : float
            Time constant of the mode [s], infinite for an unknown one.
        """
        span = limits.high - limits.low
        return replace(
            self,
            settle=self.settle or min(max(_DECAYS * decay, _SHORTEST), _LONGEST),
            largest_step=self.largest_step or _STEP * span,
            largest_correction=self.largest_correction or _CORRECTION * span,
        )

    def _ignored(self) -> str:
        """Return '' if the method uses all given settings, else the remedy."""
        if self.method == 'afc':
            return ''
        if 0 in self.orders or (self.automatic and len(self.orders) > 1):
            return (
                f'method {self.method} has neither the mean, order 0, nor order -1 among others; '
                'omit it, as in [3], before the method is chosen, or take method afc'
            )
        if self.resonance > 0.0:
            return (
                f'method {self.method} adds no orders of a resonance; set resonance to 0 and '
                'write them into orders, or take method afc'
            )
        return ''

    @property
    def automatic(self) -> bool:
        """Whether the orders are all that the plant follows."""
        return EVERY in self.orders

    @property
    def packed(self) -> FloatArray:
        """Numbers that the kernels of the laws read, by the places below; the orders come last."""
        own = [
            self.settle, self.span, self.step_size, self.largest_step, self.largest_correction,
            self.forgetting, self.gain, float(self.fit == 'recursion'),
            float(get_args(SignRule).index(self.sign_rule)), self.switch_frequency, self.resonance,
            float(0 in self.orders or self.automatic), self.first_step, float(self.automatic),
        ]  # fmt: skip
        return np.array([*own, *(order for order in self.orders if order > 0)], dtype=np.float64)


# Places in the packed settings.
(
    SETTLE, SPAN, STEP_SIZE, LARGEST_STEP, LARGEST, FORGETTING, ERROR_GAIN, RECURSIVE, SIGN_RULE,
    SWITCH, RESONANCE, WITH_MEAN, FIRST_STEP, AUTOMATIC, ORDERS,
) = range(15)  # fmt: skip
COMPUTED, PRINTED = 0.0, 1.0
