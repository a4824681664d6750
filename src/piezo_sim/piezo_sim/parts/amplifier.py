"""Amplifier: D/A converter, transport delay, output range, slew rate and lag.

The response to a constant target is exact in closed form, so the amplifier has no step error.
"""

from __future__ import annotations

import math

from piezo_hysteresis.kernels.compile import inline_jit
from piezo_sim.plant_parameters import PlantEffect, PlantParameter

FAR = 1e12  # no limit: large, but finite in every product

PARAMETERS = (
    PlantParameter(
        'amplifier.range_low', 'V', -5.0, -1e4, 0.0, 'Lowest command that is accepted.'
    ),
    PlantParameter(
        'amplifier.range_high', 'V', 5.0, 1e-3, 1e4, 'Highest command that is accepted.'
    ),
    PlantParameter('amplifier.resolution', 'V', 3e-4, 0.0, 10.0, 'Step of the D/A converter.'),
    PlantParameter('amplifier.delay', 's', 2e-3, 0.0, 0.1, 'Transport delay of the command.'),
    PlantParameter(
        'amplifier.delay_per_volt',
        's/V',
        2e-3,
        0.0,
        0.1,
        'Growth of the delay with the magnitude of the command.',
    ),
    PlantParameter(
        'amplifier.clip_low', 'V', -0.9, -1e4, 0.0, 'Level at which the output saturates.'
    ),
    PlantParameter(
        'amplifier.clip_high', 'V', 0.9, 1e-3, 1e4, 'Level at which the output saturates.'
    ),
    PlantParameter('amplifier.slew_rate', 'V/s', 60.0, 1e-3, 1e9, 'Fastest change of the output.'),
    PlantParameter('amplifier.lag_time_constant', 's', 1e-3, 1e-6, 10.0, 'First-order lag (RC).'),
)

EFFECTS = (
    PlantEffect('dac_quantisation', 'The command moves in steps.', {'amplifier.resolution': 0.0}),
    PlantEffect('transport_delay', 'The command acts later.', {'amplifier.delay': 0.0}),
    PlantEffect(
        'saturation',
        'The output of the amplifier stops at its clip levels.',
        {'amplifier.clip_low': -FAR, 'amplifier.clip_high': FAR},
    ),
    PlantEffect(
        'slew_limit',
        'The output of the amplifier cannot change faster than its slew rate.',
        {'amplifier.slew_rate': FAR},
    ),
    PlantEffect(
        'amplifier_lag',
        'Amplifier and capacitance of the actuator form a low-pass filter.',
        {'amplifier.lag_time_constant': 0.0},
    ),
    PlantEffect(
        'amplitude_dead_time',
        'The transport delay grows with the magnitude of the command.',
        {'amplifier.delay_per_volt': 0.0},
        exotic=True,
    ),
)


@inline_jit
def toward(voltage: float, target: float, time: float, tau: float, slew: float) -> float:
    """Return the output [V] after `time` [s] with a constant target.

    While the lag `tau` [s] requires more than the slew rate [V/s], the output is a straight line;
    it then continues as the exponential of the lag.
    """
    distance = abs(target - voltage)
    sign = 1.0 if target > voltage else -1.0
    straight = 0.0
    if slew < FAR and distance > tau * slew:
        straight = min(time, (distance - tau * slew) / slew)
        distance -= slew * straight
    if straight < time:
        distance = distance * math.exp(-(time - straight) / tau) if tau > 0.0 else 0.0
    return target - sign * distance


@inline_jit
def corner(voltage: float, target: float, tau: float, slew: float) -> float:
    """Return the time [s] until the slew limit ends, 0 if it is not active."""
    if slew >= FAR:
        return 0.0
    return max(0.0, abs(target - voltage) / slew - tau)
