"""What the blind proof hides: effects of the simulator, their names and how size is drawn."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from studies.discovery_actuators import Generator, Overrides, bouc_wen, mode, play, share, sign


@dataclass(frozen=True)
class Knob:
    """One effect of the simulator: in which worlds it shows, its names, how its size is drawn."""

    worlds: tuple[str, ...]
    names: tuple[str, ...]
    draw: Callable[[Generator, float, Mapping[str, float]], Overrides]
    most: float = 8.0


def _law(name: str) -> Callable[[Generator, float, Mapping[str, float]], Overrides]:
    """Return how a hysteresis that the model does not have at all is drawn."""

    def draw(rng: Generator, size: float, seen: Mapping[str, float]) -> Overrides:
        if name == 'bouc_wen':
            return {'effects.bouc_wen': True, **bouc_wen(rng)}
        if name == 'play':
            return play(rng)
        return {
            'effects.bouc_wen': False,
            'effects.preisach': True,
            'preisach.weight': float(rng.uniform(0.3, 0.6)),
            'preisach.scale': float(rng.uniform(0.3, 0.9)),
            'preisach.asymmetry': 0.0,
        }

    return draw


def _saturation(rng: Generator, x: float, seen: Mapping[str, float]) -> Overrides:
    level = seen['amplitude'] * (1.0 - min(0.06 * x, 0.45))
    far, sides = 2.0 * seen['amplitude'], rng.integers(0, 3)
    return {
        'amplifier.clip_high': level if sides != 1 else far,
        'amplifier.clip_low': -level if sides != 2 else -far,
    }


def _creep(rng: Generator, x: float, seen: Mapping[str, float]) -> Overrides:
    gains = rng.permutation([0.03, 0.02, 0.02]) * x * rng.permutation([1.0, 1.0, 0.0])
    return {f'creep.gain_{j + 1}': float(gain) for j, gain in enumerate(gains)}


def _rate(rng: Generator, x: float, seen: Mapping[str, float]) -> Overrides:
    """Return the logarithmic or the power law; the vocabulary has a block for each."""
    growth, reference = min(0.06 * x, 0.3), 4.0
    if rng.random() < 0.5:
        return {'rate_dependence.widening': growth, 'rate_dependence.reference': reference}
    power, fastest = float(rng.uniform(0.15, 1.0)), seen['rise'] / reference
    # as much at the fastest drive as by the logarithm
    widening = growth * np.log1p(fastest) / fastest**power
    return {
        'rate_dependence.widening': float(widening),
        'rate_dependence.exponent': power,
        'rate_dependence.reference': reference,
        'rate_dependence.memory': share(rng, 1e-3, 2e-2),
    }


def _drift(rng: Generator, x: float, seen: Mapping[str, float]) -> Overrides:
    which = rng.integers(0, 2)
    return {
        'drift.rate': sign(rng) * 1e-7 * x * float(which == 0),
        'drift.warming': sign(rng) * 2e-6 * x * float(which == 1),
        'drift.warming_time': share(rng, 3.0, 60.0),
    }


def _curve(rng: Generator, x: float, seen: Mapping[str, float]) -> Overrides:
    which = rng.integers(0, 3)
    return {
        'sensor.quadratic': sign(rng) * 80.0 * x * float(which != 0),
        'sensor.cubic': sign(rng) * 1e6 * x * float(which != 1),
    }


def _hum(rng: Generator, x: float, seen: Mapping[str, float]) -> Overrides:
    return {
        'mains.amplitude': 5e-7 * x,
        'mains.frequency': float(rng.choice([50.0, 60.0, round(rng.uniform(20.0, 300.0), 2)])),
        'mains.third': float(rng.choice([0.0, 0.1])),
    }


def _second_mode(rng: Generator, x: float, seen: Mapping[str, float]) -> Overrides:
    return {
        'mode_2.frequency': share(rng, 60.0, 0.4 * seen['rate']),
        'mode_2.damping_ratio': share(rng, 0.01, 0.06),
        'mode_2.share': sign(rng) * min(0.08 * x, 0.6),
    }


def _simple(key: str, unit: float, most: float = np.inf, either: bool = False) -> Any:
    """Return a draw of one number that grows with the size of the effect."""

    def draw(rng: Generator, x: float, seen: Mapping[str, float]) -> Overrides:
        return {key: (sign(rng) if either else 1.0) * min(unit * x, most)}

    return draw


ANY = ('static', 'off_centre', 'mode', 'play')
SMOOTH = ('static', 'mode')

KNOBS: dict[str, Knob] = {
    'transport_delay': Knob(ANY, ('transport_delay',), _simple('amplifier.delay', 2e-3, 0.02)),
    'amplifier_lag': Knob(
        ANY, ('amplifier_lag',), _simple('amplifier.lag_time_constant', 1e-3, 0.02)
    ),
    'saturation': Knob(ANY, ('saturation',), _saturation),
    'slew_limit': Knob(
        ANY,
        ('slew_limit',),
        lambda rng, x, seen: {'amplifier.slew_rate': seen['rise'] / (1.0 + 0.3 * x)},
    ),
    'rate_dependence': Knob(SMOOTH, ('rate_dependence',), _rate),
    'electrostriction': Knob(
        ANY, ('electrostriction',), _simple('electrostriction.coefficient', 0.03, 0.3, True)
    ),
    'asymmetry': Knob(SMOOTH, ('asymmetry',), _simple('bouc_wen.asymmetry', 0.08, 0.3, True)),
    'gain_decay': Knob(
        ANY,
        ('gain_decay',),
        lambda rng, x, seen: {
            'depolarisation.loss': min(0.1 * x, 0.6),
            'depolarisation.time_constant': share(rng, 3.0, 40.0),
        },
    ),
    'backlash': Knob(
        ('static', 'off_centre', 'mode'), ('friction',), _simple('backlash.half_width', 1e-6), 30.0
    ),
    'hysteresis_exponent': Knob(
        ('static', 'mode'),
        ('hysteresis_exponent',),
        lambda rng, x, seen: {'bouc_wen.exponent': 1.0 + min(0.7 * x, 4.0)},
    ),
    'play': Knob(('static', 'mode'), ('nonlocal_memory',), _law('play')),
    'preisach': Knob(('static', 'mode'), ('nonlocal_memory',), _law('preisach')),
    'resonance': Knob(('static',), ('resonance',), lambda rng, x, seen: mode(rng)),
    'second_mode': Knob(('mode', 'static'), ('resonance',), _second_mode),
    'stiffness': Knob(('mode',), ('stiffness',), _simple('structure.cubic', 6e6, 6e7, True)),
    'friction': Knob(
        ('mode',),
        ('friction',),
        lambda rng, x, seen: {
            'friction.coulomb': 6e-7 * x,
            'friction.presliding': share(rng, 1e-6, 5e-6),
        },
    ),
    'bouc_wen': Knob(('linear',), ('hysteresis',), _law('bouc_wen')),
    'restoring_hysteresis': Knob(
        ('linear',), ('hysteresis',), _simple('restoring.share', 0.2, 0.7)
    ),
    'creep': Knob(ANY, ('creep',), _creep),
    'log_creep': Knob(
        ANY,
        ('creep',),
        lambda rng, x, seen: {
            'log_creep.gain': 0.015 * x,
            'log_creep.start': share(rng, 0.02, 0.3),
        },
    ),
    'drift': Knob(ANY, ('drift',), _drift),
    'sensor_nonlinearity': Knob(ANY, ('sensor_nonlinearity',), _curve),
    'mains_hum': Knob(ANY, ('mains_hum',), _hum),
    'floor_vibration': Knob(
        ANY,
        ('mains_hum',),
        lambda rng, x, seen: {
            'vibration.amplitude': 3e-7 * x,
            'vibration.frequency': round(float(rng.uniform(6.0, 45.0)), 2),
        },
    ),
    'sensor_bandwidth': Knob(
        ANY, ('amplifier_lag',), lambda rng, x, seen: {'sensor.bandwidth': 300.0 / x}
    ),
}
"""Effects inside the vocabulary."""

EXOTIC: dict[str, Knob] = {
    'amplitude_dead_time': Knob(ANY, (), _simple('amplifier.delay_per_volt', 2e-3, 0.02)),
    'sensor_clipping': Knob(
        ANY, (), lambda rng, x, seen: {'sensor.range': seen['reach'] * (1 - min(0.08 * x, 0.5))}
    ),
    'rate_limit': Knob(
        ANY, (), lambda rng, x, seen: {'sensor.rate_limit': seen['speed'] / (1.0 + 0.3 * x)}
    ),
    'jitter': Knob(ANY, (), _simple('sensor.jitter', 5e-5), 40.0),
    'dropouts': Knob(ANY, (), _simple('sensor.dropout_probability', 5e-3, 0.3), 60.0),
    'noise_bursts': Knob(ANY, (), _simple('sensor.burst_rms', 2e-6)),
    'modulated_tone': Knob(
        ANY,
        (),
        lambda rng, x, seen: {
            'modulated_tone.amplitude': 1e-6 * x,
            'modulated_tone.frequency': round(float(rng.uniform(60.0, 300.0)), 2),
            'modulated_tone.modulation': share(rng, 0.3, 2.0),
        },
    ),
    'switching': Knob(ANY, (), _simple('switching.step', 1.5e-6)),
    'amplitude_damping': Knob(('mode',), (), _simple('structure.quadratic_damping', 200.0), 50.0),
    'parametric_excitation': Knob(
        ('mode',),
        (),
        lambda rng, x, seen: {
            'structure.pump_depth': min(0.15 * x, 0.45),
            'structure.pump_frequency': round(float(rng.uniform(15.0, 70.0)), 2),
        },
    ),
}
"""Effects outside it: the right answer is unknown."""
