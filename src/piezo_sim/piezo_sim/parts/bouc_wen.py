"""Asymmetric Bouc-Wen hysteresis of any exponent, integrated along the voltage.

With eta in volts and the saturation voltage ``eta_s = alpha / (beta + gamma)``::

    d eta = (alpha + asymmetry sgn(dv)) dv
            - (beta |dv| eta + gamma dv |eta|) |eta / eta_s|^(exponent - 1)

which for the exponent 1 is Zhou 2021 (2), and Fujii 2018 (1) with its A0 as `asymmetry`. Scaling
by eta_s keeps the height of the loop the same for every exponent. The law does not depend on time,
so it is integrated along the voltage (Runge-Kutta of order four), in steps that are short against
the voltage scale and that end where eta changes sign, where the right-hand side has a kink.
"""

from __future__ import annotations

import math
from typing import Any

from piezo_hysteresis.kernels.compile import inline_jit
from piezo_sim.plant_parameters import PlantEffect, PlantParameter

PARAMETERS = (
    PlantParameter(
        'bouc_wen.alpha', '1', 0.4, 0.0, 5.0, 'Share of the hysteresis in the small slope.'
    ),
    PlantParameter('bouc_wen.beta', '1/V', 1.2, 0.0, 1e4, 'Dissipation of the hysteresis.'),
    PlantParameter('bouc_wen.gamma', '1/V', 0.3, -1e4, 1e4, 'Shape of the hysteresis.'),
    PlantParameter('bouc_wen.exponent', '1', 2.0, 1.0, 10.0, 'Exponent n.'),
    PlantParameter(
        'bouc_wen.asymmetry', '1', 0.1, -1.0, 1.0, 'Difference of rising and falling voltage, A0.'
    ),
)

EFFECTS = (
    PlantEffect('bouc_wen', 'Hysteresis with local memory (Bouc-Wen).'),
    PlantEffect(
        'hysteresis_exponent', 'The Bouc-Wen exponent differs from 1.', {'bouc_wen.exponent': 1.0}
    ),
)

STRIDE = 0.1  # largest step, in units of the voltage scale
_TINY = 1e-300


@inline_jit
def _slope(eta: float, sign: float, p: Any, saturation: float) -> float:
    size = abs(eta)
    if p.exponent != 1.0:
        size *= (size / saturation) ** (p.exponent - 1.0)
    same = 1.0 if eta * sign > 0.0 else -1.0
    return float(p.alpha + sign * p.asymmetry - (same * p.beta + p.gamma) * size)


@inline_jit
def _stride(eta: float, step: float, sign: float, p: Any, saturation: float) -> float:
    """Return eta after `step` [V] in the direction `sign`."""
    d = sign * step
    k1 = _slope(eta, sign, p, saturation)
    k2 = _slope(eta + 0.5 * d * k1, sign, p, saturation)
    k3 = _slope(eta + 0.5 * d * k2, sign, p, saturation)
    k4 = _slope(eta + d * k3, sign, p, saturation)
    return eta + d * (k1 + 2.0 * k2 + 2.0 * k3 + k4) / 6.0


@inline_jit
def _to_zero(eta: float, step: float, sign: float, p: Any, saturation: float) -> float:
    """Return the part of `step` [V] after which eta is 0, by regula falsi (Illinois)."""
    low, high = 0.0, step
    at_low, at_high = eta, _stride(eta, step, sign, p, saturation)
    for _ in range(50):
        middle = (low * at_high - high * at_low) / (at_high - at_low)
        value = _stride(eta, middle, sign, p, saturation)
        if abs(value) <= 1e-14 * saturation or high - low <= 1e-15 * step:
            return middle
        if value * at_high < 0.0:
            low, at_low = high, at_high
        else:
            at_low *= 0.5
        high, at_high = middle, value
    return high


@inline_jit
def move(eta: float, start: float, end: float, p: Any, stride: float) -> float:
    """Return eta [V] after a monotone change of the voltage from `start` to `end` [V].

    `stride` is the longest step in units of the voltage scale.
    """
    if end == start or p.alpha == 0.0:
        return eta
    sign = 1.0 if end > start else -1.0
    scale = max((p.beta + abs(p.gamma)) * p.exponent, _TINY)
    saturation = max(p.alpha + abs(p.asymmetry), _TINY) / max(p.beta + p.gamma, _TINY)
    length = abs(end - start)
    strides = math.ceil(length * scale / stride)
    step = length / max(strides, 1)
    for _ in range(max(strides, 1)):
        after = _stride(eta, step, sign, p, saturation)
        if eta * after < 0.0:
            first = _to_zero(eta, step, sign, p, saturation)
            after = _stride(0.0, step - first, sign, p, saturation)
        eta = after
    return eta
