"""What happened before a record began: its remanence is part of the memory of the hysteresis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.records import Record

_RAMP = 1.0  # time from one level to the next [s]


def preceded(record: Record, levels: Sequence[float]) -> Record:
    """Return the record with ramps through `levels` before it, in its warm-up.

    A model starts from the virgin state, an actuator hardly ever does: what it rests at depends
    on the last extremes of its voltage. With those known or guessed, the beginning of a record
    can be fitted too.

    Parameters
    ----------
    record : Record
        A measured record.
    levels : sequence of float
        Extremes of the voltage before the record, in order [V]; the ramps start at 0 V and end at
        the first voltage of the record.

    Returns
    -------
    Record
        Longer at the front; its errors count from where the measurement begins, or from the end
        of its own warm-up.

    Raises
    ------
    IdentificationError
        If a level is not finite.
    """
    if not np.all(np.isfinite(levels)):
        raise IdentificationError('the levels before a record must be finite voltages')
    count = round(_RAMP / record.dt)
    points = [0.0, *levels, float(record.voltage[0])]
    before = np.concatenate(
        [np.linspace(a, b, count, endpoint=False) for a, b in pairwise(points)]
    )
    warm_up = before.size * record.dt + record.info.warm_up
    reference = record.reference
    if reference is not None:
        reference = np.concatenate([np.full(before.size, reference[0]), reference])
    return replace(
        record,
        voltage=np.concatenate([before, record.voltage]),
        displacement=np.concatenate(
            [np.full(before.size, record.displacement[0]), record.displacement]
        ),
        reference=reference,
        start=record.start - before.size * record.dt,
        info=replace(record.info, warm_up=warm_up),
    )
