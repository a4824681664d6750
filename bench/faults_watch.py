"""Evaluates the loop from the messages of an observer: voltage, tracking, recorded samples.

Used by `bench/faults.py`.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

from bench.live_loop import NODES, Setting, wait_until
from bench.live_observer import Observed, State
from piezo_hysteresis.records.bag_content import read_content
from piezo_hysteresis.records.damage import DamageLog
from piezo_hysteresis.records.definitions import STATE

Key = tuple[int, float, float]

# An rms error of this share of the amplitude still counts as tracking, as a busy machine is late;
# that of an actuator that stands still is 0.7.
TRACKS = 0.5


class Watch:
    """Answers questions about the loop."""

    def __init__(self, seen: Observed, setting: Setting) -> None:
        self._seen = seen
        self._setting = setting
        self._bound = math.inf

    def mark(self) -> int:
        """Return the number of samples that have been seen."""
        return len(self._seen.states)

    def discard(self, before: float) -> None:
        """Drop the samples that arrived before a time [s]."""
        states = self._seen.states
        del states[: next((k for k, s in enumerate(states) if s.arrived >= before), len(states))]

    # --- voltage -------------------------------------------------------------------------------

    def voltage(self, first: int) -> tuple[float, float, float]:
        """Return excess over the limits [V] and jumps of voltage and command since `first`.

        Jumps are in multiples of what the slew allows from tick to tick. An actuator that is
        restarted is at 0 V before its tick 0, whichever of its ticks is received first.
        """
        s = self._setting
        states = self._seen.states[max(0, first - 1) :]
        beyond = max((max(x.voltage - s.high, s.low - x.voltage) for x in states), default=0.0)
        jump = max((self._jump(a, b, b.voltage) for a, b in pairwise(states)), default=0.0)
        command_jump = 0.0
        for a, b in pairwise(states):
            command = self._seen.commands.get(b.sample)
            if command is not None and a.life == b.life == states[-1].life:
                command_jump = max(command_jump, self._jump(a, b, command))
        return max(0.0, beyond), jump, command_jump

    def _jump(self, before: State, after: State, voltage: float) -> float:
        s = self._setting
        anew = after.life != before.life
        ticks = after.sample + 1 if anew else after.sample - before.sample
        change = abs(voltage - (0.0 if anew else before.voltage))
        return change / (ticks * s.slew / s.rate)

    # --- tracking ------------------------------------------------------------------------------

    def error(self) -> float:
        """Return the rms tracking error over the newest period [m]; nan where it has gaps.

        An excitation that lags behind leaves ticks out; those say nothing about the tracking.
        """
        states = self._seen.states[-self._setting.period :]
        if len(states) < self._setting.period or states[0].life != states[-1].life:
            return math.nan
        references = self._seen.references
        pairs = [(state.displacement, references.get(state.sample)) for state in states]
        squares = [(there - wanted) ** 2 for there, wanted in pairs if wanted is not None]
        if 2 * len(squares) < len(states):
            return math.nan
        return math.sqrt(sum(squares) / len(squares))

    def state(self) -> str:
        """Say where the loop is."""
        seen, newest = self._seen, self._seen.states[-1]
        return (
            f'tick {newest.sample} at {newest.voltage:g} V, newest reference for '
            f'{max(seen.references)} and command for {max(seen.commands)}, error '
            f'{self.error():.3g} m where {self._bound:.3g} m are allowed'
        )

    def settle(self, since: float, timeout: float) -> bool:
        """Wait until all nodes publish and the error is small, or at first no longer decreases."""

        def steady() -> bool:
            return all(self._seen.received.get(name, 0.0) > since for name in NODES)

        end = time.monotonic() + timeout
        if not wait_until(steady, timeout):
            return False
        before = math.inf
        while time.monotonic() < end:
            time.sleep(2.0 / self._setting.frequency)
            now = self.error()
            if now <= self._bound < math.inf:
                return True
            if now > 0.9 * before and math.isinf(self._bound):
                self._bound = max(2.0 * max(now, before), TRACKS * self._setting.amplitude)
                return True
            before = now if math.isfinite(now) else math.inf
        return False

    def back(self, since: float, target: str, timeout: float) -> tuple[float | None, float | None]:
        """Wait until the loop tracks as before, on samples that are all newer than `since`."""
        received: list[float] = []
        back: list[float] = []

        def done() -> bool:
            if not received and self._seen.received.get(target, 0.0) > since:
                received.append(self._seen.received[target] - since)
            if not received and target in NODES:
                return False
            states = self._seen.states[-self._setting.period :]
            if states and states[0].arrived > since and self.error() <= self._bound:
                back.append(states[0].arrived - since)
                return True
            return False

        wait_until(done, timeout)
        return (back[0] if back else None), (received[0] if received else None)

    # --- recorder ------------------------------------------------------------------------------

    def lost(self, bag: Path, asked: float, killed: bool) -> tuple[int, float]:
        """Return how many samples miss in a bag, and what a kill took of its end [s].

        Counted are the samples that were seen from the first one in the bag until the recorder
        was asked to end. One that was killed could not write what it had not flushed: that is
        distinguished, as time.
        """
        content = read_content(bag, DamageLog(True)).of_type(STATE)
        columns = [[*part.column(n).tolist()] for part in content for n in _FIELDS]
        held = list(zip(*columns, strict=True)) if columns else []
        seen = [s for s in self._seen.states if s.arrived <= asked]
        return missing(held, seen, killed)


_FIELDS = ('sample', 'voltage', 'displacement')


def _key(sample: int, voltage: float, displacement: float) -> Key:
    """Return the identity of a sample; NaN of a failed sensor becomes inf, which equals itself."""
    return sample, voltage, math.inf if math.isnan(displacement) else displacement


def missing(held: Sequence[Key], seen: Sequence[State], killed: bool) -> tuple[int, float]:
    """Return how many of the samples `seen` are not `held` though they should be.

    Samples before the connection of the recorder are not counted: those before its first sample in
    the run in which it started, and in every later run of the actuator. Nor is the last tick of a
    run: an actuator that is killed while it publishes may have reached only some subscribers.
    """
    # killed [s]
    have = {_key(*each) for each in held}
    there = [_key(s.sample, s.voltage, s.displacement) in have for s in seen]
    if not any(there):
        return (0 if killed else len(seen)), 0.0
    tail = next(k for k, held_too in enumerate(reversed(there)) if held_too) if killed else 0
    end = len(seen) - tail
    lost, connected = 0, {seen[there.index(True)].life: False}
    lasts = {k for k, (a, b) in enumerate(pairwise(seen)) if a.life != b.life}
    for k, (state, held_too) in enumerate(zip(seen[:end], there[:end], strict=True)):
        # At 0 V all runs of the actuator begin alike: such a sample may be that of another run.
        if held_too and state.voltage != 0.0:
            connected[state.life] = True
        elif held_too:
            continue
        elif connected.get(state.life, False) and k not in lasts:
            lost += 1
    awaiting_first_heartbeat = {s.life for s in seen[:end]} - connected.keys()
    lost += sum(s.life in awaiting_first_heartbeat and s.life > min(connected) for s in seen[:end])
    return lost, (seen[-1].arrived - seen[end].arrived if tail else 0.0)
