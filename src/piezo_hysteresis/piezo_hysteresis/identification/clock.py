"""The clock of records beside that of a model file: one rule for all who judge such a model.

A delay of a whole sample is no clock: records count their samples. What may differ from one
recording to the next is how long after the voltage of a sample the displacement is read,
by a little, and what the identified records left undetermined of it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from piezo_hysteresis.identification.fit import fit
from piezo_hysteresis.identification.objective import SAMPLING_OFFSET
from piezo_hysteresis.identification.targets import Target
from piezo_hysteresis.models import ModelFile

#: Share of a sample by which two recordings of one set-up may differ in when they read the
#: displacement: a driver that reads and writes in every tick does both within a tenth of it.
JITTER = 0.1
# Standard deviations of the identified offset that count beside it, and the share of a sample that
# both together never exceed: beyond half a sample the next one is nearer.
_DEVIATIONS = 2.0
_MOST = 0.5


def clock_about(given: ModelFile, dt: float, jitter: float = JITTER) -> tuple[float, float]:
    """Return between what the sampling offset of new records may lie [s].

    Half a sample at most, as sample numbers count whole ones. As much as that where a chain that
    answers at once has an offset that was fitted: it stands for what takes less than a sample, and
    more of it cannot be distinguished from a clock.

    Parameters
    ----------
    given : ModelFile
        Whose offset it is about; one that does not say how well it is known is taken to know the
        sample only.
    dt : float
        Sampling interval of the new records [s].
    jitter : float
        Share of a sample by which recordings may differ [1].
    """
    known = _DEVIATIONS * given.sampling_offset_std / dt
    part = given.sampling_offset_std > 0.0 and given.model.answers_at_once
    reach = (_MOST if part else min(jitter + known, _MOST)) * dt
    return given.sampling_offset - reach, given.sampling_offset + reach


def clock_of(given: ModelFile, views: Sequence[Target]) -> float:
    """Return the sampling offset with which the model of a file fits views best [s].

    Within `clock_about`; that of the file where the model cannot be run on them.
    """
    bounds = clock_about(given, min(view.dt for view in views))
    start = {**given.values, SAMPLING_OFFSET: given.sampling_offset}
    found = fit(
        given.model,
        (),
        start,
        free=(),
        targets=views,
        sampling_offset=True,
        bounds={SAMPLING_OFFSET: bounds},
        max_evaluations=20,
    )
    late = found.sampling_offset
    return late if found.residuals and np.isfinite(late) else given.sampling_offset
