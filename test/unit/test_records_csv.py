"""CSV files: units in the column names, helpful refusals, and back again."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from piezo_hysteresis.cli.main import main
from piezo_hysteresis.errors import DataNote, RecordError
from piezo_hysteresis.records import (
    Record,
    RecordInfo,
    load,
    read_csv,
    survey,
    text_tables,
    write_csv,
)
from piezo_hysteresis.records.columns import ReadOptions
from piezo_hysteresis.records.damage import DamageLog
from piezo_hysteresis.records.load import column_records


def write(path: Path, text: Any) -> Path:
    path.write_text(text, encoding='utf-8')
    return path


def rows(
    n: int = 40, dt: float = 1e-3, head: str = 'time_s,voltage_V,displacement_um', join: str = ','
) -> str:
    body = [join.join(map(repr, (k * dt, 10.0 * (k % 7), 0.5 * (k % 5)))) for k in range(n)]
    return '\n'.join([head, *body]) + '\n'


@pytest.mark.parametrize(
    ('column', 'scale'),
    [('displacement_m', 1), ('displacement_mm', 1e3), ('displacement_um', 1e6),
     ('displacement_nm', 1e9), ('Displacement_UM', 1e6), ('displacement_µm', 1e6)],
)  # fmt: skip
def test_lengths_come_in_metres(tmp_path: Path, column: str, scale: float) -> None:
    text = rows(head=f'time_s,voltage_V,{column}').split('\n')
    text = [text[0], *(f'{a},{b},{float(c) * scale * 1e-6!r}' for a, b, c in
                       (line.split(',') for line in text[1:-1]))]  # fmt: skip
    record = read_csv(write(tmp_path / 'a.csv', '\n'.join(text)))
    np.testing.assert_allclose(record.displacement[:5], 0.5e-6 * np.arange(5), rtol=1e-15)
    assert record.dt == 1e-3
    assert record.name == 'a'
    assert record.info.input_unit == 'V'


def test_times_voltages_forces_references_and_further_columns(tmp_path: Path) -> None:
    head = 'comment,reference_nm,time_ms,force_kN,displacement_um'
    text = '\n'.join([head, *(f'x{k},{k % 3},{k * 2},{0.5 * (k % 4)},{k % 5}' for k in range(40))])
    record = read_csv(write(tmp_path / 'a.csv', text))
    assert record.dt == pytest.approx(2e-3, rel=1e-15)
    assert record.info.input_unit == 'N'
    np.testing.assert_array_equal(record.voltage[:4], [0, 500, 1000, 1500])
    assert record.reference is not None
    np.testing.assert_array_equal(record.reference[:3], [0, 1e-9, 2e-9])


@pytest.mark.parametrize('join', [',', ';', '\t'])
def test_delimiters_comments_and_byte_order_marks(tmp_path: Path, join: str) -> None:
    head = join.join(['time_s', '"voltage_V"', ' displacement_um '])
    text = '\ufeff# from the oscilloscope\n\n' + rows(head=head, join=join)
    if join == ';':
        text = text.replace('.', ',')
    record = read_csv(write(tmp_path / 'a.csv', text))
    np.testing.assert_array_equal(record.voltage[:3], [0, 10, 20])
    np.testing.assert_allclose(record.displacement[:3], [0, 5e-7, 1e-6])


def test_rounded_stamps_of_a_real_instrument(tmp_path: Path) -> None:
    """Steps of 0.200010001 and 0.19998 ms are 5 kHz."""
    stamps = np.round(np.arange(1000) * 2e-4, 5) + 1e-8 * (np.arange(1000) % 2)
    lines = [f'{t:.9f},{k % 9},{k % 5}' for k, t in enumerate(stamps)]
    record = read_csv(write(tmp_path / 'a.csv', 'time_s,voltage_V,displacement_um\n' +
                            '\n'.join(lines)))  # fmt: skip
    assert record.dt == 2e-4


@pytest.mark.parametrize('unit', ['m', 'mm', 'um', 'nm'])
@pytest.mark.parametrize('drive', ['V', 'N'])
def test_written_and_read_back(tmp_path: Path, unit: str, drive: str) -> None:
    rng = np.random.default_rng(3)
    record = Record(
        'a', 1 / 3000, rng.standard_normal(500), 1e-5 * rng.standard_normal(500), start=2.0,
        reference=1e-5 * rng.standard_normal(500), info=RecordInfo(input_unit=drive),
    )  # fmt: skip
    write_csv(tmp_path / 'a.csv', record, unit=unit)
    found = read_csv(tmp_path / 'a.csv')
    tolerance = 0 if unit == 'm' else 1e-15
    np.testing.assert_array_equal(found.voltage, record.voltage)
    np.testing.assert_allclose(found.displacement, record.displacement, rtol=tolerance)
    assert found.reference is not None
    assert record.reference is not None
    np.testing.assert_allclose(found.reference, record.reference, rtol=tolerance)
    assert (found.dt, found.start, found.info) == (record.dt, 2.0, record.info)
    with pytest.raises(RecordError, match='exists already'):
        write_csv(tmp_path / 'a.csv', record)


@pytest.mark.parametrize(
    ('head', 'message'),
    [
        ('time_s,voltage_V,displacement', "rename 'displacement' to displacement_um"),
        ('t,u,y', "rename 't' to time_s"),
        ('time_s,voltage_V,position', "rename 'position' to displacement_um"),
        ('time_s,voltage,displacement_um', "rename 'voltage' to voltage_V"),
        ('time_s,voltage_V,displacement_inch', "rename 'displacement_inch'"),
        ('a,b,c', 'columns are named like time_s,voltage_V,displacement_um'),
        ('0.0,1.0,2.0', 'columns are named like'),
        ('time_s,voltage_V,displacement_um,displacement_m', 'stands twice'),
        ('time_s,voltage_V,force_N,displacement_um', 'both a voltage and a force'),
    ],
)
def test_other_spellings_get_help(tmp_path: Path, head: str, message: str) -> None:
    width = head.count(',') + 1
    body = '\n'.join(','.join(str(k * (c + 1)) for c in range(width)) for k in range(30))
    with pytest.raises(RecordError, match=message):
        read_csv(write(tmp_path / 'a.csv', f'{head}\n{body}\n'))


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('', 'the file is empty'),
        ('time_s,voltage_V,displacement_um\n', 'no samples'),
        ('time_s,voltage_V,displacement_um\n0,0,0\n', '1 sample, too few'),
        (rows().replace('\n0.005,', '\n0.005,nan'), '1 line cannot be read, line 7 has'),
        (rows().replace('0.005,', '0.005,oops'), "line 7 has 'oops50.0' in column voltage_V"),
        (rows() + '0.040,1', "line 42 has '' in column displacement_um"),
        ('\x00\x01\x02', 'is not a text file'),
    ],
)
def test_bad_files_are_refused_in_one_sentence(tmp_path: Path, text: Any, message: str) -> None:
    with pytest.raises(RecordError, match=message) as caught:
        read_csv(write(tmp_path / 'a.csv', text))
    assert str(tmp_path / 'a.csv') in str(caught.value)
    assert '\n' not in str(caught.value)


def test_missing_files_binary_files_and_unknown_kinds(tmp_path: Path) -> None:
    with pytest.raises(RecordError, match='does not exist'):
        load([tmp_path / 'none.csv'])
    (tmp_path / 'bin.csv').write_bytes(b'\xff\xfe\x00\x01')
    with pytest.raises(RecordError, match='is not a text file'):
        load([tmp_path / 'bin.csv'])
    (tmp_path / 'a.xls').write_bytes(b'PK')
    with pytest.raises(RecordError, match='not known'):
        load([tmp_path / 'a.xls'])
    with pytest.raises(RecordError, match='no data were given'):
        load([])


def test_lines_that_are_no_numbers_are_salvaged_and_counted(tmp_path: Path) -> None:
    lines = rows(100).split('\n')
    lines[51] = '0.05,oops,1'
    path = write(tmp_path / 'a.csv', '\n'.join(lines))
    found = survey([path], salvage=True)
    assert [len(record) for record in found.records] == [50, 49]
    assert any('1 line cannot be read' in str(damage) for damage in found.damage)


def test_notes_next_to_the_file_are_used(tmp_path: Path) -> None:
    path = write(tmp_path / 'a.csv', rows())
    notes = write(
        tmp_path / 'records.yaml',
        'a.csv: {record: sine 5 Hz, actuator: bimorph, frequency: 5, warm_up: 0.01}\n',
    )
    record = read_csv(path)
    assert record.name == 'sine 5 Hz'
    assert record.info == RecordInfo('bimorph', frequency=5.0, warm_up=0.01)
    notes.write_text('a.csv: {frequency: fast}\n')
    with pytest.raises(RecordError, match='wrong kind'):
        read_csv(path)
    notes.write_text('{')
    with pytest.raises(RecordError, match='correct or remove'):
        read_csv(path)


def test_a_large_file_is_read_to_the_same_bits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip('pyarrow')
    random = np.random.default_rng(3)
    record = Record('r', 1e-3, random.standard_normal(5000), 1e-4 * random.standard_normal(5000))
    write_csv(tmp_path / 'r.csv', record)
    by_lines = read_csv(tmp_path / 'r.csv')
    monkeypatch.setattr(text_tables, 'LARGE', 0)
    at_once = read_csv(tmp_path / 'r.csv')
    for name in ('voltage', 'displacement'):
        assert getattr(at_once, name).tobytes() == getattr(by_lines, name).tobytes()


@pytest.mark.parametrize(
    'line', ['0.0305,1.0', '0.0305,x,2.0', '0.0305,,2.0', '# a note', '', '0.0305, 1.0,2.0']
)
def test_special_cases_in_a_large_file_are_handled_as_in_a_small_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, line: str
) -> None:
    rows = [f'{k / 1000},{k % 7},{k % 11}' for k in range(60)]
    text = '\n'.join(['time_s,voltage_V,displacement_um', *rows[:31], line, *rows[31:]])
    (tmp_path / 'r.csv').write_text(text + '\n')

    def answer() -> Any:
        try:
            read = read_csv(tmp_path / 'r.csv')
        except RecordError as error:
            return str(error)
        return read.voltage.tobytes(), read.displacement.tobytes()

    small = answer()
    monkeypatch.setattr(text_tables, 'LARGE', 0)
    assert answer() == small


# --- files of other programs ---------------------------------------------------------------------

LABVIEW = (
    'LabVIEW Measurement\t\nWriter_Version\t2\nSeparator\tTab\nDate\t2026/01/01\n'
    '***End_of_Header***\t\n\t\nChannels\t2\t\nSamples\t40\t40\nX0\t0.0\t0.0\n'
    '***End_of_Header***\t\n'
)


def lines(separator: Any, comma: Any = '.', n: int = 40) -> str:
    found = [f'{k * 1e-3:.4f}{separator}{k % 7:.2f}{separator}{k % 5:.3f}\n' for k in range(n)]
    return ''.join(found).replace('.', comma)


FOREIGN = {
    'a.lvm': LABVIEW + 'X_Value\tVoltage (V)\tDisplacement (um)\tComment\n' + lines('\t'),
    'a.txt': LABVIEW + 'X_Value\tSpannung [V]\tWeg [µm]\n' + lines('\t', ','),
    'b.csv': 'Zeit [s];Spannung [V];Weg [µm]\n' + lines(';', ','),
    'c.csv': 'Time (s),CH1 (V),CH2 (um)\n' + lines(','),
    'e.dat': 'Time (s)   CH1 (V)   Laser (um)\n' + lines('   '),
    'f.csv': 't_sec,U/V,x [micron]\n' + lines(','),
    'g.csv': 'Zeit in Sekunden;Spannung in Volt;Auslenkung in Mikrometer\n' + lines(';', ','),
}
FOREIGN['d.csv'] = 'Time (S),Voltage (V),Monitor (V),Position/um\n' + ''.join(
    f'{k * 1e-3},{k % 7},9,{k % 5}\n' for k in range(40)
)


@pytest.mark.parametrize('name', FOREIGN)
@pytest.mark.parametrize('encoding', ['utf-8', 'cp1252', 'utf-16'])
def test_columns_with_quantity_and_unit_are_used_and_reported(
    tmp_path: Path, name: Any, encoding: str
) -> None:
    path = tmp_path / name
    path.write_text(FOREIGN[name], encoding)
    found = survey([path])
    (record,) = found.records
    assert (len(record), record.rate) == (40, 1000.0)
    np.testing.assert_array_equal(record.voltage, np.arange(40) % 7)
    np.testing.assert_array_equal(record.displacement, (np.arange(40) % 5) / 1e6)
    assert 'voltage from ' in str(found.guesses[-1])
    said = any('Windows-1252' in str(note) for note in found.notes)
    assert said == (encoding == 'cp1252' and 'µ' in FOREIGN[name])
    with pytest.warns(DataNote, match='reading time from column'):
        load([path])


def test_codes_of_a_sensor_are_no_wrong_unit(tmp_path: Path) -> None:
    """A reading of 65535 um, 13 times of 3000, was refused as a stroke of 66 mm."""
    rows = [f'{k * 1e-3:.3f},{k % 90},{k % 12 if k % 200 else 65535}' for k in range(2000)]
    (tmp_path / 'a.csv').write_text('time_s,voltage_V,displacement_um\n' + '\n'.join(rows))
    (found,) = survey([tmp_path / 'a.csv']).records
    assert np.median(found.displacement) < 1e-5
    rows = [f'{k * 1e-3:.3f},{k % 90},{k % 12 * 1e4}' for k in range(2000)]
    (tmp_path / 'b.csv').write_text('time_s,voltage_V,displacement_um\n' + '\n'.join(rows))
    with pytest.raises(RecordError, match='no piezo actuator'):
        survey([tmp_path / 'b.csv'])


@pytest.mark.parametrize(
    ('head', 'words'),
    [
        ('Time (s),CH1 (V),CH2 (V)', "voltage may be 'CH1 (V)' or 'CH2 (V)'"),
        (
            'Time (s),CH1 (V),Temperature (K)',
            'it has no column of displacement that is understood',
        ),
        ('Date,CH1,CH2', 'no column of time, voltage and displacement'),
    ],
)
def test_what_is_not_clear_is_not_guessed(tmp_path: Path, head: str, words: str) -> None:
    with pytest.raises(RecordError, match=re.escape(words)) as caught:
        load([write(tmp_path / 'a.csv', f'{head}\n{lines(",")}')])
    assert '--displacement COLUMN:UNIT' in str(caught.value)


@pytest.mark.parametrize(
    ('name', 'text', 'words'),
    [
        ('plain.txt', lines(' '), ()),
        ('tab.txt', lines('\t'), ()),
        ('lab.lvm', LABVIEW + 'X_Value\tUntitled\tUntitled 1\tComment\n' + lines('\t'), ()),
        ('scope.csv', 'Model,TDS\nPoints,40\n\nTIME,A,B\n' + lines(','), ('--header-row', '4')),
        ('skip.csv', 'Model,TDS\nPoints,40\n\nTIME,A,B\n' + lines(','), ('--skip-rows', '2')),
        ('bare.csv', 'Model,TDS\n' + lines(','), ('--skip-rows', '1')),
    ],
)
def test_columns_by_number_behind_any_head(
    tmp_path: Path,
    name: str,
    text: Any,
    words: tuple[Any, ...],
    capsys: pytest.CaptureFixture[str],
) -> None:
    path, bag = write(tmp_path / name, text), tmp_path / 'bag'
    columns = ['--time', '1', '--voltage', '2', '--displacement', '3:um']
    assert main(['import', str(path), *columns, *words, '--out', str(bag)]) == 0
    assert '1 record in' in capsys.readouterr().out
    (record,) = load([bag])
    np.testing.assert_array_equal(record.voltage, np.arange(40) % 7)


def test_a_number_is_no_topic_of_a_file_of_another_kind(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write(tmp_path / 'rec.foo', lines(' '))
    assert main(['import', str(path), '--voltage', '2', '--displacement', '3', '--out', 'x']) == 2
    assert 'data of this kind are not known' in capsys.readouterr().err
    path = write(tmp_path / 'a.csv', lines(','))
    words = ['--time', '1', '--voltage', '2', '--displacement', '3', '--out', 'x']
    assert main(['import', str(path), *words, '--header-row', '99']) == 2
    assert 'it has no line 99, but 40 lines' in capsys.readouterr().err


def test_a_chosen_column_keeps_the_unit_of_its_name(tmp_path: Path) -> None:
    path = write(tmp_path / 'a.csv', 'A (ms),B (mV),C (nm)\n' + lines(','))
    log = DamageLog()
    names = {'time': '1', 'voltage': '2', 'displacement': 'C (nm)'}
    (record,) = column_records(path, log, ReadOptions(names))
    assert (record.rate, np.ptp(record.voltage)) == (1e6, 6e-3)
    assert np.ptp(record.displacement) == pytest.approx(4e-9)
