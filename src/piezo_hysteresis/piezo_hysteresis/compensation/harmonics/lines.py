"""Lines of a periodic signal, and the settings of their attenuation."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple, get_args

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.common.parameter_table import documented, judge, setting
from piezo_hysteresis.compensation.linear_gain import gain_at
from piezo_hysteresis.compensation.link import Limits
from piezo_hysteresis.errors import CompensationError
from piezo_hysteresis.jit import inline_jit, jit, scratch


class Harmonic(NamedTuple):
    """Estimate of one order.

    Attributes
    ----------
    order : int
        Multiple of the fundamental; 0 is the mean.
    error_amplitude : float
        Amplitude of the tracking error y - d at that order [m].
    error_phase : float
        Its phase: the error is ``amplitude cos(order phi + phase)`` [rad].
    correction_amplitude : float
        Amplitude of the correction [V].
    correction_phase : float
        Its phase [rad].
    """

    order: int
    error_amplitude: float
    error_phase: float
    correction_amplitude: float
    correction_phase: float


# Highest order near a resonance, and largest number of orders that it adds.
HIGHEST, MOST = 75, 6
# Highest frequency of an order that is chosen by itself, as a share of the rate, and the smallest
# gain there, as a share of that at 0 Hz.
_SHARE_OF_RATE, _FOLLOWED = 0.25, 0.025
# About so many multiplications of a factorisation are made in one tick, twice those of adding a
# sample to a fit of 64 orders.
_WORK = 16000


@inline_jit
def folded(frequency: float, dt: float) -> float:
    """Return the signed frequency in -1/(2 dt) .. 1/(2 dt) that sampling makes of `frequency`."""
    rate = 1.0 / dt
    return frequency - rate * round(frequency / rate)


@jit
def fill_resonant(
    frequency: float, natural_frequency: float, dt: float, highest: int, orders: FloatArray
) -> int:
    """Fill the orders that a resonance amplifies, most amplified first; return their number.

    ``round(fn / f)`` and its neighbours, odd ones first, as a symmetric hysteresis generates them.
    Orders with an alias at the resonance are included: 19 x 49 Hz at 1 kHz appears at 69 Hz.
    """
    count, most = 0, orders.size
    if frequency <= 0.0 or natural_frequency <= 0.0:
        return 0
    distances = scratch(most)
    for order in range(2, highest + 1):
        distance = abs(abs(folded(order * frequency, dt)) - natural_frequency)
        distance *= 1.0 if order % 2 else 1.25
        if not distance < 0.3 * natural_frequency:
            continue
        place = count
        while place > 0 and distances[place - 1] > distance:
            place -= 1
        if place >= most:
            continue
        count = min(count + 1, most)
        for k in range(count - 1, place, -1):
            distances[k], orders[k] = distances[k - 1], orders[k - 1]
        distances[place], orders[place] = distance, order
    return count


@jit
def fill_followed(frequency: float, g: FloatArray, dt: float, orders: FloatArray) -> int:
    """Fill the lowest orders that a plant of packed gain `g` follows; return their number.

    Above a quarter of the rate the gain of a held voltage falls to 0, and its inverse would turn
    noise into voltage; the same holds where the plant answers little.
    """
    count, order = 0, 1
    least = _FOLLOWED * abs(gain_at(0.0, g))
    while count < orders.size and order * frequency <= _SHARE_OF_RATE / dt:
        if abs(gain_at(order * frequency, g)) >= least:
            orders[count] = order
            count += 1
        order += 1
        if order > 10 * orders.size:
            break
    return count


@jit
def fill_separable(
    orders: FloatArray, frequency: float, dt: float, span: float, kept: FloatArray
) -> int:
    """Fill those of `orders` that a fit over `span` seconds can separate; return their number.

    Two orders whose sampled images fall closer together than one line of the span, or an order on
    0 or the Nyquist frequency, would make the fit singular.
    """
    resolution, nyquist = 0.6 / span, 0.5 / dt
    count = 0
    lines = scratch(orders.size + 1)
    for i in range(orders.size):
        line = abs(folded(orders[i] * frequency, dt)) if orders[i] > 0.0 else 0.0
        apart = orders[i] == 0.0 or (line <= nyquist - resolution and line >= resolution)
        for k in range(count):
            if kept[k] == orders[i] and orders[i] > 0.0:
                apart = False
            if orders[i] > 0.0 and kept[k] > 0.0 and not abs(line - lines[k]) >= resolution:
                apart = False
        if apart:
            kept[count], lines[count] = orders[i], line
            count += 1
    return count


@inline_jit
def fill_basis(phase: float, orders: FloatArray, basis: FloatArray) -> None:
    """Write 1, cos(n phase), -sin(n phase) per order into `basis`, shape (1 + 2 orders,)."""
    basis[0] = 1.0
    for i in range(orders.size):
        angle = orders[i] * phase
        basis[1 + 2 * i] = math.cos(angle)
        basis[2 + 2 * i] = -math.sin(angle)


@inline_jit
def accumulate(
    error: float, phase: float, orders: FloatArray, basis: FloatArray, normal: FloatArray
) -> None:
    """Add one sample to the normal equations of m unknowns.

    `normal` holds the rows of a square of m + 1, one after another; the last one those of the
    error.
    """
    fill_basis(phase, orders, basis)
    m = basis.size
    last = m * (m + 1)
    for i in range(m):
        row, value = i * (m + 1), basis[i]
        for j in range(i + 1):
            normal[row + j] += value * basis[j]
        normal[last + i] += value * error
    normal[last + m] += error * error


@jit
def factor(normal: FloatArray, m: int, count: float, first: int) -> int:
    """Factor the normal equations of `m` unknowns in place (Cholesky), from row `first` on.

    A fit of many orders is spread over ticks, so that none takes much longer than the others.
    """
    size, work, i = m + 1, 0, first
    while i < size and work < _WORK:
        row = i * size
        for j in range(i + 1):
            total, other = normal[row + j], j * size
            for k in range(j):
                total -= normal[row + k] * normal[other + k]
            if j < i:
                normal[row + j] = total / normal[other + j]
            elif i < m:
                # A slight ridge: a window cut short by a frequency step must not fail.
                total += 1e-12 * count
                normal[row + j] = math.sqrt(total) if total > 0.0 else math.nan
            else:
                normal[row + j] = math.sqrt(total) if total > 0.0 else 0.0 * total
        work += i * i
        i += 1
    return i


@jit
def solve_normal(normal: FloatArray, count: float, solution: FloatArray) -> float:
    """Solve normal equations that `factor` has factored."""
    m = solution.size
    size = m + 1
    for i in range(m - 1, -1, -1):
        total = normal[m * size + i]
        for k in range(i + 1, m):
            total -= normal[k * size + i] * solution[k]
        solution[i] = total / normal[i * size + i]
    sound = math.isfinite(normal[m * size + m])
    for i in range(m):
        sound = sound and math.isfinite(solution[i])
    if not sound:
        for i in range(m):
            solution[i] = 0.0
        return math.inf
    residual = normal[m * size + m] ** 2 / max(count - m, 1.0)
    return math.sqrt(residual * 2.0 / max(count, 1.0))


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
#: Settings that may change at run time, by place.
LIVE = {
    'settle': SETTLE, 'span': SPAN, 'step_size': STEP_SIZE, 'largest_step': LARGEST_STEP,
    'largest_correction': LARGEST, 'forgetting': FORGETTING, 'gain': ERROR_GAIN,
    'switch_frequency': SWITCH,
}  # fmt: skip
