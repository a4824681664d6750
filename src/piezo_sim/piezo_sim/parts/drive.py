"""Ceramic: strain that drives the structure, in metres, as a function of the voltage.

Bouc-Wen, play bank and Preisach model each contribute their deviation from a straight line, so
that they can be switched separately or together. The strain depends only on the path of the
voltage, except for the rate dependence and for the loss of polarization, which reduces the gain
with time. The rate dependence widens the loops with the logarithm of the voltage rate (thermally
activated creep of domain walls) or with a power of it (the coercive field by Ishibashi and
Orihara; for viscous walls the power is 1). A loop is widened by multiplying the lag of the strain
behind its steepest slope.
"""

from __future__ import annotations

import math
from typing import Any

from piezo_hysteresis.kernels.compile import inline_jit
from piezo_sim.parts import bouc_wen, play, preisach
from piezo_sim.plant_parameters import PlantEffect, PlantParameter

PARAMETERS = (
    PlantParameter(
        'actuator.gain', 'm/V', 100e-6, 1e-12, 1.0, 'Displacement per volt before losses.'
    ),
    PlantParameter(
        'rate_dependence.widening',
        '1',
        0.08,
        0.0,
        0.3,
        'Widening of the loop per e-fold of rate; by the power law, that at the reference.',
    ),
    PlantParameter(
        'rate_dependence.exponent',
        '1',
        0.0,
        0.0,
        1.5,
        'Power of the rate with which the loop widens; 0 for its logarithm.',
    ),
    PlantParameter(
        'rate_dependence.reference',
        'V/s',
        4.0,
        1e-6,
        1e9,
        'Voltage rate at which widening sets in.',
    ),
    PlantParameter(
        'rate_dependence.memory',
        's',
        5e-3,
        1e-6,
        10.0,
        'Time constant of the filtered voltage rate.',
    ),
    PlantParameter(
        'electrostriction.coefficient', '1/V', 0.03, -10.0, 10.0, 'Square law of the voltage.'
    ),
    PlantParameter('depolarisation.loss', '1', 0.1, 0.0, 0.9, 'Gain lost in the end.'),
    PlantParameter(
        'depolarisation.time_constant', 's', 20.0, 1e-2, 1e6, 'Time constant of the loss.'
    ),
    PlantParameter(
        'heating.gain', '1', 0.05, -0.9, 10.0, 'Change of the gain at the reference rate.'
    ),
    PlantParameter(
        'heating.reference', 'V/s', 100.0, 1e-6, 1e9, 'Rms voltage rate it is given for.'
    ),
    PlantParameter('heating.time_constant', 's', 3.0, 1e-3, 1e6, 'Of warming and cooling.'),
    PlantParameter(
        'backlash.half_width',
        'm',
        1e-6,
        0.0,
        1e-2,
        'Half the lost motion between ceramic and lever.',
    ),
)

EFFECTS = (
    PlantEffect(
        'rate_dependence',
        'Loops widen with the logarithm or a power of the voltage rate.',
        {'rate_dependence.widening': 0.0},
    ),
    PlantEffect(
        'electrostriction',
        'A strain with the square of the voltage.',
        {'electrostriction.coefficient': 0.0},
    ),
    PlantEffect(
        'asymmetry',
        'Rising and falling branches differ.',
        {'bouc_wen.asymmetry': 0.0, 'play.asymmetry': 0.0, 'preisach.asymmetry': 0.0},
    ),
    PlantEffect('gain_decay', 'The gain falls with time.', {'depolarisation.loss': 0.0}),
    PlantEffect(
        'self_heating',
        'Losses, with the square of the voltage rate, warm the ceramic and change its gain.',
        {'heating.gain': 0.0},
        exotic=True,
    ),
    PlantEffect('backlash', 'Lost motion in the drive.', {'backlash.half_width': 0.0}),
)


@inline_jit
def start_interval(p: Any, s: Any, dt: float) -> bool:
    """Update the values that are constant over an interval of `dt` [s]: filtered rate and gain.

    Returns whether the drive must be computed again.
    """
    before = s.widening + s.loss + s.residue + s.heat
    if p.heating.gain != 0.0 or s.heat != 0.0:
        pace = (s.voltage - s.voltage_before) / dt / p.heating.reference
        share = -math.expm1(-dt / p.heating.time_constant)
        s.heat += (p.heating.gain * pace * pace - s.heat) * share
    if p.rate_dependence.widening > 0.0:
        rate = abs(s.voltage - s.voltage_before) / dt
        s.rate += (rate - s.rate) * -math.expm1(-dt / p.rate_dependence.memory)
        fast = s.rate / p.rate_dependence.reference
        power = p.rate_dependence.exponent
        s.widening = 1.0 + p.rate_dependence.widening * (
            fast**power if power > 0.0 else math.log1p(fast)
        )
    else:
        s.widening = 1.0
    s.voltage_before = s.voltage
    if p.depolarisation.loss > 0.0 or s.loss != 0.0:
        share = -math.expm1(-dt / p.depolarisation.time_constant)
        s.loss += (p.depolarisation.loss - s.loss) * share
    if s.residue != 0.0:
        s.residue = s.residue * math.exp(-dt / 5e-3) if abs(s.residue) > 1e-18 else 0.0
    return bool(s.widening + s.loss + s.residue + s.heat != before)


@inline_jit
def kink(p: Any, d: Any, s: Any, end: float) -> float:
    """Return the first voltage before `end` [V] at which the slope of the strain jumps."""
    if d.use_play:
        end = play.kink(s.play, s.strain_voltage, end, d)
    if d.use_preisach:
        end = preisach.kink(s.preisach, s.strain_voltage, end)
    if p.backlash.half_width > 0.0 and s.slope > 0.0:
        # The end of the lost motion is only estimated; the estimate improves near it.
        sign = 1.0 if end > s.strain_voltage else -1.0
        gap = sign * (s.lost_motion - s.free) + p.backlash.half_width
        ahead = gap / s.slope
        if gap > 1e-6 * p.backlash.half_width and ahead < sign * (end - s.strain_voltage):
            end = s.strain_voltage + sign * ahead
    return end


@inline_jit
def follow(p: Any, d: Any, s: Any, voltage: float) -> float:
    """Move the ceramic monotonically to `voltage` [V] and return the free displacement [m]."""
    strain = voltage
    if d.use_bouc_wen:
        s.eta = bouc_wen.move(s.eta, s.strain_voltage, voltage, p.bouc_wen, d.bouc_wen_stride)
        strain -= s.widening * s.eta
    if d.use_play:
        q = p.play
        loop = play.move(s.play, voltage, d, q.asymmetry) - d.play_slope * voltage
        strain += (q.linear_weight + d.play_slope - 1.0) * voltage + s.widening * loop
    if d.use_preisach:
        r = p.preisach
        loop = preisach.move(s.preisach, voltage, r) - r.weight * voltage
        strain += (r.linear_weight + r.weight - 1.0) * voltage + s.widening * loop
    strain += p.electrostriction.coefficient * voltage * voltage
    free = p.actuator.gain * (1.0 - s.loss) * (1.0 + s.heat) * strain
    if voltage != s.strain_voltage:
        s.slope = (free - s.free) / (voltage - s.strain_voltage)
    s.free, s.strain_voltage = free, voltage
    width = p.backlash.half_width
    s.lost_motion = min(max(s.lost_motion, free - width), free + width)
    return float(s.lost_motion + s.residue)
