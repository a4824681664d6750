"""What the actuator went through before each record of an investigation.

Creep, heat and fatigue outlast an experiment and its conditioning. But all that was commanded
since the first experiment is known, and between two of them the actuator rests at 0 V. So a model
is led through that before a record begins, on one clock for all of them, and what it says of slow
states is carried from one record to the next: nothing more has to be known, nor waited for.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.records import Record

# What was longer ago is left out [s]: what is slower than that looks like a zero, and every record
# is simulated with all that went before it.
LONGEST = 60.0


class History:
    """The records so far as one course of the voltage."""

    def __init__(self) -> None:
        self._last: Record | None = None
        self._zero = 0.0

    @property
    def known(self) -> bool:
        """Whether the actuator is where the last record left it."""
        return self._last is not None

    def forget(self) -> None:
        """Note that the actuator did something else since the last record."""
        self._last = None

    def following(self, record: Record) -> Record:
        """Return a record with what went before it, and remember it.

        Parameters
        ----------
        record : Record
            The next one, which begins at rest at 0 V; its start is read on the clock of the
            actuator. If it lies before the end of the last one, that clock was started anew and
            nobody knows what went before.
        """
        start, before = record.start - self._zero, None
        if self._last is not None:
            rest = round((start - self._last.start) / record.dt) - len(self._last)
            before = self._gone_through(rest, round(LONGEST / record.dt)) if rest >= 0 else None
        if before is None:
            self._zero, start = record.start, 0.0
        begins = record.info.start if before is None else 'step'
        info = replace(record.info, start=begins)
        self._last = replace(record, start=start, before=before, info=info)
        return self._last

    def _gone_through(self, rest: int, most: int) -> FloatArray:
        """Return at most so many ticks before a record that follows the last one after a rest."""
        assert self._last is not None
        known = (self._last.before, self._last.voltage, np.zeros(min(rest, most)))
        return np.concatenate([part for part in known if part is not None])[-most:]
