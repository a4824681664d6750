"""Voltage history of the actuator before each record of an investigation.

Creep, heat and fatigue outlast an experiment and its conditioning. All commands since the first
experiment are known, and the actuator rests at one voltage between experiments. The model is
therefore simulated through this history before each record, on one common clock, and its slow
states carry over from one record to the next without a waiting time. What the actuator did
before the first experiment is unknown, so the initial state of each record is estimated until the
known history is as long as it counts: otherwise creep after earlier motion appears as drift.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.records import Record

# Length of the history before a record [s]: every record is simulated with its history, and a
# slower state is indistinguishable from a zero offset.
LONGEST = 60.0


class History:
    """The records so far as one continuous voltage signal."""

    def __init__(self, rest: float = 0.0) -> None:  # rest [V]
        self._rest = rest
        self._last: Record | None = None
        self._zero = 0.0

    @property
    def known(self) -> bool:
        """Whether the state of the actuator follows from the last record."""
        return self._last is not None

    def discard(self) -> None:
        """Discard the history, because the actuator received other commands."""
        self._last = None

    def following(self, record: Record) -> Record:
        """Return a record with its voltage history, and append it to the history.

        The initial state of a record is estimated unless its history is known for `LONGEST`.
        """
        start, before = record.start - self._zero, None
        if self._last is not None:
            rest = round((start - self._last.start) / record.dt) - len(self._last)
            before = self._voltage_before(rest, round(LONGEST / record.dt)) if rest >= 0 else None
        if before is None:
            self._zero, start = record.start, 0.0
        begins = 'step' if before is not None and start >= LONGEST else 'estimate'
        info = replace(record.info, start=begins)
        self._last = replace(record, start=start, before=before, info=info)
        return self._last

    def _voltage_before(self, rest: int, most: int) -> FloatArray:
        """Return the voltage before a record that starts after `rest` ticks at rest.

        The voltage is limited to the last `most` ticks.
        """
        assert self._last is not None
        known = (self._last.before, self._last.voltage, np.full(min(rest, most), self._rest))
        found = np.concatenate([part for part in known if part is not None])[-most:]
        earlier = most - found.size if self._rest else 0
        return np.concatenate([np.full(earlier, self._rest), found])
