"""Simulated actuators of several axes: each axis, what acts between them, presets, records."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from piezo_hysteresis.arrays import FloatArray
from piezo_sim import AxesPlant, Plant, PlantError, PresetError, load_preset
from piezo_sim.axes_plant import load_axes_preset
from piezo_sim.cli import main
from piezo_sim.parts import body
from piezo_sim.presets import preset_names

QUIET = {f'axis_{i}.effects.{name}': False for i in (1, 2) for name in ('noise', 'creep')}
LINEAR = QUIET | {
    f'axis_{i}.effects.{name}': False for i in (1, 2) for name in ('play', 'resonance')
}
MIRROR = {f'axis_{i}.effects.{name}': False for i in (1, 2, 3) for name in ('play', 'noise')}


def scanner(**changes: float | bool) -> AxesPlant:
    return AxesPlant.from_preset(
        'xy_scanner', overrides=LINEAR | {'effects.body_1': False} | changes
    )


def triangle(volts: float, samples: int = 2000) -> FloatArray:
    return volts * np.interp(np.arange(samples) % 500, [0, 125, 375, 500], [0.0, 1.0, -1.0, 0.0])


@pytest.mark.parametrize('name', preset_names('axes'))
def test_each_preset_stays_at_rest_without_a_voltage_and_moves_with_one(name: str) -> None:
    plant = AxesPlant.from_preset(name)
    noise = plant.run(np.zeros((50, plant.axes)))
    assert np.abs(noise).max() < 1e-8
    for i in range(plant.axes):
        plant.reset()
        u = np.zeros((2000, plant.axes))
        u[:, i] = triangle(0.5 * plant.preset.voltage)
        moved = np.ptp(plant.run(u)[1000:], axis=0)
        assert np.argmax(moved) == i
        assert moved[i] > 0.7 * plant.preset.displacement
    assert {'body_1.frequency', 'axis_2.actuator.gain', 'axis_1.effects.creep'} <= {
        *plant.parameters
    }


def test_an_axis_alone_is_the_plant_of_one_axis_to_the_bit() -> None:
    one = Plant(rate=10000.0, preset=load_axes_preset('xy_scanner').axes[0])
    both = AxesPlant.from_preset(
        'xy_scanner',
        overrides={'axis_1.effects.noise': False}
        | {
            f'effects.{name}': False
            for name in ('cross_talk_1_to_2', 'cross_talk_2_to_1', 'body_1')
        },
    )
    one.switch('noise', on=False)
    u = triangle(20.0)
    expected = one.run(u)
    assert np.array_equal(both.run(np.column_stack([u, 0.0 * u]))[:, 0], expected)


def test_a_run_is_the_same_in_parts() -> None:
    plant = AxesPlant.from_preset('mirror_three_piezos', seed=3)
    u = np.column_stack([triangle(1.0), triangle(-0.5), triangle(0.2)])
    whole = plant.run(u)
    plant.reset()
    parts = [plant.run(u[:7]), plant.run(u[7:8]), plant.run(u[8:])]
    assert np.array_equal(np.concatenate(parts), whole)


@pytest.mark.parametrize(('drives', 'moves', 'share'), [(0, 1, 0.02), (1, 0, -0.02)])
def test_cross_talk_acts_from_one_axis_to_the_other(drives: int, moves: int, share: float) -> None:
    u = np.zeros((1000, 2))
    u[:, drives] = triangle(10.0, 1000)
    y = scanner().run(u)
    assert np.allclose(y[:, moves], share * y[:, drives], atol=1e-15)
    off = scanner(**{f'effects.cross_talk_{drives + 1}_to_{moves + 1}': False}).run(u)
    assert not off[:, moves].any()
    assert np.array_equal(off[:, drives], y[:, drives])


def response(
    plant: AxesPlant, frequency: float, amplitude: float, seconds: float = 3.0
) -> complex:
    """Return the motion of axis 1 for a sine on axis 1, in the last half of the time [m/V]."""
    n = round(seconds * plant.rate)
    t = np.arange(n) / plant.rate
    u = np.zeros((n, plant.axes))
    u[:, 0] = amplitude * np.sin(2.0 * np.pi * frequency * t)
    y = plant.run(u)[n // 2 :, 0]
    turn = np.exp(-2j * np.pi * frequency * t[n // 2 :])
    return complex(np.mean(y * turn) / np.mean(u[n // 2 :, 0] * turn))


@pytest.mark.parametrize('frequency', [100.0, 410.0, 600.0])
def test_modes_of_the_mirror_answer_as_their_equation(frequency: float) -> None:
    off = {'effects.softening': False, 'effects.ferroelasticity': False}
    plant = AxesPlant.from_preset('mirror_three_piezos', overrides=MIRROR | off)
    values, expected = plant.parameters, 0.0j
    s = 2j * np.pi * frequency
    for k in (1, 2, 3):
        omega = 2.0 * np.pi * values[f'body_{k}.frequency']
        damped = s**2 + 2.0 * values[f'body_{k}.damping_ratio'] * omega * s + omega**2
        through = values[f'body_{k}.drive_1'] * values[f'body_{k}.motion_1']
        expected += 5e-6 * through * omega**2 / damped
    half = 0.5 * s / plant.rate  # a command is held over its interval
    held = np.exp(-half) * np.sin(half.imag) / half.imag
    assert response(plant, frequency, 0.1) == pytest.approx(expected * held, rel=2e-3)


def test_modes_soften_with_the_voltage() -> None:
    plant = AxesPlant.from_preset(
        'mirror_three_piezos', overrides=MIRROR | {'effects.ferroelasticity': False}
    )
    # rms over three axes of a sine of 1.7 V on one: 0.7 V of the reference of 1 V
    gains = {}
    for volts in (0.001, 1.7):
        found = []
        for frequency in (400.0, 405.0, 407.0, 410.0):
            plant.reset()
            found.append(abs(response(plant, frequency, volts, 2.0)))
        gains[volts] = found
    assert np.argmax(gains[0.001]) == 3
    assert np.argmax(gains[1.7]) == 2


def test_ferroelasticity_takes_energy_from_the_modes() -> None:
    gains = []
    for on in (False, True):
        changes = MIRROR | {'effects.softening': False, 'effects.ferroelasticity': on}
        plant = AxesPlant.from_preset('mirror_three_piezos', overrides=changes)
        gains.append(abs(response(plant, 410.0, 1.0, 1.0)))
    assert gains[1] < 0.9 * gains[0]


@pytest.mark.parametrize('effect', [row.name for row in body.EFFECTS])
def test_each_effect_between_axes_changes_a_reading(effect: str) -> None:
    plant = AxesPlant.from_preset('mirror_three_piezos')
    u = np.column_stack([triangle(1.0), triangle(0.6), triangle(-0.8)])
    before = plant.run(u)
    if effect.startswith('cross_talk'):  # the plate, not an actuator, is what this preset reads
        plant.set_parameters({'own.share': 1.0})
        plant.reset()
        before = plant.run(u)
    plant.set_parameters({f'effects.{effect}': not plant.effects[effect]})
    plant.reset()
    assert not np.array_equal(plant.run(u), before)


@pytest.mark.parametrize(
    ('changes', 'sentence'),
    [
        ({'axis_3.actuator.gain': 1e-6}, "no parameter 'axis_3.actuator.gain'"),
        ({'effects.cross_talk_1_to_3': True}, 'effects.cross_talk_1_to_2'),
        ({'cross_talk.share_1_to_2': 3.0}, 'outside -1 .. 1'),
        ({'effects.body_1': 1.0}, 'is a switch'),
        ({'axis_1.actuator.gian': 1e-6}, 'actuator.gain'),
    ],
)
def test_a_wrong_change_is_refused_and_changes_nothing(
    changes: dict[str, float | bool], sentence: str
) -> None:
    plant = AxesPlant.from_preset('xy_scanner')
    before = plant.parameters
    with pytest.raises(PlantError, match=sentence):
        plant.set_parameters({'axis_1.actuator.gain': 1e-7, **changes})
    assert plant.parameters == before


def test_presets_of_one_axis_and_of_several_are_apart() -> None:
    with pytest.raises(PresetError, match='of one axis, not of several axes'):
        load_axes_preset('generic_bouc_wen')
    with pytest.raises(PresetError, match='of several axes, not of one axis'):
        load_preset('xy_scanner')


def test_the_command_writes_records_and_what_is_true(tmp_path: Path) -> None:
    out, true = tmp_path / 'xy.npz', tmp_path / 'true.json'
    line = ['axes', '--out', str(out), '--reveal', str(true), '--seconds', '0.1', '--seed', '2']
    assert main([*line, '--set', 'effects.body_1=false', '--levels', '3']) == 0
    with np.load(out) as file:
        assert {*file} == {'dt', 'u_3V', 'y_3V'}
        assert file['u_3V'].shape == file['y_3V'].shape == (1000, 2, 9, 2)
        assert np.sqrt(np.mean(file['u_3V'] ** 2, 0)) == pytest.approx(3.0)
        u = file['u_3V'][:, :, :, 0]  # every other one repeats the waveforms with other signs
        assert np.array_equal(np.abs(u[:, :, 0]), np.abs(u[:, :, 2]))
        assert not np.array_equal(u[:, :, 0], u[:, :, 2])
        assert np.abs(np.corrcoef(u[:, 0, 0], u[:, 0, 1])[0, 1]) < 0.7
        unequal = file['y_3V'][:, :, :, 0] - file['y_3V'][:, :, :, 1]
        assert np.std(unequal) < 3e-9  # steady state: noise of 1 nm alone
    content = json.loads(true.read_text())
    assert content['parameters']['effects.body_1'] is False


@pytest.mark.parametrize(
    ('more', 'sentence'),
    [
        (['--levels', '40'], 'lower the level'),
        (['--band', '3000,2000'], 'less than two lines'),
        (['--preset', 'xy_scaner'], 'did you mean xy_scanner'),
    ],
)
def test_what_cannot_be_simulated_is_one_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], more: list[str], sentence: str
) -> None:
    assert main(['axes', '--out', str(tmp_path / 'xy.npz'), '--seconds', '0.1', *more]) == 2
    assert sentence in capsys.readouterr().err
