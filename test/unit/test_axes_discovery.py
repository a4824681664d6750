"""Discovery on several axes: cross-talk beside hysteresis, the verb, what it refuses."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.axes.axes_discovery import discover_axes
from piezo_hysteresis.axes.axes_load import load_axes
from piezo_hysteresis.axes.axes_record import AxesRecord
from piezo_hysteresis.axes.cross_talk import cross_talk
from piezo_hysteresis.axes.modal_model import ModalLayout, ModalModel
from piezo_hysteresis.cli.main import main
from piezo_hysteresis.errors import IdentificationError, RecordError
from piezo_sim.axes_records import SIGNS
from piezo_sim.cli import main as simulate

RATE, SAMPLES, MICRO = 1000.0, 1000, 1e-6


def waveform(seed: int) -> FloatArray:
    """Return a period of a multisine of 1 V rms, 2 to 100 Hz."""
    rng = np.random.default_rng(seed)
    spectrum = np.zeros(SAMPLES // 2 + 1, complex)
    spectrum[2:101] = np.exp(2j * np.pi * rng.random(99))
    x = np.fft.irfft(spectrum, SAMPLES)
    return np.asarray(x / x.std())


def actuator(u: FloatArray) -> FloatArray:
    """Return what an actuator with a wide loop and a square makes of a period [m]."""
    state, out = 0.0, np.empty(u.size)
    for _ in range(2):
        for n, v in enumerate(u):
            state = min(max(state, v - 0.6), v + 0.6)
            out[n] = v + 0.5 * state + 0.05 * v * v
    return MICRO * out


def records(share: float, repeated: bool = True, noise: float = 1e-3) -> list[AxesRecord]:
    """Return records of three axes; axis 3 moves by a share of what axis 1 moves."""
    rng, found = np.random.default_rng(4), []
    for k, signs in enumerate(SIGNS):
        u = np.column_stack([waveform(3 * (0 if repeated else k) + i) for i in range(3)])
        u *= signs if repeated else 1.0
        y = np.column_stack([actuator(column) for column in u.T])
        y[:, 2] += share * y[:, 0]
        y += noise * MICRO * rng.standard_normal(y.shape)
        found.append(AxesRecord(str(k), 1.0 / RATE, u, y, 1))
    return found


def named(found: list[AxesRecord]) -> list[tuple[int, int]]:
    return [(pair.voltage, pair.displacement) for pair in cross_talk(found, below=40.0)]


def test_a_repeated_voltage_shows_cross_talk_far_below_the_hysteresis() -> None:
    (pair,) = cross_talk(records(0.002), below=40.0)
    assert (pair.voltage, pair.displacement) == (1, 3)
    assert pair.size == pytest.approx(0.002, rel=0.1)
    assert pair.std < 1e-4
    assert named(records(0.0)) == []


def test_records_without_any_noise_have_a_deviation_of_nothing() -> None:
    found = [replace(each, displacement=1e-6 * each.voltage) for each in records(0.0)]
    assert cross_talk(found, below=40.0) == []


def test_other_voltages_show_what_is_larger_than_what_hysteresis_leaves() -> None:
    assert named(records(0.1, repeated=False)) == [(1, 3)]
    assert named(records(0.0, repeated=False)) == []


def test_displacements_in_another_order_than_the_voltages_are_doubted() -> None:
    turned = [
        replace(each, displacement=each.displacement[:, [1, 0, 2]] + 0.1 * each.displacement)
        for each in records(0.0)
    ]
    found = discover_axes(turned, 'gain')
    assert 'Displacement 1 moves more with voltage 2' in found.remark or found.remark.startswith(
        'Displacement 2 moves more with voltage 1'
    )
    assert found.remark in repr(found)
    assert discover_axes(records(0.02), 'gain').remark == ''


def test_one_displacement_with_the_voltage_of_another_axis() -> None:
    chosen = [2, 0]  # the displacement is that of the first voltage
    one = [
        replace(each, voltage=each.voltage[:, chosen], displacement=each.displacement[:, 2:])
        for each in records(0.02)
    ]
    (pair,) = cross_talk(one, below=40.0)
    assert (pair.voltage, pair.displacement, pair.measured) == (2, 1, False)
    assert pair.size == pytest.approx(0.02, rel=0.1)
    assert 'its own motion' in str(pair)


@pytest.mark.parametrize(
    ('change', 'sentence'),
    [
        ({'displacement': np.zeros((SAMPLES, 4))}, '3 voltages and 4 displacements'),
        ({'periods': 0}, 'state it with --periodic'),
        ({'displacement': np.zeros((SAMPLES, 3))}, 'axis 2 does not move with its own voltage'),
    ],
)
def test_records_that_cannot_show_it_are_refused(change: dict[str, object], sentence: str) -> None:
    with pytest.raises(RecordError, match=sentence):
        cross_talk([replace(each, **change) for each in records(0.0)], below=40.0)  # type: ignore[arg-type]


def test_the_baseline_is_a_gain_or_modes() -> None:
    with pytest.raises(IdentificationError, match='gain or modes'):
        discover_axes(records(0.0), 'classical')
    assert 'Nothing was found' in repr(discover_axes(records(0.0), 'gain'))


@pytest.fixture
def stage(tmp_path: Path) -> Path:
    """Return simulated records with a hidden cross-talk from axis 2 to axis 3."""
    out = tmp_path / 'stage.npz'
    line = ['axes', '--preset', 'xyz_stage', '--out', str(out), '--seconds', '0.4']
    assert simulate([*line, '--set', 'effects.cross_talk_2_to_3=true']) == 0
    return out


@pytest.mark.component
def test_the_verb_names_the_pair(
    stage: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / 'found'
    assert (
        main(['discover', str(stage), '--baseline', 'gain', '--axes', '3', '--out', str(out)]) == 0
    )
    verdict = json.loads((out / 'verdict.json').read_text())
    (effect,) = verdict['effects']
    assert (effect['name'], effect['voltage'], effect['displacement']) == ('cross_talk', 2, 3)
    assert effect['size'] == pytest.approx(0.01, rel=0.05)
    assert 'cross_talk: axis 3 moves 0.99' in capsys.readouterr().out
    assert 'Cross-talk' in (out / 'report.html').read_text()


@pytest.mark.component
@pytest.mark.parametrize(
    ('more', 'sentence'),
    [
        (['--baseline', 'bouc_wen_mode'], 'gain or modes'),
        (['--baseline', 'gain', '--reference', 'old.npz'], '--reference is of one axis'),
        (['--baseline', 'gain', '--axes', '2'], 'not 2 axes'),
    ],
)
def test_what_the_verb_cannot_do_is_one_sentence(
    stage: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], more: list[str], sentence: str
) -> None:
    assert main(['discover', str(stage), '--axes', '3', '--out', str(tmp_path / 'x'), *more]) == 2
    assert sentence in capsys.readouterr().err


def through(size: float, natural: float = 300.0) -> list[AxesRecord]:
    """Return records up to 480 Hz in which axis 3 moves with a mode that axis 1 drives."""
    rng, found = np.random.default_rng(7), []
    frequency = np.fft.rfftfreq(SAMPLES, 1.0 / RATE)
    ratio, own = frequency / natural, frequency / 180.0
    mode = size / (1.0 - ratio**2 + 0.04j * ratio)
    resonance = 1.0 / (1.0 - own**2 + 0.06j * own)
    for k in range(2 * len(SIGNS)):
        u = np.column_stack([wide(3 * (k // len(SIGNS)) + i) for i in range(3)])
        u = u * SIGNS[k % len(SIGNS)]
        stroke = np.fft.rfft(np.column_stack([actuator(column) for column in u.T]), axis=0)
        moved = stroke * resonance[:, None]
        moved[:, 2] += stroke[:, 0] * mode
        y = np.fft.irfft(moved, SAMPLES, axis=0)
        y += 1e-3 * MICRO * rng.standard_normal(y.shape)
        found.append(AxesRecord(str(k), 1.0 / RATE, u, y, 1))
    return found


def wide(seed: int) -> FloatArray:
    rng = np.random.default_rng([9, seed])
    spectrum = np.zeros(SAMPLES // 2 + 1, complex)
    spectrum[2:481] = np.exp(2j * np.pi * rng.random(479))
    x = np.fft.irfft(spectrum, SAMPLES)
    return np.asarray(x / x.std())


@pytest.mark.component
def test_cross_talk_through_a_mode_has_a_name_of_its_own() -> None:
    (pair,) = cross_talk(through(0.01))
    assert (pair.name, pair.voltage, pair.displacement) == ('cross_talk_through_mode', 1, 3)
    assert pair.frequency == pytest.approx(300.0, rel=0.01)
    assert pair.damping == pytest.approx(0.02, rel=0.3)
    assert pair.size == pytest.approx(0.01, rel=0.3)
    assert 'through a mode at' in str(pair)
    assert cross_talk(through(0.0)) == []
    both = through(-0.01)
    for each in both:
        each.displacement[:, 1] += 0.02 * each.displacement[:, 2]
    kinds = {(pair.name, pair.voltage, pair.displacement) for pair in cross_talk(both)}
    assert ('cross_talk', 3, 2) in kinds
    assert ('cross_talk_through_mode', 1, 3) in kinds
    assert discover_axes(both, 'gain').effects == ('cross_talk', 'cross_talk_through_mode')


@pytest.mark.component
def test_the_verb_takes_the_voltage_of_another_axis_as_a_column(
    stage: Path, tmp_path: Path
) -> None:
    with np.load(stage) as whole:
        arrays = {
            name: each[:, [2, 1]] if name[0] == 'u' else each[:, 2:]
            for name, each in whole.items()
            if name != 'dt'
        }
        np.savez(tmp_path / 'one.npz', dt=whole['dt'], **arrays)
    words = ['discover', str(tmp_path / 'one.npz'), '--baseline', 'gain', '--axes', '2']
    assert main([*words, '--out', str(tmp_path / 'found')]) == 0
    verdict = json.loads((tmp_path / 'found' / 'verdict.json').read_text())
    (effect,) = verdict['effects']
    assert (effect['name'], effect['voltage'], effect['displacement']) == ('cross_talk', 2, 1)
    assert effect['size'] == pytest.approx(0.01, rel=0.2)
    assert not effect['measured']


@pytest.mark.component
def test_validation_of_several_axes_has_a_page(
    stage: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with np.load(stage) as whole:
        layout = ModalLayout(3, 3, 1)
        vector = layout.zeros()
        layout.named(vector)['log_omega'][:] = np.log(2.0 * np.pi * 400.0)
        layout.named(vector)['log_damping'][:] = np.log(0.02)
        output = np.zeros((len(layout.signal_names), 3))
        output[2:] = 3e-7 * np.eye(3)
        ModalModel(layout, vector, output, 10.0, float(whole['dt'])).save(tmp_path / 'm.yaml')
    words = ['validate', str(stage), '--axes', '3', '--model', str(tmp_path / 'm.yaml')]
    assert main([*words, '--out', str(tmp_path / 'out')]) == 0
    assert 'open' in capsys.readouterr().out
    page = (tmp_path / 'out' / 'report.html').read_text()
    shown = (
        'Validation of several axes',
        'displacement 2',
        'Frequency responses',
        'softening [%]',
    )
    for word in (*shown, 'noise [µm]'):
        assert word in page
    summary = json.loads((tmp_path / 'out' / 'summary.json').read_text())
    assert set(summary['levels']) == {'5V', '10V'}
    assert len(summary['records']) == 18
    assert all(row['free_run_rms_m'] > row['noise_m'] > 0.0 for row in summary['records'])


@pytest.mark.component
def test_modes_that_all_axes_share_are_not_told_apart_from_static_cross_talk(
    tmp_path: Path,
) -> None:
    out = tmp_path / 'mirror.npz'
    line = ['axes', '--preset', 'mirror_three_piezos', '--levels', '0.3,0.6', '--seconds', '0.4']
    assert simulate([*line, '--out', str(out)]) == 0
    found = discover_axes(load_axes(out), 'gain')
    assert found.effects == ('cross_talk',)
    assert len(found.cross_talk) == 6
    assert all(0.07 < abs(pair.size) < 0.09 for pair in found.cross_talk)
