"""What is handed to the simulator under its own names makes it do what the model does."""

from __future__ import annotations

import numpy as np
import pytest

from piezo_hysteresis.blocks import BLOCKS, named_block
from piezo_hysteresis.discovery.live.apply import simulator_parameters
from piezo_hysteresis.models import Model, ModelFile
from piezo_sim.plant import Plant

RATE = 1000.0
BASE = {'A1': 1.4e-4, 'A': 5e-5, 'beta': 1.1, 'gamma': 0.2}

# Every translated block, with values that show, and the share of the stroke that two different
# integrations of the same physics, or two laws that stand for it, may differ by.
CASES = {
    'bouc_wen_exact': ({}, 1e-6),
    'bouc_wen': ({}, 2e-3),
    'bouc_wen_power': ({'exponent': 1.6}, 1e-6),
    'mode': ({'natural_frequency': 150.0, 'damping_ratio': 0.05}, 1e-6),
    'resonance': (
        {'resonance_frequency': 120.0, 'resonance_damping': 0.05, 'resonance_share': 1.0},
        1e-6,
    ),
    'series_mode': ({'resonance_frequency': 120.0, 'resonance_damping': 0.05}, 1e-6),
    'mode_pair': (
        {
            'natural_frequency': 90.0,
            'damping_ratio': 0.05,
            'resonance_frequency': 210.0,
            'resonance_damping': 0.03,
            'resonance_share': -0.2,
        },
        1e-6,
    ),
    'mains_hum': ({'hum_frequency': 50.0, 'hum_sine': 2e-6, 'hum_cosine': 1e-6}, 1e-6),
    'saturation': ({'saturation_high': 0.8, 'saturation_low': 0.7}, 1e-6),
    'creep': ({'creep_share': 0.04, 'creep_time': 0.5}, 1e-6),
    'creep_pair': (
        {
            'creep_share': 0.04,
            'creep_time': 0.1,
            'slow_creep_share': 0.03,
            'slow_creep_ratio': 20.0,
        },
        1e-6,
    ),
    'offset': ({'offset': 4e-6}, 1e-6),
    'transport_delay': ({'delay': 0.004}, 1e-6),
    'amplifier_lag': ({'lag_time': 0.003}, 1e-6),
    'sensor_lag': ({'sensor_lag_time': 0.002}, 1e-6),
    'bouc_wen_widening': (
        {'widening': 0.05, 'widening_corner': 4.0, 'widening_memory': 0.005},
        1e-3,
    ),
    'bouc_wen_power_widening': (
        {
            'power_widening': 0.1,
            'power_reference': 100.0,
            'widening_power': 0.3,
            'power_memory': 0.005,
        },
        1e-3,
    ),
    'slew_limit': ({'slew_rate': 20.0}, 1e-6),
    'electrostriction': ({'electrostriction': 6e-6}, 1e-6),
    'drift': ({'drift_rate': 2e-6}, 1e-3),
    'backlash': ({'backlash': 2e-6}, 1e-6),
    'logarithmic_creep': ({'creep_per_decade': 0.02, 'creep_onset': 0.05}, 5e-3),
    'sensor_nonlinearity': ({'sensor_quadratic': 200.0, 'sensor_cubic': 1e6}, 1e-6),
    'gain_decay': ({'gain_loss': 0.2, 'gain_loss_time': 2.0}, 1e-6),
}


def chain_with(name: str) -> Model:
    block = named_block(name)
    if name.startswith('bouc_wen'):
        return Model(name, (block, named_block('offset')))
    model = Model(name, (named_block('bouc_wen_exact'), named_block('offset')))
    return model if name == 'offset' else model.with_block(block)


def test_every_translation_is_tried() -> None:
    assert set(CASES) == {name for name, block in BLOCKS.items() if block.counterpart}


@pytest.mark.parametrize('name', CASES)
def test_the_simulator_does_what_the_model_does(name: str) -> None:
    values, tolerance = CASES[name]
    assert difference(chain_with(name), values) < tolerance


# What stands before a structure moves it between the ticks, too.
CHAINS = {
    'lag': (('amplifier_lag', 'bouc_wen_exact', 'mode'), {'lag_time': 5e-4}, 1e-7),
    'slew': (('slew_limit', 'bouc_wen_exact', 'mode'), {'slew_rate': 20.0}, 1e-5),
    'delay': (('transport_delay', 'bouc_wen_exact', 'mode'), {'delay': 1.3e-3}, 1e-6),
    'all': (
        ('transport_delay', 'amplifier_lag', 'bouc_wen_exact', 'mode', 'gain_decay', 'sensor_lag'),
        {'delay': 1.3e-3, 'lag_time': 5e-4, 'gain_loss': 0.1, 'sensor_lag_time': 1e-3},
        1e-4,
    ),
}


@pytest.mark.parametrize('name', CHAINS)
def test_the_simulator_does_what_a_chain_does_between_the_ticks(name: str) -> None:
    names, values, tolerance = CHAINS[name]
    model = Model(name, tuple(named_block(each) for each in (*names, 'offset')))
    assert difference(model, {'natural_frequency': 150.0, **values}) < tolerance


def difference(model: Model, values: dict[str, float]) -> float:
    """Return the largest difference over the stroke."""
    every = {**model.defaults(), **BASE, 'A0': 0.0, 'offset': 0.0, **values}
    found = simulator_parameters(ModelFile(model, every))
    assert not found.missing
    plant = Plant.from_preset('generic_bouc_wen', rate=RATE, seed=0)
    plant.set_parameters({'effects.noise': False})
    plant.set_parameters(found.values)

    time = np.arange(4000) / RATE
    voltage = np.sin(2 * np.pi * 5.0 * time) * np.minimum(1.0, time)
    measured = plant.run(voltage)
    simulated = model.respond(voltage, model.pack(every), 1.0 / RATE, frequency=5.0)
    if model.answers_at_once:
        measured, simulated = measured[1:], simulated[:-1]
    return float(np.max(np.abs(measured - simulated)) / np.ptp(simulated))


def test_asymmetry_is_handed_over() -> None:
    model = chain_with('bouc_wen_exact')
    every = {**model.defaults(), **BASE, 'A0': 6e-6, 'offset': 0.0}
    values = simulator_parameters(ModelFile(model, every)).values
    assert values['effects.asymmetry'] is True
    assert values['bouc_wen.asymmetry'] == pytest.approx(6e-6 / 1.4e-4)


def test_what_has_no_counterpart_is_named() -> None:
    model = chain_with('bouc_wen_exact').with_block(named_block('stiction'))
    every = {**model.defaults(), **BASE}
    assert simulator_parameters(ModelFile(model, every)).missing == ('stiction',)
