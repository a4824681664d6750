"""What was found, under the names of the simulator node, so that a running simulator gets it too.

The simulator has its own physics and its own numbers; this table says which of them mean the same.
What has no counterpart there is left out and named.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import atan2, hypot, pi

from piezo_hysteresis.models import ModelFile

SimulatorValues = dict[str, float | bool]
Translation = Callable[[Mapping[str, float]], SimulatorValues]


@dataclass(frozen=True)
class SimulatorParameters:
    """Parameters for the simulator node.

    Attributes
    ----------
    values : dict
        Parameter name to value.
    missing : tuple of str
        Blocks of the model that the simulator has no counterpart of.
    """

    values: SimulatorValues
    missing: tuple[str, ...]

    def to_ros(self) -> dict[str, object]:
        """Return what ``ros2 param load NODE FILE`` reads."""
        return {'/**': {'ros__parameters': dict(self.values)}}


def _bouc_wen(v: Mapping[str, float]) -> SimulatorValues:
    gain = v['A1']
    found: SimulatorValues = {
        'effects.bouc_wen': True,
        'actuator.gain': gain,
        'bouc_wen.alpha': v['A'] / gain,
        'bouc_wen.beta': v['beta'],
        'bouc_wen.gamma': v['gamma'],
        'effects.asymmetry': v.get('A0', 0.0) != 0.0,
    }
    if v.get('A0', 0.0) != 0.0:
        found['bouc_wen.asymmetry'] = v['A0'] / gain
    return found


def _bouc_wen_power(v: Mapping[str, float]) -> SimulatorValues:
    return {
        **_bouc_wen(v),
        'effects.hysteresis_exponent': True,
        'bouc_wen.exponent': v['exponent'],
    }


def _bouc_wen_widening(v: Mapping[str, float]) -> SimulatorValues:
    return {
        **_bouc_wen(v),
        'effects.rate_dependence': True,
        'rate_dependence.widening': v['widening'],
        'rate_dependence.exponent': 0.0,
        'rate_dependence.reference': v['widening_corner'],
        'rate_dependence.memory': v['widening_memory'],
    }


def _bouc_wen_power_widening(v: Mapping[str, float]) -> SimulatorValues:
    return {
        **_bouc_wen(v),
        'effects.rate_dependence': True,
        'rate_dependence.widening': v['power_widening'],
        'rate_dependence.exponent': v['widening_power'],
        'rate_dependence.reference': v['power_reference'],
        'rate_dependence.memory': v['power_memory'],
    }


def _sensor_lag(v: Mapping[str, float]) -> SimulatorValues:
    if v['sensor_lag_time'] <= 0.0:
        return {}
    return {
        'effects.sensor_bandwidth': True,
        'sensor.bandwidth': 1.0 / (2.0 * pi * v['sensor_lag_time']),
    }


def _mode(v: Mapping[str, float]) -> SimulatorValues:
    return {
        'effects.resonance': True,
        'structure.natural_frequency': v['natural_frequency'],
        'structure.damping_ratio': v['damping_ratio'],
    }


def _series_mode(v: Mapping[str, float]) -> SimulatorValues:
    return _resonance({**v, 'resonance_share': 1.0})


def _resonance(v: Mapping[str, float]) -> SimulatorValues:
    if abs(v['resonance_share'] - 1.0) < 0.1:
        return {
            'effects.resonance': True,
            'structure.natural_frequency': v['resonance_frequency'],
            'structure.damping_ratio': v['resonance_damping'],
        }
    return {
        'effects.second_mode': True,
        'mode_2.frequency': v['resonance_frequency'],
        'mode_2.damping_ratio': v['resonance_damping'],
        'mode_2.share': v['resonance_share'],
    }


def _mode_pair(v: Mapping[str, float]) -> SimulatorValues:
    return {
        **_mode(v),
        'effects.second_mode': True,
        'mode_2.frequency': v['resonance_frequency'],
        'mode_2.damping_ratio': v['resonance_damping'],
        'mode_2.share': v['resonance_share'],
    }


def _hum(v: Mapping[str, float]) -> SimulatorValues:
    return {
        'effects.mains_hum': True,
        'mains.frequency': v['hum_frequency'],
        'mains.amplitude': hypot(v['hum_sine'], v['hum_cosine']),
        'mains.phase': atan2(v['hum_cosine'], v['hum_sine']),
        'mains.third': 0.0,
    }


def _switched(effect: str, **names: str) -> Translation:
    """Translate parameters one to one and switch the effect on."""

    def translate(v: Mapping[str, float]) -> SimulatorValues:
        return {
            f'effects.{effect}': True,
            **{theirs.replace('__', '.'): v[ours] for ours, theirs in names.items()},
        }

    return translate


def _saturation(v: Mapping[str, float]) -> SimulatorValues:
    return {
        'effects.saturation': True,
        'amplifier.clip_high': v['saturation_high'],
        'amplifier.clip_low': -v['saturation_low'],
    }


def _creep(v: Mapping[str, float]) -> SimulatorValues:
    return {
        'effects.creep': True,
        'creep.gain_1': v['creep_share'],
        'creep.time_1': v['creep_time'],
        'creep.gain_2': 0.0,
        'creep.gain_3': 0.0,
    }


def _creep_pair(v: Mapping[str, float]) -> SimulatorValues:
    return {
        **_creep(v),
        'creep.gain_2': v['slow_creep_share'],
        'creep.time_2': v['creep_time'] * v['slow_creep_ratio'],
    }


def _electrostriction(v: Mapping[str, float]) -> SimulatorValues:
    return {
        'effects.electrostriction': True,
        'electrostriction.coefficient': v['electrostriction'] / v['A1'],
    }


def _offset(v: Mapping[str, float]) -> SimulatorValues:
    return {'effects.offset': v['offset'] != 0.0, 'sensor.offset': v['offset']}


TABLE: dict[str, Translation] = {
    'bouc_wen': _bouc_wen,
    'bouc_wen_exact': _bouc_wen,
    'bouc_wen_power': _bouc_wen_power,
    'mode': _mode,
    'resonance': _resonance,
    'series_mode': _series_mode,
    'mode_pair': _mode_pair,
    'mains_hum': _hum,
    'saturation': _saturation,
    'creep': _creep,
    'creep_pair': _creep_pair,
    'offset': _offset,
    'transport_delay': _switched('transport_delay', delay='amplifier__delay'),
    'amplifier_lag': _switched('amplifier_lag', lag_time='amplifier__lag_time_constant'),
    'sensor_lag': _sensor_lag,
    'bouc_wen_widening': _bouc_wen_widening,
    'bouc_wen_power_widening': _bouc_wen_power_widening,
    'slew_limit': _switched('slew_limit', slew_rate='amplifier__slew_rate'),
    'electrostriction': _electrostriction,
    'drift': _switched('drift', drift_rate='drift__rate'),
    'backlash': _switched('backlash', backlash='backlash__half_width'),
    'logarithmic_creep': _switched(
        'log_creep', creep_per_decade='log_creep__gain', creep_onset='log_creep__start'
    ),
    'sensor_nonlinearity': _switched(
        'sensor_nonlinearity',
        sensor_quadratic='sensor__quadratic',
        sensor_cubic='sensor__cubic',
    ),
    'gain_decay': _switched(
        'gain_decay',
        gain_loss='depolarisation__loss',
        gain_loss_time='depolarisation__time_constant',
    ),
}


def simulator_parameters(found: ModelFile) -> SimulatorParameters:
    """Return the model of `found` under the simulator's own parameter names."""
    values: SimulatorValues = {}
    missing = []
    used: set[str] = set()
    model = found.model
    for name in model.block_names:
        translate = TABLE.get(name)
        if translate is None or name in used:
            missing.append(name)
            continue
        # A strain is counted against the gain of the actuator there.
        gain = {'A1': found.values['A1']} if 'A1' in found.values else {}
        try:
            values.update(translate({**gain, **model.block_values(found.values, name)}))
        except KeyError:  # a model without such a gain
            missing.append(name)
            continue
        used.add(name)
    return SimulatorParameters(values, tuple(missing))
