"""Records in the files that labs keep, written by the libraries themselves."""

from __future__ import annotations

import sys
from collections.abc import Callable
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from piezo_hysteresis.cli.main import main
from piezo_hysteresis.errors import DataNote, RecordError
from piezo_hysteresis.records import Record, load
from piezo_hysteresis.records.formats.reading import WRITTEN, write_table

TIME = np.arange(400) * 1e-3
VOLTAGE = 40.0 * np.sin(2 * np.pi * 5.0 * TIME)
MOVED = 0.12 * VOLTAGE + 3.0 * np.cos(2 * np.pi * 5.0 * TIME)  # um
COLUMNS = {'time_s': TIME, 'voltage_V': VOLTAGE, 'displacement_um': MOVED}
RECORD = Record('sweep', 1e-3, VOLTAGE, 1e-6 * MOVED)


def holds(record: Record, name: str | None = None) -> None:
    assert name is None or record.name == name
    assert record.dt == pytest.approx(1e-3)
    np.testing.assert_allclose(record.voltage, VOLTAGE, rtol=1e-12)
    np.testing.assert_allclose(record.displacement, 1e-6 * MOVED, rtol=1e-12, atol=1e-20)


@pytest.mark.parametrize('ending', WRITTEN)
def test_what_is_written_is_read_again(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f'sweep.{ending}'
    write_table(path, RECORD, unit='m')
    (record,) = load(path)
    holds(record, 'sweep')
    if ending != 'xlsx':  # Excel keeps 15 digits
        np.testing.assert_array_equal(record.displacement, RECORD.displacement)
    with pytest.raises(RecordError, match='exists already'):
        write_table(path, RECORD)
    assert [each.name for each in tmp_path.iterdir()] == [path.name]


def matlab(path: Path, **entries: Any) -> Path:
    from scipy.io import savemat

    savemat(path, entries)
    return path


def test_structs_of_a_matlab_file_are_records(tmp_path: Path) -> None:
    path = matlab(tmp_path / 'runs.mat', slow=COLUMNS, fast=COLUMNS, note='two runs')
    records = load(path)
    assert [record.name for record in records] == ['runs_slow', 'runs_fast']
    for record in records:
        holds(record)


@pytest.mark.parametrize('scalar', [{'dt': 1e-3}, {'Fs': 1000.0}])
def test_a_scalar_stands_for_the_time(tmp_path: Path, scalar: dict[str, Any]) -> None:
    path = matlab(tmp_path / 'x.mat', voltage_V=VOLTAGE, displacement_um=MOVED, **scalar)
    holds(load(path)[0], 'x')
    np.savez(tmp_path / 'x.npz', voltage_V=VOLTAGE, displacement_um=MOVED, **scalar)
    holds(load(tmp_path / 'x.npz')[0], 'x')


def test_matlab_73_is_hdf5(tmp_path: Path) -> None:
    h5py = pytest.importorskip('h5py')
    path = tmp_path / 'new.mat'
    with h5py.File(path, 'w', userblock_size=512) as file:
        file.create_group('#refs#')['a'] = np.arange(3.0)
        for name, column in COLUMNS.items():
            file[name] = column[None]  # MATLAB's columns are rows here
    with path.open('r+b') as raw:
        raw.write(b'MATLAB 7.3 MAT-file'.ljust(124) + b'\x00\x02IM')
    holds(load(path)[0], 'new')


def test_a_matlab_object_is_refused_with_the_remedy(tmp_path: Path, monkeypatch: Any) -> None:
    import scipy.io
    from scipy.io.matlab import MatlabOpaque

    opaque = MatlabOpaque(np.zeros(1, [('s0', 'O'), ('s1', 'O'), ('s2', 'O'), ('arr', 'O')]))
    path = matlab(tmp_path / 'object.mat', x=1.0)
    monkeypatch.setattr(scipy.io, 'loadmat', lambda *_, **__: {'run': opaque})
    with pytest.raises(RecordError, match=r'run is a MATLAB object .* save its columns'):
        load(path)


def test_a_matlab_object_of_73_is_refused_with_the_remedy(tmp_path: Path) -> None:
    h5py = pytest.importorskip('h5py')
    path = tmp_path / 'object.mat'
    with h5py.File(path, 'w', userblock_size=512) as file:
        file.create_group('#subsystem#')['MCOS'] = np.zeros(3)
        file['run'] = np.array([3707764736, 2, 1, 1, 1, 1], np.uint32)
        file['run'].attrs['MATLAB_class'] = np.bytes_('timetable')
        file['run'].attrs['MATLAB_object_decode'] = np.int32(3)
    with path.open('r+b') as raw:
        raw.write(b'MATLAB 7.3 MAT-file'.ljust(124) + b'\x00\x02IM')
    with pytest.raises(RecordError, match=r'run is a MATLAB object .* save its columns'):
        load(path)


@pytest.mark.parametrize('share', [0.01, 0.5, 0.99])
def test_a_tdms_file_that_was_cut_off_is_refused(
    tmp_path: Path, share: float, caplog: pytest.LogCaptureFixture
) -> None:
    nptdms = pytest.importorskip('nptdms')
    path = tmp_path / 'cut.tdms'
    channels = [
        nptdms.ChannelObject('run', name, column, properties={'wf_increment': 1e-3})
        for name, column in COLUMNS.items()
    ]
    with nptdms.TdmsWriter(str(path)) as file:
        file.write_segment(channels)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(RecordError, match='cut off; save it again'):
        load(path)
    assert caplog.records == []


def test_groups_of_hdf5_are_records(tmp_path: Path) -> None:
    h5py = pytest.importorskip('h5py')
    with h5py.File(tmp_path / 'runs.h5', 'w') as file:
        for name in ('one', 'two'):
            group = file.create_group(name)
            group.attrs['fs'] = 1000.0
            group['U (V)'], group['Weg [µm]'] = VOLTAGE, MOVED
    with pytest.warns(DataNote, match="voltage from column 'U"):
        records = load(tmp_path / 'runs.h5')
    for record, name in zip(records, ('runs_one', 'runs_two'), strict=True):
        holds(record, name)


def test_fields_and_columns_of_numpy(tmp_path: Path, capsys: Any) -> None:
    fields = np.zeros(TIME.size, [(name, float) for name in COLUMNS])
    for name, column in COLUMNS.items():
        fields[name] = column
    np.save(tmp_path / 'fields.npy', fields)
    holds(load(tmp_path / 'fields.npy')[0], 'fields')
    path = tmp_path / 'plain.npy'
    np.save(path, np.array(list(COLUMNS.values())).T)
    with pytest.raises(RecordError, match='use `import` with --time COLUMN:UNIT'):
        load(path)
    words = ['--time', '1', '--voltage', '2', '--displacement', '3:um']
    assert main(['import', str(path), '--out', str(tmp_path / 'bag'), *words]) == 0
    holds(load(tmp_path / 'bag')[0], 'plain')
    assert main(['import', str(path), '--out', str(tmp_path / 'b'), '--header-row', '2']) != 0
    assert '--header-row and --skip-rows are for text' in capsys.readouterr().err


def test_sheets_of_excel_are_records(tmp_path: Path) -> None:
    openpyxl = pytest.importorskip('openpyxl')
    book = openpyxl.Workbook()
    book.active.title = 'Notizen'
    book.active.append(['Aktor', 'P-885'])
    sheet = book.create_sheet('Lauf')
    sheet.append(['gemessen am', 'Montag'])
    sheet.append(['Uhrzeit', 'Spannung [V]', 'Weg [µm]'])
    start = datetime(2026, 11, 25, 12)
    for t, v, y in zip(TIME.tolist(), VOLTAGE.tolist(), MOVED.tolist(), strict=True):
        sheet.append([start + timedelta(seconds=t), v, y])
    book.save(tmp_path / 'buch.xlsx')
    with pytest.warns(DataNote):
        (record,) = load(tmp_path / 'buch.xlsx')
    holds(record, 'buch')


def tdms(path: Path, steps: tuple[float, float]) -> Path:
    nptdms = pytest.importorskip('nptdms')
    channels = [
        nptdms.ChannelObject('run', name, column, {'wf_increment': step, 'unit_string': unit})
        for name, column, unit, step in zip(
            ('Voltage', 'Position'), (VOLTAGE, MOVED), ('V', 'um'), steps, strict=True
        )
    ]
    with nptdms.TdmsWriter(str(path)) as file:
        file.write_segment(channels)
    return path


def test_the_increment_of_tdms_is_the_time(tmp_path: Path) -> None:
    with pytest.warns(DataNote):
        holds(load(tdms(tmp_path / 'run.tdms', (1e-3, 1e-3)))[0], 'run')
    with pytest.raises(RecordError, match='different increments: two rates'):
        load(tdms(tmp_path / 'two.tdms', (1e-3, 2e-3)))


def test_times_of_a_data_frame_are_seconds(tmp_path: Path) -> None:
    import pyarrow
    from pyarrow import feather

    stamps = np.datetime64('2026-11-25T12:00') + (1e6 * TIME).astype('timedelta64[us]')
    table = {'time': stamps, 'voltage_V': VOLTAGE, 'displacement_um': MOVED}
    feather.write_feather(pyarrow.table(table), tmp_path / 'frame.feather')
    holds(load(tmp_path / 'frame.feather')[0], 'frame')


def test_columns_of_two_lengths_are_no_record(tmp_path: Path) -> None:
    np.savez(tmp_path / 'x.npz', **{**COLUMNS, 'voltage_V': VOLTAGE[::2]})
    with pytest.raises(RecordError, match=r'voltage_V 200, .* two rates are no record'):
        load(tmp_path / 'x.npz')
    np.savez(tmp_path / 'y.npz', a=np.ones(3))
    with pytest.raises(RecordError, match='no columns of numbers'):
        load(tmp_path / 'y.npz')


def test_a_missing_library_is_named(tmp_path: Path, monkeypatch: Any) -> None:
    (tmp_path / 'x.h5').write_bytes(b'')
    monkeypatch.setitem(sys.modules, 'h5py', None)
    with pytest.raises(
        RecordError, match=r"needs h5py; pip install 'piezo_hysteresis\[formats\]'"
    ):
        load(tmp_path / 'x.h5')
    with pytest.raises(RecordError, match='needs h5py'):
        write_table(tmp_path / 'y.h5', RECORD)


@pytest.mark.parametrize('ending', WRITTEN)
def test_records_are_exported_in_every_format(tmp_path: Path, ending: str) -> None:
    write_table(tmp_path / 'sweep.npz', RECORD)
    words = ['export', str(tmp_path / 'sweep.npz'), '--out', str(tmp_path / 'out')]
    assert main([*words, '--format', ending]) == 0
    (record,) = load(tmp_path / 'out' / f'sweep.{ending}')
    holds(record, 'sweep')


def cut(data: bytes, place: float, length: int) -> bytes:
    begin = int(place * len(data))
    return data[:begin] + data[begin + length :]


def shortened(data: bytes, place: float, length: int) -> bytes:
    return data[: int(place * len(data))]


def refused(path: Path) -> str | None:
    """Return the sentence with which a file is refused; anything but a sentence fails."""
    try:
        load(path)
    except RecordError as error:
        return str(error)
    return None


@pytest.mark.parametrize('ending', WRITTEN)
@given(
    damage=st.sampled_from([cut, shortened]), place=st.floats(0.0, 1.0), length=st.integers(1, 300)
)
@settings(max_examples=15, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_damaged_file_is_refused_in_a_sentence(
    tmp_path: Path,
    ending: str,
    damage: Callable[[bytes, float, int], bytes],
    place: float,
    length: int,
) -> None:
    whole = tmp_path / f'whole.{ending}'
    if not whole.exists():
        write_table(whole, RECORD)
    path = tmp_path / f'damaged.{ending}'
    path.write_bytes(damage(whole.read_bytes(), place, length))
    sentence = refused(path)
    assert sentence is None or (str(path) in sentence and '\n' not in sentence)


def test_channels_that_start_apart_are_joined_by_time(tmp_path: Path) -> None:
    nptdms = pytest.importorskip('nptdms')
    path = tmp_path / 'apart.tdms'
    channels = [
        nptdms.ChannelObject('run', 'Voltage', VOLTAGE, {'wf_increment': 1e-3, 'unit_string': 'V'}),  # noqa: E501
        nptdms.ChannelObject(
            'run', 'Position', MOVED[7:],
            {'wf_increment': 1e-3, 'wf_start_offset': 7e-3, 'unit_string': 'um'},
        ),
        nptdms.ChannelObject('run', 'Room', MOVED[:4], {'wf_increment': 1.0, 'unit_string': 'K'}),
    ]  # fmt: skip
    with nptdms.TdmsWriter(str(path)) as file:
        file.write_segment(channels)
    with pytest.warns(DataNote, match='starts -7 ms after displacement'):
        (record,) = load(path)
    np.testing.assert_array_equal(record.voltage, VOLTAGE[7:])
    np.testing.assert_allclose(record.displacement, 1e-6 * MOVED[7:], rtol=1e-12, atol=1e-20)


def test_a_written_tdms_file_has_times_for_its_library(tmp_path: Path) -> None:
    nptdms = pytest.importorskip('nptdms')
    write_table(tmp_path / 'x.tdms', RECORD)
    channel = nptdms.TdmsFile.read(str(tmp_path / 'x.tdms'))['record']['voltage_V']
    np.testing.assert_allclose(channel.time_track(), TIME, atol=1e-12)


def test_structs_of_simulink_and_controldesk(tmp_path: Path) -> None:
    signals = [{'values': VOLTAGE, 'label': 'u [V]'}, {'values': MOVED, 'label': 'weg [um]'}]
    path = matlab(tmp_path / 'a.mat', out={'time': TIME, 'signals': signals})
    with pytest.warns(DataNote, match='Simulink structure with time'):
        holds(load(path)[0])
    signals = [{'Name': 'M/Voltage', 'Data': VOLTAGE, 'Unit': 'V'},
               {'Name': 'M/Position', 'Data': MOVED, 'Unit': 'um'}]  # fmt: skip
    path = matlab(tmp_path / 'b.mat', run={'X': {'Name': 't', 'Data': TIME}, 'Y': signals})
    with pytest.warns(DataNote, match='ControlDesk recording'):
        holds(load(path)[0])
    fields = {'voltage_V': {'Time': TIME, 'Data': VOLTAGE},
              'displacement_um': {'Time': TIME, 'Data': MOVED}}  # fmt: skip
    with pytest.warns(DataNote, match='Dataset as struct'):
        holds(load(matlab(tmp_path / 'c.mat', logsout=fields))[0])


def test_words_and_formulas_of_excel(tmp_path: Path) -> None:
    openpyxl = pytest.importorskip('openpyxl')
    book = openpyxl.Workbook()
    rows = list(zip(TIME.tolist(), VOLTAGE.tolist(), MOVED.tolist(), strict=True))
    book.active.append(['time_s', 'voltage_V', 'displacement_um', None, 'Mean', 50])
    for k, row in enumerate(rows):
        book.active.append([*row, None, 'Max' if k == 0 else None, 100 if k == 0 else None])
    book.save(tmp_path / 'side.xlsx')
    holds(load(tmp_path / 'side.xlsx')[0])
    book.active['B2'] = 1
    for k in range(2, 402):
        book.active[f'B{k}'] = '=A2'
    book.save(tmp_path / 'formula.xlsx')
    with pytest.raises(RecordError, match='formulas count by those that Excel stored'):
        load(tmp_path / 'formula.xlsx')
    far = openpyxl.Workbook()
    far.active['A1'] = far.active['XFD1048576'] = 1
    far.save(tmp_path / 'far.xlsx')
    with pytest.raises(RecordError, match='1048576 rows of 16384 cells'):
        load(tmp_path / 'far.xlsx')


def test_an_archive_is_judged_before_it_is_expanded(tmp_path: Path, monkeypatch: Any) -> None:
    from piezo_hysteresis.records.formats import sizes

    monkeypatch.setattr(sizes, 'LARGEST', 5000)
    np.savez_compressed(tmp_path / 'x.npz', **COLUMNS)
    np.save(tmp_path / 'x.npy', np.zeros((400, 3)))
    path = matlab(tmp_path / 'x.mat', **COLUMNS)
    book = pytest.importorskip('openpyxl').Workbook()
    for row in zip(*COLUMNS.values(), strict=True):
        book.active.append(row)
    book.save(tmp_path / 'x.xlsx')
    for each in (tmp_path / 'x.npz', tmp_path / 'x.npy', path, tmp_path / 'x.xlsx'):
        with pytest.raises(RecordError, match=r'would take .* save time'):
            load(each)


def test_hdf5_reads_its_own_file_only(tmp_path: Path) -> None:
    h5py = pytest.importorskip('h5py')
    with h5py.File(tmp_path / 'other.h5', 'w') as file:
        file['displacement_um'] = MOVED
    with h5py.File(tmp_path / 'x.h5', 'w') as file:
        file['time_s'], file['voltage_V'] = TIME, VOLTAGE
        file['displacement_um'] = h5py.ExternalLink('other.h5', 'displacement_um')
    with pytest.raises(RecordError, match='no column of displacement'):
        load(tmp_path / 'x.h5')
    (tmp_path / 'z.bin').write_bytes(np.asarray(MOVED, '<f8').tobytes())
    with h5py.File(tmp_path / 'z.h5', 'w') as file:
        file['time_s'], file['voltage_V'] = TIME, VOLTAGE
        stored = [(str(tmp_path / 'z.bin'), 0, 8 * len(MOVED))]
        file.create_dataset('displacement_um', (len(MOVED),), '<f8', external=stored)
    with pytest.raises(RecordError, match='no column of displacement'):
        load(tmp_path / 'z.h5')
    with h5py.File(tmp_path / 'y.h5', 'w') as file:
        for key, values in (('t', TIME), ('u', VOLTAGE), ('pos', MOVED)):
            file[key] = values
            file[key].attrs['units'] = {'t': 's', 'u': 'V', 'pos': 'um'}[key]
        file['nowhere'] = h5py.ExternalLink('none.h5', 'x')
    with pytest.warns(DataNote, match='/nowhere lies in another file'):
        holds(load(tmp_path / 'y.h5')[0])


def test_records_of_an_array_of_three_dimensions(tmp_path: Path) -> None:
    np.save(tmp_path / 'runs.npy', np.array([list(COLUMNS.values())] * 2))
    records = load(
        tmp_path / 'runs.npy', columns={'time': '1:s', 'voltage': '2:V', 'displacement': '3:um'}
    )
    for record in records:
        holds(record)
    assert len(records) == 2
