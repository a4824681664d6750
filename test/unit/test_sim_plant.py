"""The plant as its users see it: stepping, tuning while running, refusals, faults."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sim_signals import sine

from piezo_hysteresis.waveforms import KINDS
from piezo_sim import FAULTS, Plant, PlantError, PresetError, load_preset, preset_names
from piezo_sim.plant_parameters import dimensions
from piezo_sim.presets import read_preset

NOISY = {
    f'effects.{name}': True
    for name in ('flicker_noise', 'dropouts', 'jitter', 'noise_bursts', 'amplifier_lag',
                 'transport_delay', 'creep', 'rate_dependence', 'sensor_bandwidth')
}  # fmt: skip


def test_stepping_and_arrays_of_any_length_give_the_same_bits() -> None:
    plant = Plant.from_preset('fdk_pzba_00030', overrides=NOISY, seed=4)
    _, command = sine(23.0, seconds=0.3)
    whole = plant.run(command)
    plant.reset()
    np.testing.assert_array_equal([plant.exchange(v) for v in command], whole)
    plant.reset()
    pieces = [plant.run(piece) for piece in np.split(command, [1, 40, 41, 299])]
    np.testing.assert_array_equal(np.concatenate(pieces), whole)


def test_a_reading_is_taken_before_the_voltage_of_its_tick_acts() -> None:
    plant = Plant()
    assert [plant.exchange(v) for v in (1.0, 0.0, 0.0)] == pytest.approx([0.0, 1e-4, 0.0])


def test_the_seed_decides_the_noise_and_nothing_else() -> None:
    plant = Plant.from_preset('generic_bouc_wen', seed=1)
    _, command = sine(7.0)
    first = plant.run(command)
    plant.reset(seed=2)
    second = plant.run(command)
    plant.reset(seed=1)
    np.testing.assert_array_equal(plant.run(command), first)
    difference = first - second
    assert np.std(difference) == pytest.approx(math.sqrt(2) * 20e-9, rel=0.05)
    assert (
        abs(np.corrcoef(first - np.convolve(first, np.ones(5) / 5, 'same'), difference)[0, 1]) < 1
    )


def test_noise_of_one_effect_does_not_depend_on_the_others() -> None:
    _, command = sine(7.0, seconds=0.5)
    runs = {}
    for hum in (False, True):
        on = {'effects.noise': True, 'effects.mains_hum': hum, 'effects.jitter': hum,
              'sensor.jitter': 0.0}  # fmt: skip
        runs[hum] = Plant(on).run(command)
        runs[hum] -= Plant({**on, 'effects.noise': False}).run(command)
    np.testing.assert_allclose(runs[True], runs[False], atol=1e-18)


def test_a_snapshot_brings_everything_back() -> None:
    plant = Plant.from_preset('fdk_pzba_00030', overrides=NOISY)
    _, command = sine(23.0, seconds=0.5)
    plant.run(command)
    kept = plant.snapshot()
    first = plant.run(command)
    plant.restore(kept)
    np.testing.assert_array_equal(plant.run(command), first)


@pytest.mark.parametrize('wrong', [math.nan, math.inf, -math.inf, 5.001, -5.001])
def test_an_impossible_command_is_refused_and_counted_and_the_last_one_held(wrong: float) -> None:
    plant, other = (Plant.from_preset('fdk_pzba_00030') for _ in range(2))
    plant.run([0.5, 0.5, wrong, wrong])
    other.run([0.5, 0.5, 0.5, 0.5])
    assert plant.refused == 2
    assert plant.command == 0.5
    assert plant.exchange(0.0) == other.exchange(0.0)


@pytest.mark.parametrize(
    ('changes', 'reason'),
    [
        ({'structure.natural_frequenzy': 3.0}, 'has no parameter'),
        ({'effects.ghost': True}, 'has no parameter'),
        ({'effects.creep': 1.0}, 'is a switch'),
        ({'sensor.noise_rms': True}, 'is a number'),
        ({'sensor.noise_rms': '3'}, 'is a number'),
        ({'sensor.noise_rms': math.nan}, 'outside'),
        ({'structure.load_mass': -0.1}, 'outside'),
        ({'structure.damping_ratio': -0.01}, 'outside'),
        ({'effects.bouc_wen': True, 'bouc_wen.gamma': 2.0}, 'makes energy'),
        ({'effects.preisach': True, 'preisach.curvature': 5.0}, 'density becomes negative'),
        ({'effects.second_mode': True, 'effects.third_mode': True, 'mode_2.share': 0.6,
          'mode_3.share': 0.6}, 'leave nothing to the first'),
        ({'effects.restoring_hysteresis': True, 'restoring.gamma': 1e6}, 'makes energy'),
    ],
)  # fmt: skip
def test_impossible_physics_is_refused_with_the_reason_and_nothing_changes(
    changes: dict[str, Any], reason: str
) -> None:
    plant = Plant.from_preset('generic_bouc_wen')
    before = plant.parameters
    with pytest.raises(PlantError, match=reason):
        plant.set_parameters({'sensor.offset': 1e-6, **changes})
    with pytest.raises(PlantError, match=reason):
        plant.check(changes)
    assert plant.parameters == before
    with pytest.raises(PlantError, match=reason):
        Plant.from_preset('generic_bouc_wen', overrides=changes)


@pytest.mark.parametrize('rate', [0.0, -1.0, math.nan, 1e9])
def test_an_impossible_rate_is_refused(rate: float) -> None:
    with pytest.raises(PlantError, match='the rate must lie'):
        Plant(rate=rate)


BASES: tuple[dict[str, bool], ...] = (
    {},
    {'effects.resonance': True, 'effects.play': True, 'effects.second_mode': True},
)


@pytest.mark.parametrize('base', BASES, ids=['static', 'dynamic'])
@pytest.mark.parametrize('effect', [row.name for row in Plant().effect_table])
def test_switching_an_effect_while_running_makes_no_jump(effect: Any, base: Any) -> None:
    """Displacement and speed go on from where they are, both when it goes on and off."""
    plant = Plant(base)
    _, command = sine(7.0, seconds=0.333)
    for on in (not plant.effects[effect], plant.effects[effect]):
        plant.run(command)
        before = plant.snapshot().state
        place = plant.displacement
        plant.switch(effect, on)
        after = plant.snapshot().state
        assert plant.displacement == pytest.approx(place, abs=1e-15)
        if effect != 'resonance':
            np.testing.assert_array_equal(after['v'], before['v'])
        assert after['voltage'] == before['voltage']
        assert np.abs(plant.run(command)).max() < 1e-3


@pytest.mark.parametrize('base', BASES, ids=['static', 'dynamic'])
def test_tuning_any_parameter_while_running_makes_no_jump(base: Any) -> None:
    plant = Plant({**base, 'effects.bouc_wen': True, 'effects.electrostriction': True,
                   'effects.backlash': True, 'effects.load': True})  # fmt: skip
    rng = np.random.default_rng(0)
    _, command = sine(7.0, seconds=0.1)
    for row in plant.parameter_table:
        plant.run(command)
        place = plant.displacement
        value = row.default * rng.uniform(0.7, 1.3)
        plant.set_parameters({row.name: min(max(value, row.low), row.high)})
        assert plant.displacement == pytest.approx(place, abs=1e-15), row.name


def test_a_low_pass_that_is_switched_on_starts_at_the_current_reading() -> None:
    plant = Plant()
    before = plant.run(np.full(10, 0.5))[-1]
    plant.switch('sensor_bandwidth')
    assert plant.exchange(0.5) == pytest.approx(before, rel=1e-12)


def test_a_switched_off_effect_ends_where_a_plant_without_it_is() -> None:
    plant, plain = Plant({'effects.resonance': True}), Plant({'effects.resonance': True})
    level = np.full(3000, 0.5)
    plant.switch('bouc_wen')
    plant.run(level)
    plant.switch('bouc_wen', False)
    plant.run(level)
    plain.run(level)
    assert plant.displacement == pytest.approx(plain.displacement, rel=1e-9)


def test_faults_begin_with_the_next_tick_and_end_in_time() -> None:
    plant = Plant()
    plant.run(np.full(10, 0.5))
    plant.inject('sensor_dropout', 0.003)
    readings = plant.run(np.full(5, 0.5))
    np.testing.assert_array_equal(np.isnan(readings), [1, 1, 1, 0, 0])
    plant.inject('stuck_sensor', 0.002)
    np.testing.assert_allclose(plant.run(np.full(4, 0.25)), [5e-5, 5e-5, 2.5e-5, 2.5e-5])
    assert plant.fault == 'none'
    plant.inject('stuck_sensor')
    plant.run(np.full(5000, 1.0))
    assert plant.fault == 'stuck_sensor'
    plant.inject('none')
    assert plant.exchange(1.0) == pytest.approx(1e-4)


def test_a_tripped_amplifier_discharges_and_ignores_commands_until_it_is_back() -> None:
    plant = Plant()
    plant.run(np.full(10, 1.0))
    plant.inject('amplifier_trip', 0.04)
    readings = plant.run(np.full(45, 1.0))
    assert readings[20] == pytest.approx(1e-4 * math.exp(-1), rel=1e-6)
    assert readings[-1] == pytest.approx(1e-4)


@pytest.mark.parametrize(
    ('fault', 'duration'),
    [('fire', 1.0), ('none', -1.0), ('none', math.nan), ('none', math.inf), ('none', 1e300)],
)
def test_unknown_faults_are_refused(fault: str, duration: float) -> None:
    with pytest.raises(PlantError):
        Plant().inject(fault, duration)
    assert set(FAULTS) == {'none', 'sensor_dropout', 'stuck_sensor', 'amplifier_trip'}


@pytest.mark.parametrize('name', preset_names())
def test_the_tables_describe_every_parameter_and_effect(name: Any) -> None:
    plant = Plant.from_preset(name)
    rows = {row.name: row for row in plant.parameter_table}
    for row in rows.values():
        assert row.low <= row.default <= row.high
        assert row.low < row.high
        assert row.description.endswith('.')
        assert row.unit
    for effect in plant.effect_table:
        assert effect.description.endswith('.')
        assert set(effect.neutral) <= set(rows)
    numbers = {key: value for key, value in plant.parameters.items() if key in rows}
    assert numbers == {row.name: row.default for row in rows.values()}
    assert set(plant.parameters) - set(rows) == {f'effects.{e.name}' for e in plant.effect_table}


def test_defaults_scale_with_the_size_of_the_actuator() -> None:
    small = {row.name: row.default for row in Plant().parameter_table}
    flap = {row.name: row.default for row in load_preset('zhou_tef').table()}
    assert flap['backlash.half_width'] == pytest.approx(2.6 * small['backlash.half_width'])
    assert flap['electrostriction.coefficient'] == pytest.approx(
        small['electrostriction.coefficient'] / 60
    )
    assert dimensions('m/V^2') == (-2, 1)
    assert dimensions('1/m^2') == (0, -2)
    assert dimensions('rad') == (0, 0)


def test_an_unknown_preset_lists_those_there_are() -> None:
    with pytest.raises(PresetError, match='fdk_pzba_00030, generic_bouc_wen'):
        Plant.from_preset('nonsense')
    with pytest.raises(PresetError):
        Plant.from_preset('../presets/zhou_tef')


@pytest.mark.parametrize(
    ('text', 'reason'),
    [
        ('- a\n- b', 'must be a mapping'),
        ('voltage: [', 'cannot be read'),
        ('colour: red', "unknown key 'colour'"),
        ('effects: [ghost]', "no effect 'ghost'"),
        ('parameters: {ghost.x: 1}', "no parameter 'ghost.x'"),
        ('parameters: {sensor.offset: wide}', 'not a number'),
        ('voltage: true', 'not a number'),
        ('effects: {creep: true}', 'effects is a list'),
    ],
)
def test_a_wrong_preset_file_is_refused_with_the_reason(
    tmp_path: Path, text: str, reason: str
) -> None:
    file = tmp_path / 'mine.yaml'
    file.write_text(text)
    with pytest.raises(PresetError, match=reason):
        read_preset(file)


def test_a_preset_outside_the_bounds_is_refused(tmp_path: Path) -> None:
    file = tmp_path / 'mine.yaml'
    file.write_text('parameters: {structure.damping_ratio: -0.1}')
    with pytest.raises(PlantError, match=r'structure\.damping_ratio'):
        Plant(preset=read_preset(file))


def test_the_manual_names_every_effect_preset_fault_and_waveform() -> None:
    text = (Path(__file__).parents[2] / 'docs' / 'simulator.md').read_text()
    words = [row.name for row in Plant().effect_table]
    words += [*preset_names(), *FAULTS, *(kind for kind in KINDS if 'composite' not in kind)]
    assert [word for word in words if word not in text] == []


@pytest.mark.parametrize(
    'effect', ['friction', 'contact', 'stiffness', 'restoring_hysteresis', 'amplitude_damping']
)
def test_an_effect_without_influence_is_reported(effect: str) -> None:
    overrides = {'effects.resonance': False, 'effects.noise': False, f'effects.{effect}': True}
    plant = Plant.from_preset('generic_bouc_wen', overrides=overrides)
    assert f'effects.{effect} without effect' in plant.idle_effects
    _, command = sine(9.0, seconds=0.3)
    answered = plant.run(command)
    plant = Plant.from_preset(
        'generic_bouc_wen', overrides={**overrides, f'effects.{effect}': False}
    )
    assert plant.idle_effects == ''
    np.testing.assert_array_equal(plant.run(command), answered)
    plant.set_parameters({f'effects.{effect}': True, 'effects.resonance': True})
    assert plant.idle_effects == ''


# What is random or a threshold turns a change in the last digit into a step; it has no step error.
DISCRETE = ('quantisation', 'dac_quantisation', 'switching')
EFFECTS = [row.name for row in Plant().effect_table if row.name not in DISCRETE]
STILL = {f'effects.{name}': False for name in ('noise', 'quantisation')}

WORLDS = {
    'static': {'effects.bouc_wen': True},
    'resonant': {'effects.bouc_wen': True, 'effects.resonance': True},
    'lagged': {'effects.play': True, 'effects.resonance': True, 'effects.amplifier_lag': True},
}


def _command(voltage: float, bias: float, rate: Any, seconds: float = 1.5) -> Any:
    """Slow, fast and small motion, a step, a hold and ringing afterwards."""
    time, slow = sine(7.0, 0.55 * voltage, seconds, rate)
    command = slow + 0.4 * voltage * np.sin(2 * np.pi * 23.0 * time + 1.0)
    command[time > 0.5] = 0.9 * voltage * np.sin(2 * np.pi * 40.0 * time[time > 0.5])
    command[time > 1.0] = 0.5 * voltage
    return bias + command


def _change(make: Callable[..., Any], command: Any) -> Any:
    coarse, fine = (make(refine).run(command) for refine in (0, 1))
    return np.abs(coarse - fine).max() / np.ptp(fine)


@pytest.mark.parametrize('lag', [False, True])
@pytest.mark.parametrize('name', preset_names())
def test_presets_do_not_depend_on_the_step(name: Any, lag: bool) -> None:
    def make(refine: int) -> Plant:
        overrides = {**STILL, 'effects.amplifier_lag': lag}
        return Plant.from_preset(name, overrides=overrides, refine=refine)

    preset = make(0).preset
    assert _change(make, _command(preset.voltage, preset.bias, preset.rate, 1.2)) < 1e-6


@pytest.mark.parametrize('world', WORLDS)
@pytest.mark.parametrize('effect', EFFECTS)
def test_effects_do_not_depend_on_the_step(effect: Any, world: Any) -> None:
    overrides = {**WORLDS[world], f'effects.{effect}': True}
    assert _change(lambda n: Plant(overrides, refine=n), _command(1.0, 0.0, 1000.0)) < 1e-6


def test_the_refinement_is_a_finer_integration() -> None:
    """A pair of runs that agree because nothing was refined would prove nothing."""
    overrides = {'effects.resonance': True, 'effects.friction': True}
    assert _change(lambda n: Plant(overrides, refine=n), _command(1.0, 0.0, 1000.0)) > 0.0
