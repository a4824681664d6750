"""How a link of the voltage chain is, from its counters and the sign of its sensor."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum

from piezo_hysteresis.common.node_sheet import CounterWatch, Finding, Health, Level, judge
from piezo_hysteresis.compensation.limiter import Limiter
from piezo_hysteresis.compensation.linear_gain import ModeGain
from piezo_hysteresis.compensation.link import Limits
from piezo_hysteresis.compensation.operating_limits import limited


@dataclass
class Watchdog:
    """Counts the ticks of the actuator without a command from this link.

    Time is that of the actuator: in lock-step it stops while a command is missing, so that slow
    processes do not trigger the watchdog.
    """

    limiter: Limiter  # limiter of the link; its voltage is ramped
    timeout: int  # ticks without a command before the ramp starts; 0 disables it
    safe_voltage: float  # target voltage [V]
    ramp: float  # rate [V/s]
    stale: bool = False  # whether the input is missing
    episodes: int = 0  # number of timeouts
    newest: int = -1  # newest tick with a command, -1 before the first
    _arrived: bool = False

    def received(self, sample: int) -> None:
        """Record the command for tick `sample`."""
        self.newest = sample
        self.stale = self._arrived = False

    def reset(self) -> None:
        """Wait for the first command again."""
        self.newest = -1
        self.stale = self._arrived = False

    def voltage(self, tick: int) -> float | None:
        """Return the command for `tick` [V], None if there is none to publish.

        The link stops publishing once it has reached the safe voltage: the receiving node then
        detects the broken chain and applies its own safe voltage.
        """
        if not self.overdue(tick) or self._arrived:
            return None
        if not self.stale:
            self.stale = True
            self.episodes += 1
        limits = self.limiter.limits
        voltage = self.limiter.ramp_to(self.safe_voltage, self.ramp)
        self._arrived = voltage == min(max(self.safe_voltage, limits.low), limits.high)
        return voltage

    def overdue(self, tick: int) -> bool:
        """Return whether `tick` comes too late after the newest command."""
        return 0 < self.timeout < tick - self.newest and self.newest >= 0


# Counters that are not 0 while a law has switched itself off.
ALARMS = {
    'inverted_plant': 'the actuator answers with the opposite sign: check the sensor or amplifier',
    'reversed_sensor': 'the displacement moves against the voltage, other than the law expects: '
    'the loop is not closed; correct the sign at the sensor or amplifier',
    'still_sensor': 'the displacement does not follow the voltage: the loop is not closed; check '
    'the sensor and its unit',
    'diverged': 'the loop swings between its limits: lower the gains',
    'faded_out': 'the correction made the error larger than it is without it: it has faded out '
    'and tries again, see backed_off; check model_file or plant.gain and plant.natural_frequency',
}

_SENTENCES: dict[str, Finding] = {
    'refused': (Level.ERROR, 'what came in is not a number: the voltage is held'),
    'refused_references': (Level.ERROR, 'the reference is not a number: the last one is held'),
    'measured_not_finite': (Level.WARN, 'the sensor answers what is not a number'),
    'law_reset': (Level.ERROR, 'the law returned a value that is not finite and was reset'),
    'late': (Level.WARN, 'input comes after its tick: the machine is too slow'),
    'missed': (Level.WARN, 'ticks are missing in the input'),
    'dropped': (Level.WARN, 'ticks are dropped: their reference never came'),
    'strays': (Level.WARN, 'input is numbered far from the rest: is there a second source?'),
    'reordered': (Level.WARN, 'input came out of order: is there a second source?'),
    'stamp_jumps': (Level.WARN, 'time stamps of the input jump: the numbers of the samples hold'),
    'out_of_stroke': (Level.WARN, 'the reference lies beyond the stroke of the model'),
    'clamped_slopes': (Level.WARN, 'the model has no inverse here: its slope is clamped'),
    'frozen': (Level.WARN, 'the sensor repeats the same reading'),
    'stuck_sensor': (
        Level.ERROR,
        'the sensor is stuck: its reading is constant while the voltage moves; check the sensor',
    ),
    'backed_off': (Level.ERROR, 'the correction increased the error: it restarts from 0'),
    'reverted': (Level.WARN, 'a step of the correction made the error larger and was taken back'),
}

# How serious it is that the limiter acts; its sentences are those of `limited`.
_LIMITED = {
    'out_of_range': Level.ERROR, 'slew_limited': Level.WARN, 'energy_limited': Level.WARN
}  # fmt: skip

INACTIVE = 'inactive: passes the voltage on'
CORRECTS = 'corrects the voltage'
SWITCHED_OFF = 'switched off: passes the voltage on'
CHECKING = 'passes the voltage on until it has moved and the sign of the sensor is known'

# Time without input after which it is reported [s].
SILENCE = 2.0


class LinkHealth:
    """Judges a link; remembers which counters have grown lately."""

    def __init__(self, limits: Limits, now: Callable[[], float] = time.monotonic) -> None:
        # now [s]
        self._now = now
        self._watch = CounterWatch(_SENTENCES, now)
        self._sample: object = -1
        self._since = now()
        self.set_limits(limits)

    def set_limits(self, limits: Limits) -> None:
        """Name `limits` where the voltage is limited."""
        sentences = limited(limits)
        self._watch.sentences = {
            **_SENTENCES, **{name: (level, sentences[name]) for name, level in _LIMITED.items()}
        }  # fmt: skip

    def judge(
        self,
        numbers: Mapping[str, object],
        counts: Mapping[str, int],
        watchdog: Watchdog,
        paused: bool = False,
        known: Sequence[Finding] = (),
        work: str = CORRECTS,
    ) -> Health:
        """Return the health that `numbers` (with ``sample`` and ``active``) and `counts` make.

        Input that stays away is an error, or, where its sender is `paused`, to be looked at.
        `known` are findings that hold while the node runs; `work` is what an active one does.
        """
        findings = [*known, *self._watch.findings(counts)]
        findings += [
            (Level.ERROR, message) for name, message in ALARMS.items() if counts.get(name)
        ]
        if watchdog.stale:
            message = f'no input since tick {watchdog.newest}: the voltage is ramped to safety'
            if paused:
                findings.append((Level.WARN, f'{message}; publisher alive but silent'))
            else:
                findings.append((Level.ERROR, f'{message}; its sender has gone'))
        if numbers['sample'] != self._sample:
            self._sample, self._since = numbers['sample'], self._now()
        silent = self._now() - self._since
        if numbers['sample'] == -1:
            fine = 'waits for the first tick'
        elif silent > SILENCE and not watchdog.stale:
            findings.append((Level.WARN, f'no tick for {silent:.0f} s: the loop has stopped'))
            fine = ''
        else:
            fine = work if numbers['active'] else INACTIVE
        return judge(findings, fine, {**numbers, **counts})


# Readings that differ by less, relative to themselves, are equal: the last bit of a float32.
LAST_BIT = 1.2e-7
# The sensor is stuck after this time [s], if the voltage has moved by this share of its largest
# magnitude in that time.
STUCK_AFTER = 0.1
_MOVED = 0.02


class StuckSensor:
    """Counts the ticks at which a sensor is stuck."""

    def __init__(self, dt: float) -> None:  # dt [s]
        self.ticks = 0
        self._needed = max(20, math.ceil(STUCK_AFTER / dt))
        self._reading, self._equal = math.nan, 0
        self._low = self._high = self._largest = 0.0

    def update(self, voltage: float, displacement: float) -> None:
        """Take the voltage [V] and the displacement [m] of one tick."""
        if not abs(displacement - self._reading) <= LAST_BIT * abs(self._reading):
            self._reading, self._equal = displacement, 0
            self._low = self._high = voltage
            return
        self._equal += 1
        self._low, self._high = min(self._low, voltage), max(self._high, voltage)
        self._largest = max(self._largest, abs(voltage))
        moved = self._high - self._low > _MOVED * self._largest
        self.ticks += moved and self._equal >= self._needed


# Slow parts of voltage and displacement are compared: below this share of the natural frequency
# (or this frequency [Hz] where it is not known) the plant delays by much less than half a period.
_SHARE_OF_MODE, _WITHOUT_MODE = 0.3, 16.0
# The voltage has moved enough if the rms of its slow part is this share of the range of the
# voltage (a sinusoid of 0.7 % of it), and at least so much of its rms as a whole.
_SENSOR_SIGN_MOVED, _SLOW = 0.005, 0.5
# Correlations and slopes, relative to the expected one, from which the sensor is right or not.
_RIGHT, _WRONG, _LEAST_SLOPE, _STILL = 0.5, -0.7, 0.1, 0.05
# What speaks against the sensor must last so long [s]; older data count less after [s]; a loop
# whose voltage does not move is closed after [s].
_LASTS, _MEMORY, _TIMEOUT = 0.1, 2.0, 2.0


class Sign(Enum):
    """What is known of a sensor."""

    UNKNOWN = 'unknown'
    RIGHT = 'right'
    REVERSED = 'reversed'
    STILL = 'still'


class SensorSign:
    """Compares the displacement with the voltage until the sign of the sensor is known."""

    def __init__(self, dt: float) -> None:  # dt [s]
        self._dt = dt
        self._plant: ModeGain | None = None
        self._share = 1.0
        self._least = math.inf
        self._least_ticks = 0
        self.reset()

    def reset(self) -> None:
        """Discard all data."""
        self.found = Sign.UNKNOWN
        self._against = self._ticks = 0
        self._asked: int | None = None
        self._first: tuple[float, float] | None = None
        self._slow_v = self._slow_y = 0.0
        self._weight = self._v = self._vv = self._y = self._yy = self._vy = 0.0
        self._raw = self._raw_square = 0.0

    def expect(self, plant: ModeGain, span: float) -> None:  # span [V]
        """Set what is expected."""
        self._least = (_SENSOR_SIGN_MOVED * span) ** 2
        if plant == self._plant:
            return
        before, self._plant = self._plant, plant
        if self.found is Sign.RIGHT and before is not None and before.gain * plant.gain > 0.0:
            return
        corner = _SHARE_OF_MODE * plant.natural_frequency or _WITHOUT_MODE
        self._share = min(1.0, 2.0 * math.pi * corner * self._dt)
        self._least_ticks = max(20, math.ceil(3.0 / self._share))
        self.reset()

    def may_close(self) -> bool:
        """Return whether a loop may act now; it waits a time for a voltage that moves."""
        if self._asked is None:
            self._asked = self._ticks
        is_over = (self._ticks - self._asked) * self._dt >= _TIMEOUT
        if self.found is Sign.UNKNOWN and (is_over or self._plant is None):
            self.found = Sign.RIGHT
        return self.found is Sign.RIGHT

    def update(self, voltage: float, displacement: float) -> None:
        """Take the voltage [V] and the displacement [m] of one tick."""
        if self.found is not Sign.UNKNOWN or not math.isfinite(voltage + displacement):
            return
        if self._first is None:
            self._first = voltage, displacement
        v, y = voltage - self._first[0], displacement - self._first[1]
        self._slow_v += self._share * (v - self._slow_v)
        self._slow_y += self._share * (y - self._slow_y)
        keep, slow_v, slow_y = 1.0 - min(1.0, self._dt / _MEMORY), self._slow_v, self._slow_y
        self._ticks += 1
        self._weight = keep * self._weight + 1.0
        self._raw = keep * self._raw + v
        self._raw_square = keep * self._raw_square + v * v
        self._v = keep * self._v + slow_v
        self._y = keep * self._y + slow_y
        self._vv = keep * self._vv + slow_v * slow_v
        self._yy = keep * self._yy + slow_y * slow_y
        self._vy = keep * self._vy + slow_v * slow_y
        if self._ticks >= self._least_ticks:
            self._judge()

    def _judge(self) -> None:
        n = self._weight
        moved = self._vv / n - (self._v / n) ** 2
        whole = self._raw_square / n - (self._raw / n) ** 2
        if self._plant is None or moved < max(self._least, _SLOW**2 * whole):
            self._against = 0
            return
        answered = max(0.0, self._yy / n - (self._y / n) ** 2)
        both = math.copysign(1.0, self._plant.gain) * (self._vy / n - self._v * self._y / n**2)
        expected = 0.0 if math.isinf(self._plant.gain) else abs(self._plant.gain)
        correlation = both / math.sqrt(moved * answered) if answered > 0.0 else 0.0
        slope = both / moved
        if correlation >= _RIGHT and slope >= _LEAST_SLOPE * expected:
            self.found = Sign.RIGHT
            return
        opposite = correlation <= _WRONG and slope <= -_LEAST_SLOPE * expected
        still = answered <= (_STILL * expected) ** 2 * moved
        self._against = self._against + 1 if opposite or still else 0
        if self._against * self._dt >= _LASTS:
            self.found = Sign.REVERSED if opposite else Sign.STILL

    def counters(self) -> dict[str, int]:
        """Return what is found, 1 where it holds."""
        return {
            'reversed_sensor': int(self.found is Sign.REVERSED),
            'still_sensor': int(self.found is Sign.STILL),
        }
