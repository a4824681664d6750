"""Health status of the simulated actuator from its counters."""

from __future__ import annotations

import time
from collections.abc import Callable

from piezo_hysteresis.common.health import CounterWatch, Finding, Health, Level, judge
from piezo_sim.nodes.pacing import CommandQueue

_SENTENCES: dict[str, Finding] = {
    'refused': (Level.WARN, 'commands are refused: not a number, beyond the range or far ahead'),
    'late': (Level.WARN, 'commands come after their tick: the machine or a link is too slow'),
    'missed': (Level.WARN, 'ticks had no command: the voltage before was held'),
    'overruns': (Level.WARN, 'ticks were late themselves: the machine is too slow'),
    'stamp_jumps': (Level.WARN, 'time stamps of commands jump: only their numbers count'),
    'slew_limited': (Level.WARN, 'commands jump or come late: they are slowed down to the slew'),
}


class ActuatorHealth:
    """Evaluates the health of a simulator; keeps track of counters that increased recently."""

    def __init__(self, now: Callable[[], float] = time.monotonic) -> None:  # now [s]
        self._watch = CounterWatch(_SENTENCES, now)

    def judge(
        self, book: CommandQueue, tick: int, fault: str, waited: float, remark: str = ''
    ) -> Health:  # waited [s]
        """Return the health of an actuator."""
        findings = self._watch.findings(book.counts)
        if fault != 'none':
            findings.append((Level.ERROR, f'fault {fault} is injected'))
        if book.timed_out and book.received:
            message = f'no commands: the voltage goes to {book.safe_voltage:g} V'
            findings.append((Level.ERROR, message))
        if waited > 0.0:
            findings.append((Level.WARN, f'no command for tick {tick} since {waited:.0f} s'))
        if remark:
            findings.append((Level.WARN, remark))
        values = {'sample': tick, 'voltage_V': book.voltage, 'fault': fault, **book.counts}
        return judge(findings, 'runs' if tick else 'waits for the first command', values)
