"""Records of several axes from tables, arrays, pairs of files and bags."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.io import savemat

from piezo_hysteresis.axes.axes_load import load_axes
from piezo_hysteresis.cli.main import main
from piezo_hysteresis.errors import RecordError, SeveralAxesError
from piezo_hysteresis.records import Record, bag_writer, cdr, load
from piezo_hysteresis.records.definitions import MARKER, STATE, definition_of
from piezo_hysteresis.records.recorder import Recorder

pytestmark = pytest.mark.filterwarnings('ignore::piezo_hysteresis.errors.DataNote')
DT = 1e-3
RANDOM = np.random.default_rng(1)
SAMPLES = 64
U = np.round(RANDOM.normal(size=(SAMPLES, 12)), 6)
Y = np.round(RANDOM.normal(size=(SAMPLES, 12)), 6)  # in um


def table(
    inputs: int = 3, outputs: int = 3, names: str = 'voltage_{}_V displacement_{}_um'
) -> Any:
    """Return named columns, those of higher numbers first."""
    of_u, of_y = names.split()
    columns = {of_u.format(k + 1): U[:, k] for k in reversed(range(inputs))}
    columns |= {of_y.format(k + 1): Y[:, k] for k in reversed(range(outputs))}
    return {'time_s': DT * np.arange(SAMPLES), **columns}


def periods_of(samples: int, runs: int, periods: int) -> Any:
    """Return two channels (sample, channel, realisation, period); periods are nearly the same."""
    one = U[:samples, : 2 * runs].reshape(samples, 2, runs, 1)
    return one * (1 + 1e-3 * np.arange(periods))


def holds(record: Any, inputs: int, outputs: int) -> None:
    np.testing.assert_array_equal(record.voltage, U[:, :inputs])
    np.testing.assert_array_equal(record.displacement, Y[:, :outputs] / 1e6)
    assert record.dt == DT


def write(path: Path, columns: Any) -> Path:
    if path.suffix == '.csv':
        pd.DataFrame(columns).to_csv(path, index=False)
    elif path.suffix == '.mat':
        savemat(path, columns)
    elif path.suffix == '.parquet':
        pd.DataFrame(columns).to_parquet(path)
    elif path.name.endswith('.new.mat'):  # as MATLAB 7.3 does: the first axis is the last one
        with h5py.File(path, 'w', userblock_size=512) as file:
            for name, array in columns.items():
                file[name] = np.atleast_2d(array).T
                file[name].attrs['MATLAB_class'] = np.bytes_('double')
        with path.open('r+b') as raw:
            raw.write(b'MATLAB 7.3 MAT-file')
    elif path.suffix == '.h5':
        with h5py.File(path, 'w') as file:
            file.update(columns)
    else:
        np.savez(path, **columns)
    return path


@pytest.mark.parametrize('kind', ['csv', 'npz', 'mat', 'parquet'])
@pytest.mark.parametrize(('inputs', 'outputs'), [(3, 3), (12, 11), (1, 2)])
def test_numbered_columns_of_a_file(tmp_path: Path, kind: str, inputs: int, outputs: int) -> None:
    (record,) = load_axes(write(tmp_path / f'stage.{kind}', table(inputs, outputs)))
    holds(record, inputs, outputs)
    assert record.name == 'stage'


def test_columns_by_pattern_with_their_unit(tmp_path: Path) -> None:
    columns = table(names='u{} y{}') | {'u_monitor': Y[:, 5], 'temperature': Y[:, 6]}
    path = write(tmp_path / 'a.csv', columns)
    (record,) = load_axes(path, voltage='u[0-9]*', displacement='y*:um')
    holds(record, 3, 3)
    with pytest.raises(RecordError, match=r"no column matches 'w\*'; its columns are time_s, u3"):
        load_axes(path, voltage='w*', displacement='y*')
    with pytest.raises(RecordError, match=r"'u3' is a voltage and a displacement; .*patterns"):
        load_axes(path, voltage='u[0-9]*', displacement='*:um')


def test_letters_name_axes_too_and_a_frame_is_read_like_a_file() -> None:
    frame = pd.DataFrame(table(2, 2)).rename(
        columns=lambda name: name.replace('_1_', '_x_').replace('_2_', '_y_')
    )
    (record,) = load_axes(frame)
    holds(record, 2, 2)


def test_a_large_text_file_is_read_the_fast_way(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('piezo_hysteresis.records.text_tables.LARGE', 100)
    (record,) = load_axes(write(tmp_path / 'a.csv', table()))
    holds(record, 3, 3)


@pytest.mark.parametrize(
    ('change', 'words'),
    [
        (
            {'voltage_2_V': np.r_[U[:30, 1], np.nan, U[31:, 1]]},
            "line 32 has '' in column voltage_2",
        ),
        ({'time_s': np.r_[0, np.arange(SAMPLES - 1)[::-1]] * DT}, 'out of order'),
        ({'time_s': np.r_[np.arange(40), 50 + np.arange(24)] * DT}, '10 samples are missing'),
        ({'displacement_3_um': 1e5 * Y[:, 2]}, r'the displacement spans 0\.\d+ m'),
    ],
)
def test_every_channel_is_checked_like_that_of_one_axis(
    tmp_path: Path, change: Any, words: str
) -> None:
    path = write(tmp_path / 'a.csv', {**table(), **change})
    with pytest.raises(RecordError, match=words):
        load_axes(path)


ARRAYS = st.tuples(
    st.integers(4, 9), st.integers(1, 4), st.integers(1, 4), st.integers(1, 3), st.integers(1, 3)
)


@given(sizes=ARRAYS, dimensions=st.integers(2, 4), order=st.randoms(use_true_random=False))
@settings(max_examples=30, deadline=None)
def test_no_channel_realisation_or_period_is_taken_for_another(
    sizes: Any, dimensions: int, order: Any
) -> None:
    samples, inputs, outputs, runs, periods = sizes
    runs, periods = (runs if dimensions > 2 else 1), (periods if dimensions > 3 else 1)
    # each value tells where it belongs: channel, realisation, period, sample
    place = np.indices((samples, 4, runs, periods))
    full = np.tensordot([1.0, 1e4, 1e6, 1e-3], place, 1)
    volts, metres = full / 1024, -1e-9 * full
    shape = [slice(None)] * dimensions + [0] * (4 - dimensions)
    records = load_axes((volts[:, :inputs][*shape], metres[:, :outputs][*shape]), dt=DT)
    assert len(records) == runs
    for run, record in enumerate(records):
        assert record.periods == (periods if dimensions == 4 else 0)
        for k in range(periods):
            part = record.section(k * samples, (k + 1) * samples)
            np.testing.assert_array_equal(part.voltage, volts[:, :inputs, run, k])
            np.testing.assert_array_equal(part.displacement, metres[:, :outputs, run, k])
    # columns of a table in any order give the same channels
    columns = {f'voltage_{k + 7}_V': volts[:, k, 0, 0] for k in range(inputs)}
    columns |= {f'displacement_{k + 7}_m': metres[:, k, 0, 0] for k in range(outputs)}
    names = list(columns)
    order.shuffle(names)
    (record,) = load_axes({name: columns[name] for name in names}, dt=DT)
    np.testing.assert_array_equal(record.voltage, volts[:, :inputs, 0, 0])
    np.testing.assert_array_equal(record.displacement, metres[:, :outputs, 0, 0])


def test_periods_are_stated_by_the_array_or_by_its_user() -> None:
    u, y = np.tile(U[:16, :2], (4, 1)), 1e-6 * Y[:, :2]
    assert load_axes((u, y), dt=DT)[0].periods == 0
    assert load_axes((u, y), dt=DT, periodic=True)[0].periods == 1
    assert load_axes((u, y), dt=DT, periodic=4)[0].periods == 4
    four = [each.reshape(4, 16, 2, 1).transpose(1, 2, 3, 0) for each in (u, y)]
    assert load_axes(tuple(four), dt=DT)[0].periods == 4
    assert load_axes(tuple(four), dt=DT, periodic=False)[0].periods == 0
    with pytest.raises(RecordError, match=r'hold 4 periods \(fourth dimension\), not 3'):
        load_axes(tuple(four), dt=DT, periodic=3)
    with pytest.raises(RecordError, match='64 samples are not 5 whole periods'):
        load_axes((u, y), dt=DT, periodic=5)


def test_columns_of_two_lengths_or_clocks_are_refused(tmp_path: Path) -> None:
    columns = table()
    del columns['time_s']
    path = write(tmp_path / 'a.npz', {**columns, 'dt': DT, 'voltage_2_V': U[:50, 1]})
    with pytest.raises(
        RecordError, match=r'differ in length \(voltage_2_V 50, displacement_2_um 64'
    ):
        load_axes(path)
    write(tmp_path / 'b.csv', table())
    slow = table() | {'time_s': 2 * DT * np.arange(SAMPLES)}
    write(tmp_path / 'c.csv', slow)
    with pytest.raises(RecordError, match='record b has 1000 Hz but record c 500 Hz'):
        load_axes([tmp_path / 'b.csv', tmp_path / 'c.csv'])


@pytest.mark.parametrize(
    ('name', 'level'),
    [
        ('sine_100mV_train', '100mV'),
        ('1.5 V', '1.5 V'),
        ('run3V2', ''),
        ('run3_V', ''),
        ('5Vpp', ''),
    ],
)
def test_a_level_is_an_amplitude_in_the_name(tmp_path: Path, name: str, level: str) -> None:
    (record,) = load_axes(write(tmp_path / f'{name}.csv', table(2, 2)))
    assert record.level == level or (not level and record.level.endswith('V RMS'))


def test_levels_are_stated_by_names_or_found_from_the_voltage(tmp_path: Path) -> None:
    for name, size in (('5V', 5.0), ('0.5 V', 0.5)):
        np.save(tmp_path / f'u_{name}_train.npy', size * U[:, :2])
        np.save(tmp_path / f'y_{name}_train.npy', 1e-6 * size * Y[:, :2])
    records = load_axes(tmp_path, fs=1e3)
    assert [(r.name, r.level) for r in records] == [
        ('0.5 V_train', '0.5 V'), ('5V_train', '5V'),
    ]  # fmt: skip
    scaled = [(size * U[:, :2], 1e-6 * size * Y[:, :2]) for size in (1.0, 2.0, 1.02)]
    first, second, third = load_axes(scaled, fs=1e3)
    assert first.level == third.level != second.level


def test_pairs_of_files_in_a_folder(tmp_path: Path) -> None:
    many = periods_of(16, 3, 8)
    for amplitude in (100, 20):
        np.save(tmp_path / f'u_{amplitude}mV.npy', amplitude / 1e3 * many)
        np.save(tmp_path / f'y_{amplitude}mV.npy', 1e-6 * amplitude * many[:, ::-1])
    records = load_axes(tmp_path, fs=500)
    assert [r.name for r in records] == [f'{a}mV/{k}' for a in (20, 100) for k in range(3)]
    assert {(r.dt, r.periods, len(r)) for r in records} == {(1 / 500, 8, 128)}
    np.testing.assert_array_equal(records[4].voltage[16:32], 0.1 * many[:, :, 1, 1])
    np.testing.assert_allclose(records[4].displacement[:, 0], 1e-3 * records[4].voltage[:, 1])
    with pytest.raises(RecordError, match=r'arrays have no time; give their rate with --fs HZ'):
        load_axes(tmp_path)
    chosen = load_axes(tmp_path, fs=500, voltage='u_1*', displacement='y_1*:um')
    assert [r.name for r in chosen] == [f'100mV/{k}' for k in range(3)]
    np.testing.assert_allclose(chosen[0].displacement, records[3].displacement / 1e6)
    both = load_axes(tmp_path, fs=500, voltage='u_[12]?*', displacement='y_[12]?*')
    assert [r.name for r in both] == [r.name for r in records]
    with pytest.raises(RecordError, match=r"pattern 'u_\[2-1\]\*' is not understood"):
        load_axes(tmp_path, fs=500, voltage='u_[2-1]*', displacement='y*')
    (tmp_path / 'y_20mV.npy').unlink()
    with pytest.raises(RecordError, match='u_20mV has no partner; names of voltage and'):
        load_axes(tmp_path, fs=500, voltage='u*', displacement='y*')


@pytest.mark.parametrize('kind', ['npz', 'mat', 'h5', 'new.mat'])
def test_arrays_of_realisations_in_one_file_state_their_rate(tmp_path: Path, kind: str) -> None:
    many = periods_of(32, 3, 4)
    path = write(tmp_path / f'a.{kind}', {'u': many, 'y': 1e-6 * many[:, :1], 'fs': 2000.0})
    records = load_axes(path)
    assert [(r.name, r.axes, r.outputs, r.periods, r.dt) for r in records] == [
        (f'{path.stem}/{k}', 2, 1, 4, 1 / 2000) for k in range(3)
    ]
    np.testing.assert_array_equal(records[2].voltage[:32], many[:, :, 2, 0])


@pytest.mark.parametrize(
    ('arrays', 'words'),
    [
        ((U[:, :3], Y[:, :3]), r'the displacement spans \d\.\d+ m, which no piezo actuator does'),
        ((U[:, :3], Y[:50, :3]), r'voltage has the shape \(64, 3\) and displacement \(50, 3\)'),
        ((U[:3], Y[:3]), r'\(3, 12\), so more channels than samples.*transpose'),
        ((U.reshape(16, 3, 4, 4), Y.reshape(16, 3, 2, 8)), 'only the number of channels'),
        ((np.zeros((8, 1, 1, 1, 1)), Y), r'the shape \(8, 1, 1, 1, 1\); arrays are'),
        ((np.array([['a', 'b']]), Y), 'voltage is no array of numbers'),
    ],
)
def test_arrays_that_do_not_fit_are_refused(arrays: Any, words: str) -> None:
    with pytest.raises(RecordError, match=words):
        load_axes(arrays, dt=DT)


def test_records_of_other_channels_or_rates_are_refused(tmp_path: Path) -> None:
    two, three = (U[:, :2], 1e-6 * Y[:, :2]), (U[:, :3], 1e-6 * Y[:, :3])
    with pytest.raises(RecordError, match='record record has 2 axes but record record-2 3 axes'):
        load_axes([two, three], dt=DT)
    with pytest.raises(RecordError, match='it has 2 axes, not 3 axes'):
        load_axes(two, dt=DT, axes=3)
    slow = load_axes(two, dt=2 * DT)
    with pytest.raises(RecordError, match='has 500 Hz but record record-2 1000 Hz'):
        load_axes([*slow, two], dt=DT)


def test_the_sign_of_sensors_of_the_distance() -> None:
    (record,) = load_axes((U[:, :2], 1e-6 * Y[:, :2]), dt=DT, sign=-1)
    np.testing.assert_array_equal(record.displacement, -1e-6 * Y[:, :2])


START = 1_700_000_000_000_000_000  # [ns]


def bag(path: Path, parts: Any, *, names: str = '/axis_{}', marks: Any = ()) -> Path:
    """Write states of axes by (columns of U and Y, samples, shift of the stamps [ns]).

    `marks` are (topic, record, first sample).
    """
    with Recorder(path) as recorder:
        for k, samples, shift in parts:
            number = recorder.add_topic(
                f'{names.format(k + 1)}/actuator/state', STATE, definition=definition_of(STATE)[0]
            )
            stamps = START + shift + 1_000_000 * samples
            columns = {'sample': samples, 'voltage': U[samples, k],
                       'displacement': Y[samples, k] / 1e6}  # fmt: skip
            rows = cdr.encode(bag_writer.fixed_fields(STATE), stamps, columns)
            for row, time in zip(rows, stamps.tolist(), strict=True):
                recorder.write(number, row.tobytes(), time)
        topics: dict[str, int] = {}
        for topic, name, first in marks:
            if topic not in topics:
                topics[topic] = recorder.add_topic(
                    topic, MARKER, definition=definition_of(MARKER)[0]
                )
            stamp = START + 1_000_000 * first
            row = bag_writer.marker_row(Record(name, DT, U[:, 0], Y[:, 0]), stamp)
            recorder.write(topics[topic], row.tobytes(), stamp)
    return path


ALL = np.arange(SAMPLES)


def test_axes_of_a_bag_are_those_of_its_namespaces(tmp_path: Path) -> None:
    parts = [(k, ALL, 0) for k in reversed(range(12))]
    (record,) = load_axes(bag(tmp_path / 'bag', parts))
    holds(record, 12, 12)
    (record,) = load_axes(bag(tmp_path / 'xy', parts[-2:], names='/stage/ax_{}'))
    holds(record, 2, 2)


@pytest.mark.parametrize('own', [True, False])
def test_markers_cut_all_axes_alike(tmp_path: Path, own: bool) -> None:
    topics = [f'/axis_{k}/record/marker' for k in (1, 2)] if own else ['/record/marker']
    marks = [(t, name, first) for t in topics for name, first in (('slow', 0), ('fast', 40))]
    path = bag(tmp_path / 'bag', [(0, ALL, 0), (1, ALL, 0)], marks=marks)
    slow, fast = load_axes(path)
    assert (slow.name, len(slow), fast.name, len(fast)) == ('slow', 40, 'fast', 24)
    np.testing.assert_array_equal(fast.voltage, U[40:, :2])
    if own:
        path = bag(tmp_path / 'other', [(0, ALL, 0), (1, ALL, 0)], marks=marks[:-1])
        with pytest.raises(
            RecordError, match=r'axis_1/\S+ \(slow, fast\) and /axis_2/\S+ \(slow\)'
        ):
            load_axes(path)


def test_samples_are_joined_by_their_stamps(tmp_path: Path) -> None:
    path = bag(tmp_path / 'bag', [(0, ALL[:-2], 0), (1, ALL[3:], 0), (2, ALL, 0)])
    (record,) = load_axes(path)
    np.testing.assert_array_equal(record.voltage, U[3:-2, :3])
    np.testing.assert_array_equal(record.displacement, Y[3:-2, :3] / 1e6)
    lacking = bag(tmp_path / 'lacking', [(0, ALL, 0), (1, np.delete(ALL, [30, 31]), 0)])
    with pytest.raises(RecordError, match='2 samples are missing in 1 gap'):
        load_axes(lacking)


def test_axes_of_two_clocks_are_refused_and_so_are_other_bags(tmp_path: Path) -> None:
    path = bag(tmp_path / 'bag', [(0, ALL, 0), (1, ALL, 300_000)])
    words = 'the stamps of /axis_1/actuator/state and /axis_2/actuator/state differ; .*one clock'
    with pytest.raises(RecordError, match=words):
        load_axes(path)
    with pytest.raises(RecordError, match='of a bag, several axes are read from the topics'):
        load_axes(path, voltage='u*', displacement='y*')


# What has several axes is refused by whatever reads one, with the same sentence.


def sources(tmp_path: Path) -> Any:
    columns = table(2, 2)
    np.save(tmp_path / 'u_a.npy', U[:, :2])
    np.save(tmp_path / 'y_a.npy', Y[:, :2])
    many = periods_of(16, 2, 8)
    return {
        'file': write(tmp_path / 'a.csv', columns),
        'no unit': write(
            tmp_path / 'b.mat', {'t_s': columns['time_s'], 'u': U[:, :2], 'y': Y[:, :2]}
        ),
        'array': write(tmp_path / 'c.npz', {'u': many, 'y': 1e-6 * many, 'fs': 100.0}),
        'folder': tmp_path,
        'bag': bag(tmp_path / 'bag', [(0, ALL, 0), (1, ALL, 0)]),
        'frame': pd.DataFrame(columns),
        'memory': (U[:, :2], Y[:, :2]),
    }


@pytest.mark.parametrize('kind', ['file', 'no unit', 'array', 'folder', 'bag', 'frame', 'memory'])
def test_several_axes_are_no_record_of_one(tmp_path: Path, kind: str) -> None:
    source = sources(tmp_path)[kind]
    words = r'it has 2 axes \(.*1.*; .*1.*\); use `identify --model modes`.*load_axes'
    with pytest.raises(SeveralAxesError, match=words) as caught:
        load(source, dt=DT if kind == 'memory' else None)
    assert '\n' not in str(caught.value)


def test_one_axis_of_several_is_read_by_its_columns(tmp_path: Path) -> None:
    path = write(tmp_path / 'a.csv', table(3, 2))
    with pytest.raises(SeveralAxesError, match='it has 3 voltages and 2 displacements'):
        load(path)
    (record,) = load(path, columns={'voltage': 'voltage_3_V', 'displacement': 'displacement_1_um'})
    np.testing.assert_array_equal(record.voltage, U[:, 2])
    path = bag(tmp_path / 'bag', [(0, ALL, 0), (1, ALL, 0)])
    np.testing.assert_array_equal(load(path, actuator='axis_2').voltage, U[:, 1])


@pytest.mark.parametrize(
    'names',
    [
        'time_s,voltage_V,displacement_um',
        'time_s,Voltage (V),Position (um),Position 2',
        'time_s,CH1 (V),CH2 (um)',
    ],
)
def test_one_pair_is_one_axis(tmp_path: Path, names: str) -> None:
    values = [DT * ALL, U[:, 0], Y[:, 0], Y[:, 1]]
    path = write(tmp_path / 'a.csv', dict(zip(names.split(','), values, strict=False)))
    assert len(load(path)) == 1


def test_two_voltages_without_a_number_stay_ambiguous(tmp_path: Path) -> None:
    columns = {'time_s': DT * ALL, 'Drive (V)': U[:, 0], 'Voltage (V)': U[:, 1],
               'displacement_um': Y[:, 0]}  # fmt: skip
    path = write(tmp_path / 'a.csv', columns)
    with pytest.raises(RecordError, match='voltage may be') as caught:
        load(path)
    assert not isinstance(caught.value, SeveralAxesError)
    with pytest.raises(RecordError, match='a voltage may be each of'):
        load_axes(path)


def test_info_lists_what_several_axes_share(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    many = np.tile(U[:16, :3, None, None], (1, 1, 2, 4))
    for amplitude in (1, 2):
        noise = 1e-9 * RANDOM.normal(size=(16, 2, 2, 4))
        np.save(tmp_path / f'u_{amplitude}V.npy', amplitude * many)
        np.save(tmp_path / f'y_{amplitude}V.npy', 1e-6 * many[:, :2] + noise)
    assert main(['info', str(tmp_path), '--fs', '500']) == 0
    text = capsys.readouterr().out
    assert '3 voltages and 2 displacements at 500 Hz; levels: 1V (2 records), 2V (2' in text
    (row,) = [line.split() for line in text.splitlines() if line.startswith('2V/1')]
    assert row[1:4] == ['64', '4', '2V']
    assert all(0.7 < float(noise) < 1.4 for noise in row[-2:])
    assert main(['info', str(tmp_path)]) == 2
    assert 'give their rate with --fs' in capsys.readouterr().err


def test_patterns_of_info_choose_channels(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write(tmp_path / 'a.csv', table(3, 2, 'u{} y{}'))
    assert main(['info', str(path), '--voltage', 'u[13]:V', '--displacement', 'y*:um']) == 0
    assert '2 axes at 1000 Hz' in capsys.readouterr().out


@pytest.mark.parametrize('verb', ['identify --model classical', 'discover --baseline classical'])
def test_verbs_of_one_axis_refuse_several(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], verb: str
) -> None:
    path = write(tmp_path / 'a.csv', table())
    name, *rest = verb.split()
    assert main([name, str(path), *rest, '--out', str(tmp_path / 'out')]) == 2
    error = capsys.readouterr().err
    assert 'it has 3 axes (voltage_1_V to voltage_3_V; displacement_1_um to' in error
    assert error.count('\n') == 1
