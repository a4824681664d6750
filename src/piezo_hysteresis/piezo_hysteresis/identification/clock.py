"""Sampling offset of new records relative to that of a model file.

A delay of whole samples is no sampling offset, because records number their samples. Between
recordings the time between voltage and displacement of a sample may differ by a small amount, and
by the uncertainty of the identified offset.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from piezo_hysteresis.identification.fit import fit
from piezo_hysteresis.identification.objective import SAMPLING_OFFSET
from piezo_hysteresis.identification.targets import Target
from piezo_hysteresis.models import Model, ModelFile

#: Difference of the sampling offset between two recordings of one set-up, as a share of a sample:
#: a driver that reads and writes in every tick does both within a tenth of it.
JITTER = 0.1
# Standard deviations of the identified offset that are added to it, and the upper limit of the sum
# as a share of a sample: beyond half a sample the next sample is nearer.
_DEVIATIONS = 2.0
_MOST = 0.5


class Unsaved(NamedTuple):
    """A model with its clock that is no file, since its values may be invalid."""

    model: Model
    values: Mapping[str, float]
    sampling_offset: float
    sampling_offset_std: float


def clock_about(
    given: ModelFile | Unsaved, dt: float, jitter: float = JITTER
) -> tuple[float, float]:  # dt [s]; jitter [1]
    """Return the range of the sampling offset of new records [s].

    At most half a sample, because sample numbers count whole samples. The full half sample is
    allowed where a chain without inertia has a fitted offset: it then represents dynamics faster
    than a sample, which are not distinguishable from a sampling offset.
    """
    known = _DEVIATIONS * given.sampling_offset_std / dt
    part = given.sampling_offset_std > 0.0 and given.model.answers_at_once
    reach = (_MOST if part else min(jitter + known, _MOST)) * dt
    return given.sampling_offset - reach, given.sampling_offset + reach


def clock_of(given: ModelFile | Unsaved, views: Sequence[Target]) -> float:
    """Return the sampling offset at which a model fits the records best [s].

    It is within `clock_about`. The identified offset is returned if the model cannot be
    simulated.
    """
    bounds = clock_about(given, min(view.dt for view in views))
    found = fit(
        given.model,
        (),
        {**given.values, SAMPLING_OFFSET: given.sampling_offset},
        free=(),
        targets=views,
        sampling_offset=True,
        bounds={SAMPLING_OFFSET: bounds},
        max_evaluations=20,
    )
    late = found.sampling_offset
    return late if found.residuals and np.isfinite(late) else given.sampling_offset
