"""How a link of the voltage chain is, from its counters."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from piezo_hysteresis.common.node_sheet import CounterWatch, Finding, Health, Level, judge
from piezo_hysteresis.compensation.limiter import Limiter
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
