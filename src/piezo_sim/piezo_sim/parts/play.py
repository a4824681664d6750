"""Prandtl-Ishlinskii bank of play operators: nonlocal memory, congruent minor loops.

``v = linear_weight u + sum weight_j (q_j + asymmetry q_j^2)`` with the play q_j of
radius_j. Play is exact for any monotone piece of the voltage, so this part has no step error. The
quadratic envelope makes the operators asymmetric (generalised Prandtl-Ishlinskii).
"""

from __future__ import annotations

from typing import Any

from piezo_hysteresis.kernels.compile import inline_jit
from piezo_sim.plant_parameters import PlantEffect, PlantParameter

OPERATORS = 12

_RADII = (0.02, 0.12, 0.17, 0.27, 0.32, 0.47, 0.52, 0.67, 0.72, 0.82, 0.87, 0.95)
_WEIGHTS = (0.036, 0.015, 0.064, 0.036, 0.046, 0.032, 0.031, 0.056, 0.030, 0.069, 0.004, 0.0)

PARAMETERS = (
    PlantParameter('play.linear_weight', '1', 0.77, 0.0, 2.0, 'Share without hysteresis.'),
    *(
        PlantParameter(
            f'play.radius_{j + 1:02}', 'V', radius, 0.0, 1e4, f'Radius of operator {j + 1}.'
        )
        for j, radius in enumerate(_RADII)
    ),
    *(
        PlantParameter(
            f'play.weight_{j + 1:02}', '1', weight, 0.0, 2.0, f'Weight of operator {j + 1}.'
        )
        for j, weight in enumerate(_WEIGHTS)
    ),
    PlantParameter(
        'play.asymmetry', '1/V', 0.1, -10.0, 10.0, 'Curvature of the envelope functions.'
    ),
)

EFFECTS = (PlantEffect('play', 'Hysteresis with nonlocal memory (Prandtl-Ishlinskii).'),)


@inline_jit
def kink(memory: Any, start: float, end: float, d: Any) -> float:
    """Return the first voltage from `start` to `end` [V] at which an operator starts to move."""
    sign = 1.0 if end > start else -1.0
    nearest = abs(end - start)
    for j in range(d.play_count):
        ahead = sign * (memory[j] - start) + d.play_radius[j]
        if 0.0 < ahead < nearest:
            nearest = ahead
    return start + sign * nearest


@inline_jit
def move(memory: Any, voltage: float, d: Any, asymmetry: float) -> float:
    """Move every operator to `voltage` [V] and return the weighted sum [V]."""
    total = 0.0
    for j in range(d.play_count):
        radius = d.play_radius[j]
        q = min(max(memory[j], voltage - radius), voltage + radius)
        memory[j] = q
        total += d.play_weight[j] * (q + asymmetry * q * q)
    return total
