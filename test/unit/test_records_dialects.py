"""Every kind of text file that instruments write gives its numbers, or a sentence."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records import Record
from piezo_hysteresis.records.columns import ReadOptions
from piezo_hysteresis.records.damage import DamageLog
from piezo_hysteresis.records.load import column_records

N = 60
DT = 2e-3
T = DT * np.arange(N)
U = np.round(40 + 30 * np.sin(2 * np.pi * 9 * T), 3)
Y = np.round(7 + 4.5 * np.sin(2 * np.pi * 9 * T - 0.2), 4)  # um


def body(join: str = ',', *, time: bool = True, mark: str = '.', lead: str = '') -> str:
    rows = []
    for t, u, y in zip(T, U, Y, strict=True):
        cells = ([f'{t:.4f}'] if time else []) + [f'{u:.3f}', f'{y:.4f}']
        rows.append(lead + join.join(cell.replace('.', mark) for cell in cells))
    return '\n'.join(rows) + '\n'


_LVM = (
    'LabVIEW Measurement\t\nSeparator\tTab\nDecimal_Separator\t.\nX_Columns\t{}\n'
    '***End_of_Header***\t\n'
)
_SEGMENT = (
    '\t\nChannels\t2\nSamples\t60\t60\nY_Unit_Label\tVolts\tMicrons\nX0\t0\t0\nDelta_X\t0.002\t0.002\n'
    '***End_of_Header***\t\t\nX_Value\tVoltage\tPosition\tComment\n'
)

# fmt: off
FILES: dict[str, tuple[str, dict[str, str]]] = {
    'pi.dat': (
        '# REM x\n# VERSION = 1\n# TYPE = 1\n# SEPARATOR = 9\n# DIM = 2\n# SAMPLE_TIME = 0.002\n'
        '# NDATA = 60\n# NAME0 = Output Voltage of Chan1\n# NAME1 = Current Position of Axis1\n'
        '# END_HEADER\n' + body('\t', time=False),
        {},
    ),
    'one.lvm': (_LVM.format('One') + _SEGMENT + body('\t'), {}),
    'no.lvm': (_LVM.format('No') + _SEGMENT + body('\t', time=False, lead='\t'), {}),
    'rigol.csv': (
        'X,CH1,CH2,Start,Increment\nSequence,Volt,Volt,0.0,2.0e-03\n'
        + ''.join(f'{k},{u},{y},,\n' for k, (u, y) in enumerate(zip(U, Y, strict=True))),
        {'voltage': 'CH1 (Volt)', 'displacement': '3:um'},
    ),
    'rigol_tinc.csv': (
        'CH1V,CH2V,t0 =-1.0e-03, tInc = 2.0e-03,\n' + body(time=False),
        {'voltage': '1', 'displacement': '2:um'},
    ),
    'siglent.csv': (
        'Record Length,Analog:60,\nSample Interval,Analog:2.00000E-03\nVertical Units,CH1:V,CH2:V\n'  # noqa: E501
        'Model Number,SDS1104X-E\nSource,CH1,CH2\nSecond,Value,Value\n' + body(),
        {'voltage': '2', 'displacement': '3:um'},
    ),
    'keysight.csv': (
        'x-axis,1,2\nsecond,Volt,Volt\n' + body(),
        {'voltage': '2', 'displacement': '3:um'},
    ),
    'tek.csv': (
        'Model,MDO3024\nFirmware Version,1.26\n,\nHorizontal Units,s,\nSample Interval,2e-03\n'
        'Record Length,60\nVertical Units,V,V\n,\nLabel,,\nTIME,CH1,CH2\n' + body(),
        {'voltage': 'CH1:V', 'displacement': 'CH2:um'},
    ),
    'pico.csv': (
        'Zeit;Kanal A;Kanal B\n(s);(V);(V)\n\n' + body(';', mark=','),
        {'voltage': '2', 'displacement': '3:um'},
    ),
    'lecroy.csv': (
        'LECROYHDO4034,1,Waveform\nSegments,1,SegmentSize,60\nSegment,TrigTime,TimeSinceSegment1\n'
        '#1,01-Jan-2026 00:00:00,0\nTime,Ampl,Ampl\n' + body(),
        {'voltage': '2', 'displacement': '3:um'},
    ),
    'graphtec.csv': (
        'Vendor,GRAPHTEC Corporation\nModel,GL240\nSampling interval,2ms\nTotal data points,60\n'
        'AMP settings\nCH,Signal name,Input,Range,Filter,Span\nCH1,a,DC,20V,Off,20,0,V\nData\n'
        'Number,Date&Time,ms,Voltage,Position,Alarm1-10\nNO.,Time,ms,V,um,A1234567890\n'
        + ''.join(
            f'{k + 1},2026/11/27 10:00:00,{2 * k},{"+" if u >= 0 else "-"} {abs(u)},+ {y},LLLL\n'
            for k, (u, y) in enumerate(zip(U, Y, strict=True))
        ),
        {},
    ),
    'nanonis.dat': (
        'Experiment\tHistory\t\nDate\t27.11.2026\t\n\n[DATA]\nTime (s)\tBias (V)\tZ (um)\n' + body('\t'),  # noqa: E501
        {'voltage': 'Bias (V)', 'displacement': 'Z (um)'},
    ),
    'aixacct.dat': (
        'DynamicHysteresis\nSampleName: x\nTable 1\nTime [s]\tV+ [V]\tD1 [um]\n' + body('\t'),
        {},
    ),
    'plotjuggler.csv': (
        '__time,/cmd/data,/laser/point/x\n'
        + ''.join(f'{t + 1.7e9:.6f},{u},\n{t + 1.7e9 + 2e-4:.6f},,{y}\n'
                  for t, u, y in zip(T, U, Y, strict=True)),
        {'voltage': '/cmd/data:V', 'displacement': '/laser/point/x:um'},
    ),
    'echo.csv': (
        ''.join(f'1714990272,{round(t * 1e9)},,{u},{y}\n' for t, u, y in zip(T, U, Y, strict=True)),  # noqa: E501
        {'voltage': '4', 'displacement': '5:um'},
    ),
    'mcap.csv': (
        'log_time,voltage_V,displacement_um\n'
        + ''.join(f'2026-11-27T10:00:00.{round(t * 1e9):09d}Z,{u},{y}\n'
                  for t, u, y in zip(T, U, Y, strict=True)),
        {},
    ),
    'iso.csv': (
        'Datum;Spannung [V];Weg [µm]\n'
        + ''.join(f'27.11.2026 10:00:00,{round(t * 1e3):03d};{u};{y}\n'.replace('.', ',').replace('27,11,', '27.11.')  # noqa: E501
                  for t, u, y in zip(T, U, Y, strict=True)),
        {'time': 'Datum'},
    ),
    'savetxt.txt': ('# time_s voltage_V displacement_um\n' + body(' '), {}),
    'thousands.csv': (
        'time_s,voltage_V,displacement_nm\n'
        + ''.join(f'{t:.4f},{u:.3f},"{1e3 * y:,.1f}"\n' for t, u, y in zip(T, U, Y, strict=True)),
        {},
    ),
    'words.csv': ('Time (in s),Voltage in V,Laser / um\n' + body(), {}),
    'units_below.csv': ('time;voltage;displacement\ns;V;um\n' + body(';', mark=','), {}),
}
# fmt: on


def read(path: Path, columns: dict[str, str], **options: Any) -> tuple[list[Record], DamageLog]:
    log = DamageLog()
    return column_records(path, log, ReadOptions(columns, **options)), log


def holds(record: Record) -> None:
    assert record.dt == pytest.approx(DT)
    moved, drive = record.displacement - record.displacement[0], record.voltage
    np.testing.assert_allclose(drive, U, atol=1e-9)
    np.testing.assert_allclose(moved, 1e-6 * (Y - Y[0]), atol=1e-10)


@pytest.mark.parametrize('name', FILES)
def test_a_dialect_is_read_without_more_options(tmp_path: Path, name: str) -> None:
    text, columns = FILES[name]
    path = tmp_path / name
    path.write_text(text, 'utf-8')
    (record,), log = read(path, columns)
    holds(record)
    if name.partition('.')[0] not in ('iso', 'savetxt', 'thousands', 'words', 'units_below'):
        assert any('read as' in str(note) for note in log.notes)


def test_a_key_of_a_header_among_samples_without_times_is_refused(tmp_path: Path) -> None:
    lines = FILES['no.lvm'][0].split('\n')[:-1]
    key = lines.index('X0\t0\t0')
    path = tmp_path / 'moved.lvm'
    for place in (-1, -20):  # its numbers would be a sample of 0 V and 0 um
        moved = [*lines]
        moved[key], moved[place] = moved[place], moved[key]
        path.write_text('\n'.join(moved) + '\n', 'utf-8')
        with pytest.raises(RecordError, match=f"line {len(lines) + place + 1} begins with 'X0'"):
            read(path, {})


@pytest.mark.parametrize('row', [-2, -20])
def test_a_voltage_that_is_missing_in_its_own_rows_is_said(tmp_path: Path, row: int) -> None:
    lines = FILES['plotjuggler.csv'][0].split('\n')[:-1]
    del lines[row]  # of the last voltage, or one before
    path = tmp_path / 'lost.csv'
    path.write_text('\n'.join(lines) + '\n', 'utf-8')
    _, log = read(path, dict(FILES['plotjuggler.csv'][1]))
    assert any('voltage pauses 1 time and is held' in str(note) for note in log.notes)


def test_rows_of_one_signal_behind_later_ones_are_joined_by_time(tmp_path: Path) -> None:
    lines = FILES['plotjuggler.csv'][0].split('\n')[:-1]
    lines[-8], lines[-7] = lines[-7], lines[-8]
    path = tmp_path / 'swapped.csv'
    path.write_text('\n'.join(lines) + '\n', 'utf-8')
    (record,), log = read(path, dict(FILES['plotjuggler.csv'][1]))
    holds(record)
    assert any('sorted by time' in str(note) for note in log.notes)


DAMAGES = ('drop', 'double', 'swap', 'cell', 'mark', 'head', 'blank')


@pytest.mark.parametrize('name', FILES)
@given(kind=st.sampled_from(DAMAGES), place=st.floats(0, 1), other=st.floats(0, 1))
@settings(
    max_examples=12, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_a_changed_file_gives_no_other_number_without_a_word(
    tmp_path: Path, name: str, kind: str, place: float, other: float
) -> None:
    fuzzed(tmp_path, name, kind, place, other)


@pytest.mark.slow
@pytest.mark.parametrize('name', FILES)
@given(kind=st.sampled_from(DAMAGES), place=st.floats(0, 1), other=st.floats(0, 1))
@settings(
    max_examples=400, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_many_changed_files(
    tmp_path: Path, name: str, kind: str, place: float, other: float
) -> None:
    fuzzed(tmp_path, name, kind, place, other)


def fuzzed(tmp_path: Path, name: str, kind: str, place: float, other: float) -> None:
    """Refuse the file, or give samples of the true file at their times."""
    text, columns = FILES[name]
    lines = text.split('\n')[:-1]
    k, m = (min(int(p * len(lines)), len(lines) - 1) for p in (place, other))
    if kind == 'drop':
        del lines[k]
    elif kind == 'double':
        lines.insert(k, lines[k])
    elif kind == 'swap':
        lines[k], lines[m] = lines[m], lines[k]
    elif kind == 'cell':
        lines[k] = lines[k][: len(lines[k]) // 2]
    elif kind == 'mark':
        lines[k] = lines[k].replace(',', ';') if ',' in lines[k] else lines[k].replace('.', ',')
    elif kind == 'head':
        lines.insert(k, lines[0])
    else:
        lines.insert(k, '')
    path = tmp_path / f'fuzzed_{name}'
    path.write_text('\n'.join(lines) + '\n', 'utf-8')
    plain = dict(columns)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter('ignore')
            records, log = read(path, plain)
    except RecordError as error:
        records, log, sentence = [], DamageLog(), str(error)
    else:
        sentence = ''
    assert '\n' not in sentence
    said = ' '.join(str(note) for note in log.notes)
    for record in records:
        matches(record, said, name)


def matches(record: Record, said: str, name: str) -> None:
    """Voltage and displacement belong together and lie in the order of the true file."""
    places = [int(np.argmin(np.abs(U - v) + np.abs(1e6 * record.displacement[i] - Y) * 1e3))
              for i, v in enumerate(record.voltage)]  # fmt: skip
    if 'pauses' not in said:
        np.testing.assert_allclose(record.voltage, U[places], atol=1e-9, err_msg=said)
    np.testing.assert_allclose(record.displacement, 1e-6 * Y[places], atol=1e-10, err_msg=said)
    untimed = name in ('pi.dat', 'no.lvm', 'rigol_tinc.csv', 'graphtec.csv')
    if not untimed:
        assert record.dt == pytest.approx(DT, rel=1e-3), said
