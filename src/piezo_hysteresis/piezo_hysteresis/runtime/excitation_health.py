"""Health of the excitation node, from its task and the nodes that it waits for."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from piezo_hysteresis.common.health import CounterWatch, Finding, Health, Level, judge

_SENTENCES: dict[str, Finding] = {
    'missed': (Level.WARN, 'ticks of the actuator were not received: they had no reference'),
    'strays': (Level.WARN, 'states are numbered far from the others: is there a second actuator?'),
    'reordered': (Level.WARN, 'states come out of order: is there a second actuator?'),
    'stamp_jumps': (Level.WARN, 'time stamps of states jump: the numbers of the samples hold'),
    'limited': (
        Level.WARN,
        'commands are held back to slew: they come late, or are planned faster',
    ),
    'restarts': (Level.WARN, 'the actuator was restarted'),
    'sweeps_refused': (Level.WARN, 'a sweep was refused'),
    'sweeps_failed': (Level.ERROR, 'a sweep did not come to its end'),
}

# Silence of the actuator that is reported during an experiment [s].
SILENCE = 2.0


@dataclass(frozen=True)
class Doing:
    """Present task of the node."""

    what: str  # the experiment or the record of a sweep; empty for none
    waits: str  # node that it waits for; empty for none
    given_up: str  # reason why the last experiment was aborted; empty if it was not
    silent: float  # time since the last actuator state [s]
    sample: int  # newest tick of the actuator, -1 for none


class ExcitationHealth:
    """Evaluates the health of an excitation, including recently increased counters."""

    def __init__(self, now: Callable[[], float] = time.monotonic) -> None:  # now [s]
        self._watch = CounterWatch(_SENTENCES, now)

    def judge(self, doing: Doing, counts: Mapping[str, int], last: str) -> Health:
        """Return the health for the task `doing`; `last` is the outcome of the last sweep."""
        findings = self._watch.findings(counts)
        if doing.given_up:
            findings.append((Level.ERROR, doing.given_up))
        if doing.waits:
            findings.append((Level.WARN, f'waits for {doing.waits}'))
        elif doing.what and doing.silent > SILENCE:
            message = f'no actuator/state for {doing.silent:.0f} s after tick {doing.sample}'
            findings.append((Level.WARN, message))
        rest = 'idle' if doing.sample >= 0 else 'idle, no actuator state received yet'
        values = {'sample': doing.sample, 'last_sweep': last, **counts}
        return judge(findings, doing.what or rest, values)
