"""Preisach hysteresis with the exact memory of its reversal points (return-point memory).

The Everett function of the model is closed form, with x half the width and m the centre of a
branch::

    E(a, b) = 2 G(x) c(m),  x = (a - b) / 2,  m = (a + b) / 2
    G(x) = weight (x - scale (1 - exp(-x / scale))),  c(m) = 1 + asymmetry m - curvature m^2

Its density ``(G'' c + 2 curvature G) / 2`` of relays between -1/2 and 1/2 is positive wherever c
is, so the model is a genuine Preisach model, and none of Prandtl-Ishlinskii where c varies: minor
loops at different centres are not congruent in height. The memory is a stack of reversal points; a
branch that passes the last but one wipes both out (Madelung's rules). There is no grid of relays
and so no step error.
"""

from __future__ import annotations

import math
from typing import Any

from piezo_hysteresis.kernels.compile import inline_jit
from piezo_sim.plant_parameters import PlantEffect, PlantParameter

DEPTH = 128

PARAMETERS = (
    PlantParameter('preisach.linear_weight', '1', 0.75, 0.0, 2.0, 'Share without hysteresis.'),
    PlantParameter('preisach.weight', '1', 0.45, 0.0, 5.0, 'Weight of the hysteretic share.'),
    PlantParameter('preisach.scale', 'V', 0.6, 1e-6, 1e4, 'Typical coercive voltage.'),
    PlantParameter(
        'preisach.asymmetry', '1/V', 0.05, -10.0, 10.0, 'Change of the density with bias.'
    ),
    PlantParameter(
        'preisach.curvature', '1/V^2', 0.02, 0.0, 100.0, 'Fall of the density with bias.'
    ),
)

EFFECTS = (PlantEffect('preisach', 'Hysteresis with nonlocal memory (Preisach).'),)


@inline_jit
def _everett(high: float, low: float, p: Any) -> float:
    x, m = 0.5 * (high - low), 0.5 * (high + low)
    g = p.weight * (x + p.scale * math.expm1(-x / p.scale))
    return float(2.0 * g * (1.0 + p.asymmetry * m - p.curvature * m * m))


@inline_jit
def _branch(s: Any, voltage: float, p: Any) -> float:
    """Return the output [V] on the present branch; the virgin curve has no reversal yet."""
    if s.depth == 0:
        sign = 1.0 if voltage >= 0.0 else -1.0
        return sign * 0.5 * _everett(abs(voltage), -abs(voltage), p)
    last = s.turn[s.depth - 1]
    if voltage >= last:
        return float(s.level[s.depth - 1]) + _everett(voltage, last, p)
    return float(s.level[s.depth - 1]) - _everett(last, voltage, p)


@inline_jit
def kink(s: Any, start: float, end: float) -> float:
    """Return the first voltage between `start` and `end` [V] where the slope jumps, or `end`."""
    if s.depth >= 2:
        point = s.turn[s.depth - 2]
    elif s.depth == 1:
        point = -s.turn[0]
    else:
        return end
    return float(point) if min(start, end) < point < max(start, end) else end


@inline_jit
def move(s: Any, voltage: float, p: Any) -> float:
    """Move the memory to `voltage` [V] along a monotone piece and return the output [V]."""
    if voltage == s.position:
        return _branch(s, voltage, p)
    direction = 1 if voltage > s.position else -1
    if s.direction == -direction:
        level = _branch(s, s.position, p)
        if s.depth == DEPTH:  # discard the innermost, smallest loop
            s.depth -= 2
        s.level[s.depth] = level
        s.turn[s.depth] = s.position
        s.depth += 1
    s.direction = direction
    while s.depth >= 2 and (voltage - s.turn[s.depth - 2]) * direction >= 0.0:
        s.depth -= 2
    if s.depth == 1 and abs(voltage) >= abs(s.turn[0]):
        s.depth = 0
    s.position = voltage
    return _branch(s, voltage, p)
