"""Final limiter of the commanded voltage: range, slew, energy and finiteness."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.common.parameter_table import range_refusal
from piezo_hysteresis.compensation.link import OK, CompiledLaw, Limits
from piezo_hysteresis.errors import CompensationError
from piezo_hysteresis.jit import inline_jit, jit

# Share of the window in which the allowed slew decreases to the sustained value.
TAPER = 0.1


@dataclass(frozen=True)
class EnergyLimits:
    """Limit of the mean power of an amplifier.

    An amplifier charges a piezo actuator from its supply and discharges it to the other rail, so
    that the charge ``C |dV|`` passes the supply voltage U once per two changes: the mean power is
    ``P = C U <|dV/dt|> / 2``. For a periodic voltage with one rise and one fall of Vpp per period
    this is the well-known ``P = C f U Vpp`` of the makers' data sheets.
    """

    power: float = 0.0  # largest running mean of P [W]; 0 sets no limit
    capacitance: float = 1e-6  # C of the actuator at large signals [F]
    window: float = 1.0  # time constant of the exponential running mean [s]
    supply: float = 2.4  # U, the span between the rails in volts of the chain [V]

    @property
    def sustained_slew(self) -> float:
        """Sustained mean of ``|dV/dt|`` [V/s]."""
        return 2.0 * self.power / (self.capacitance * self.supply) if self.power else math.inf


def packed_energy(limits: EnergyLimits, dt: float) -> tuple[float, float, float]:
    """Return power [W], share of a tick in the mean, and power of a volt in a tick [W/V]."""
    values = (limits.power, limits.capacitance, limits.window, limits.supply)
    if not all(math.isfinite(value) for value in values):
        raise CompensationError('the energy limit must be finite; give 0 W for none')
    if limits.power < 0.0:
        raise CompensationError(f'energy_limit must not be negative, got {limits.power:g} W')
    if min(values[1:]) <= 0.0:
        raise CompensationError('capacitance, window and supply voltage must be positive')
    capacitance, window, supply = map(float, values[1:])
    share, per_volt = energy_numbers(capacitance, window, supply, dt)
    if not slow_enough(share):
        raise CompensationError(
            f'the window of the energy limit is too short: {limits.window:g} s is less than '
            f'eleven samples of {dt:g} s'
        )
    return limits.power, share, per_volt


@jit
def energy_numbers(
    capacitance: float, window: float, supply: float, dt: float
) -> tuple[float, float]:
    """Return the share of a tick in the mean, and the power of a volt in a tick [W/V]."""
    return dt / window, 0.5 * capacitance * supply / dt


@jit
def slow_enough(share: float) -> bool:
    """Return whether the window is long enough for the bound of `largest_change`."""
    return bool(share * (1.0 + 1.0 / TAPER) <= 1.0)


@inline_jit
def largest_change(mean: float, power: float, per_volt: float) -> float:
    """Return the largest change that the next sample may make [V].

    The mean is ``p[k] = p[k-1] + (dt / T) (q[k] - p[k-1])`` with ``q = C U |dV| / (2 dt)``. A
    change may spend ``q <= P + (T / S) (P - p[k-1])`` with S a tenth of T: bursts from rest may
    have eleven times the sustained rate, and the bound decreases smoothly as the mean rises. As
    ``p[k] <= p[k-1] + (dt / T + dt / S) (P - p[k-1])``, the mean never exceeds P.
    """
    if power == 0.0:
        return math.inf
    # A limit that was lowered leaves the mean above it: hold while it falls.
    return max(0.0, power + (power - mean) / TAPER) / per_volt


COUNTS = ('not_finite', 'out_of_range', 'slew_limited', 'energy_limited')

# Places in the memory: the last voltage [V], the mean power [W], and the counts in their order.
VOLTAGE, MEAN, _NOT_FINITE, _OUT_OF_RANGE, _SLEW_LIMITED, _ENERGY_LIMITED = range(6)
LIMITER_SIZE = 6
# Places in the settings; a power of 0 is none.
LOW, HIGH, STEP, POWER, SHARE, PER_VOLT = range(6)


@inline_jit
def approach(goal: float, memory: FloatArray, settings: FloatArray) -> float:
    """Move towards `goal` [V] within the limits of slew and energy; return the voltage."""
    before, step, reason = memory[VOLTAGE], settings[STEP], _SLEW_LIMITED
    affordable = largest_change(memory[MEAN], settings[POWER], settings[PER_VOLT])
    if affordable < step:
        step, reason = affordable, _ENERGY_LIMITED
    if abs(goal - before) > step:
        goal = before + math.copysign(step, goal - before)
        memory[reason] += 1.0
    memory[VOLTAGE] = goal
    spent = settings[PER_VOLT] * abs(goal - before)
    memory[MEAN] += settings[SHARE] * (spent - memory[MEAN])
    return goal


@jit
def limit(voltage: float, memory: FloatArray, settings: FloatArray) -> float:
    """Return the safe voltage nearest to `voltage` [V]; what is no number is held."""
    if not math.isfinite(voltage):
        memory[_NOT_FINITE] += 1.0
        voltage = memory[VOLTAGE]
    low, high = settings[LOW], settings[HIGH]
    if voltage > high or voltage < low:
        voltage = min(max(voltage, low), high)
        memory[_OUT_OF_RANGE] += 1.0
    return approach(voltage, memory, settings)


@jit
def ramp(rest: float, pace: float, memory: FloatArray, settings: FloatArray) -> float:
    """Return the next voltage on the way to `rest` [V], `pace` [V] a tick or slower."""
    goal = min(max(rest, settings[LOW]), settings[HIGH])
    pace = min(pace, settings[STEP])
    distance = goal - memory[VOLTAGE]
    if abs(distance) > pace:
        goal = memory[VOLTAGE] + math.copysign(pace, distance)
    return approach(goal, memory, settings)


def require_limits(limits: Limits) -> None:
    """Refuse limits that are none.

    Raises
    ------
    CompensationError
        If the range is empty, the slew not positive, or any of them not finite.
    """
    if reason := range_refusal(limits.low, limits.high):
        raise CompensationError(reason)
    if not 0.0 < limits.slew < math.inf:
        raise CompensationError(
            f'the slew limit must be positive and finite, got {limits.slew:g} V/s; give the '
            'largest change that the amplifier follows'
        )


def packed_limits(limits: Limits, dt: float, energy: EnergyLimits | None = None) -> FloatArray:
    """Return the settings of the kernels.

    Raises
    ------
    CompensationError
        If they are impossible.
    """
    require_limits(limits)
    power, share, per_volt = (0.0, 0.0, 0.0) if energy is None else packed_energy(energy, dt)
    return np.array([limits.low, limits.high, limits.slew * dt, power, share, per_volt])


def limiter_law(dt: float) -> CompiledLaw:  # [s]
    """Return the limiter as kernels, for C."""

    @inline_jit
    def step(given: FloatArray, received: float, memory: FloatArray, numbers: FloatArray) -> float:
        return limit(received, memory, numbers)

    @inline_jit
    def reset(memory: FloatArray, numbers: FloatArray) -> None:
        reset_limiter(0.0, memory, numbers)

    @inline_jit
    def take(
        values: FloatArray, bounds: FloatArray, memory: FloatArray, numbers: FloatArray,
        first: bool,
    ) -> int:  # fmt: skip
        numbers[LOW], numbers[HIGH], numbers[STEP] = bounds[0], bounds[1], bounds[2] * dt
        numbers[POWER], span = bounds[3], bounds[1] - bounds[0]
        numbers[SHARE], numbers[PER_VOLT] = energy_numbers(bounds[4], bounds[5], span, dt)
        return OK

    return CompiledLaw('limiter', step, reset, take, ())


@jit
def reset_limiter(voltage: float, memory: FloatArray, numbers: FloatArray) -> None:
    """Start at the safe voltage that is nearest to `voltage` [V], with every counter at 0."""
    for k in range(LIMITER_SIZE):
        memory[k] = 0.0
    memory[VOLTAGE] = min(max(voltage, numbers[LOW]), numbers[HIGH])


class Limiter:
    """Limits range, slew and mean power of a voltage sample by sample, and counts its actions.

    Parameters
    ----------
    limits : Limits
        Range [V] and slew [V/s].
    dt : float
        Sampling interval [s].
    voltage : float
        The voltage at which it starts [V]; clamped to the range.
    energy : EnergyLimits, optional
        Mean power; without one there is no limit.

    Raises
    ------
    CompensationError
        If the range is empty, the slew or `dt` not positive, or any of them not finite.
    """

    def __init__(
        self, limits: Limits, dt: float, voltage: float = 0.0, energy: EnergyLimits | None = None
    ) -> None:
        if not (math.isfinite(dt) and dt > 0):
            raise CompensationError(f'the sampling interval must be positive, got {dt:g} s')
        self.dt = dt
        self._memory = np.zeros(LIMITER_SIZE)
        self._settings = np.zeros(PER_VOLT + 1)
        self.retune(limits, energy)
        self.reset(voltage)

    def retune(self, limits: Limits, energy: EnergyLimits | None = None) -> None:
        """Take other limits over while running; counters and the last voltage stay.

        A last voltage beyond the new range is brought in at the slew limit, not by a jump.

        Raises
        ------
        CompensationError
            If they are impossible; the ones before then stay in force.
        """
        self._settings[:] = packed_limits(limits, self.dt, energy)
        self.limits = limits
        if energy is None:
            self._memory[MEAN] = 0.0

    def reset(self, voltage: float = 0.0) -> None:
        """Restart at `voltage` [V], clamped to the range, with every counter at 0."""
        start = float(voltage) if math.isfinite(voltage) else 0.0
        reset_limiter(start, self._memory, self._settings)

    def follow(self, voltage: float) -> None:
        """Set the last voltage [V], after another source has changed it."""
        if math.isfinite(voltage):
            self._memory[VOLTAGE] = voltage

    @property
    def voltage(self) -> float:
        """The last safe voltage that it answered [V]."""
        return float(self._memory[VOLTAGE])

    @property
    def mean_power(self) -> float:
        """Running mean of the power that the voltage takes [W]; 0 without energy limits."""
        return float(self._memory[MEAN])

    def apply(self, voltage: float) -> float:
        """Return the safe voltage nearest to `voltage` [V].

        What is not a number is refused: the last safe voltage is held and ``not_finite`` counted.
        """
        return limit(float(voltage), self._memory, self._settings)

    def ramp_to(self, rest: float, rate: float) -> float:
        """Return the next voltage on the way to `rest` [V] at `rate` [V/s]; once per tick.

        Never faster than the slew limit, and counted as limited only where the energy limit slows
        the ramp.
        """
        return ramp(float(rest), float(rate) * self.dt, self._memory, self._settings)

    def counters(self) -> dict[str, int]:
        """Return how many samples were refused or limited, by the names of `COUNTS`."""
        own = self._memory[_NOT_FINITE:]
        return {name: int(count) for name, count in zip(COUNTS, own, strict=True)}
