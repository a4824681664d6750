"""Creep and drift, updated once per interval from the mean of the drive over it."""

from __future__ import annotations

import math
from typing import Any

from piezo_hysteresis.kernels.compile import inline_jit
from piezo_sim.plant_parameters import PlantEffect, PlantParameter

KELVIN_VOIGT = 3
DECADES = 9  # elements of logarithmic creep, two per decade
ELEMENTS = KELVIN_VOIGT + DECADES

PARAMETERS = (
    *(
        row
        for j, gain, time in ((1, 0.03, 0.4), (2, 0.02, 4.0), (3, 0.02, 40.0))
        for row in (
            PlantParameter(
                f'creep.gain_{j}', '1', gain, 0.0, 1.0, f'Creep of element {j} in the end.'
            ),
            PlantParameter(
                f'creep.time_{j}', 's', time, 1e-3, 1e6, f'Time constant of element {j}.'
            ),
        )
    ),
    PlantParameter('log_creep.gain', '1', 0.015, 0.0, 0.5, 'Creep per decade of time.'),
    PlantParameter('log_creep.start', 's', 0.05, 1e-3, 1e3, 'Time at which it sets in.'),
    PlantParameter('drift.rate', 'm/s', 0.1e-6, -1e-3, 1e-3, 'Steady drift.'),
    PlantParameter('drift.warming', 'm', 2e-6, -1e-2, 1e-2, 'Shift by warming up, in the end.'),
    PlantParameter('drift.warming_time', 's', 60.0, 1e-2, 1e6, 'Time constant of warming up.'),
)

EFFECTS = (
    PlantEffect(
        'creep',
        'Kelvin-Voigt creep after the drive.',
        {f'creep.gain_{j}': 0.0 for j in range(1, KELVIN_VOIGT + 1)},
    ),
    PlantEffect('log_creep', 'Creep with the logarithm of time.', {'log_creep.gain': 0.0}),
    PlantEffect(
        'drift',
        'Thermal drift, independent of the drive.',
        {'drift.rate': 0.0, 'drift.warming': 0.0},
    ),
)


@inline_jit
def advance(p: Any, d: Any, s: Any, drive: float, dt: float) -> None:
    """Advance creep and drift over `dt` [s] in which the mean of the drive was `drive` [m]."""
    total = 0.0
    if d.creeping:
        for j in range(ELEMENTS):
            s.creep[j] += (d.creep_gain[j] * drive - s.creep[j]) * d.creep_share[j]
            total += s.creep[j]
    s.drift += p.drift.rate * dt
    if p.drift.warming != 0.0 or s.warmth != 0.0:
        s.warmth += (p.drift.warming - s.warmth) * -math.expm1(-dt / p.drift.warming_time)
    s.slow = total + s.drift + s.warmth
