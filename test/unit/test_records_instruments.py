"""Files of MDF, UFF 58 and Igor: read as written, or refused; never other numbers."""

from __future__ import annotations

import gc
import struct
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from piezo_hysteresis.errors import DataNote, PiezoError, RecordError
from piezo_hysteresis.records import Record, load

# asammdf closes what it could not open
pytestmark = pytest.mark.filterwarnings('ignore::pytest.PytestUnraisableExceptionWarning')

STEP = 1e-3
TIME = np.arange(300) * STEP
VOLTAGE = 40.0 + 40.0 * np.sin(2 * np.pi * 5.0 * TIME)
MOVED = 0.12 * VOLTAGE + 3.0 * np.cos(2 * np.pi * 5.0 * TIME)  # um
CHANNELS = (('Voltage', 'V', VOLTAGE), ('Displacement', 'um', MOVED))


def mdf(path: Path, time: Any = TIME + 5.0) -> Path:
    asammdf = pytest.importorskip('asammdf')

    def signal(name: str, unit: str, samples: Any, time: Any) -> Any:
        return asammdf.Signal(samples=samples, timestamps=time, name=name, unit=unit)

    with asammdf.MDF(version='4.10') as file:
        file.append([signal(name, unit, values, time) for name, unit, values in CHANNELS])
        file.append([signal('Temperature', 'K', TIME[::4], TIME[::4])])
        file.save(path, overwrite=True)
    return path


def uff(path: Path, **changed: Any) -> Path:
    pyuff = pytest.importorskip('pyuff')
    axes = ('abscissa', 'ordinate', 'orddenom', 'z_axis')
    fields = ('spec_data_type', 'len_unit_exp', 'force_unit_exp', 'temp_unit_exp')
    zeros = {f'{axis}_{each}': 0 for axis in axes for each in fields}
    for name, unit, values in CHANNELS:
        given = {'id1': name, 'ordinate_axis_units_lab': unit, 'data': values, **changed}
        one = pyuff.prepare_58(
            binary=0, func_type=given.pop('func_type', 1), rsp_node=1, rsp_dir=1, ref_node=1,
            ref_dir=1, x=TIME, abscissa_spacing=1, abscissa_inc=STEP, **zeros, **given,
        )  # fmt: skip
        pyuff.UFF(str(path)).write_sets(one, 'add')
    return path


def igor(path: Path, unit: str = 's', columns: int = 2) -> Path:
    """Write a wave of version 5 by its published layout."""
    pytest.importorskip('igor2')
    data = np.array([values for *_, values in CHANNELS[:columns]]).T
    names = [f'{name} ({unit})' for name, unit, _ in CHANNELS[:columns]]
    labels = b''.join(name.encode().ljust(32, b'\0') for name in ('', *names))
    shape = (data.shape[0], data.shape[1] if columns > 1 else 0, 0, 0)
    wave = struct.pack(
        '<3Ii2h6sh32siI4i', 0, 0, 0, data.size, 4, 0, b'', 1, b'run', 0, 0, *shape
    )  # fmt: skip
    wave += struct.pack('<8d4s4s', STEP, 1, 1, 1, 0, 0, 0, 0, b'', unit.encode())
    body = wave.ljust(320, b'\0') + data.tobytes('F')
    sizes = (len(body), *(0,) * 8, len(labels) if columns > 1 else 0, *(0,) * 5)
    head = struct.pack('<2h15i', 5, 0, *sizes)
    check = -sum(struct.unpack('<192h', head + body[:320])) & 0xFFFF
    labels = labels if columns > 1 else b''
    path.write_bytes(struct.pack('<hH15i', 5, check, *sizes) + body + labels)
    return path


WRITERS: dict[str, Callable[[Path], Path]] = {'mf4': mdf, 'uff': uff, 'ibw': igor}


def read(path: Path) -> Record:
    with pytest.warns(DataNote, match='read as'):
        (record,) = load(path)
    return record


@pytest.mark.parametrize('ending', WRITERS)
def test_units_and_times_are_those_of_the_file(tmp_path: Path, ending: str) -> None:
    record = read(WRITERS[ending](tmp_path / f'run.{ending}'))
    assert record.rate == pytest.approx(1.0 / STEP)
    np.testing.assert_allclose(record.voltage, VOLTAGE, rtol=1e-6)
    np.testing.assert_allclose(record.displacement, 1e-6 * MOVED, rtol=1e-6, atol=1e-12)


@pytest.mark.parametrize('ending', WRITERS)
@pytest.mark.parametrize('share', [0.02, 0.3, 0.6, 0.95])
def test_a_file_that_was_cut_off_gives_no_wrong_number(
    tmp_path: Path, ending: str, share: float
) -> None:
    path = WRITERS[ending](tmp_path / f'run.{ending}')
    raw = path.read_bytes()
    path.write_bytes(raw[: int(share * len(raw))])
    try:
        with warnings.catch_warnings():
            warnings.simplefilter('ignore')
            records = load(path)
    except PiezoError:
        return
    for record in records:  # what precedes the cut is as it was written
        count = len(record)
        np.testing.assert_allclose(record.voltage, VOLTAGE[:count], rtol=1e-6)
        np.testing.assert_allclose(record.displacement, 1e-6 * MOVED[:count], rtol=1e-6)


DAMAGES = st.tuples(
    st.sampled_from(['drop', 'double', 'blank']), st.floats(0, 1), st.integers(1, 600)
)


@pytest.mark.component
@pytest.mark.parametrize('ending', WRITERS)
@given(damage=DAMAGES)
@settings(
    max_examples=12, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_a_damaged_file_gives_no_other_number_without_a_word(
    tmp_path: Path, ending: str, damage: tuple[str, float, int]
) -> None:
    fuzzed(tmp_path, ending, damage)


@pytest.mark.slow
@pytest.mark.parametrize('ending', WRITERS)
@given(damage=DAMAGES)
@settings(
    max_examples=120, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
def test_many_damaged_files(tmp_path: Path, ending: str, damage: tuple[str, float, int]) -> None:
    fuzzed(tmp_path, ending, damage)


def fuzzed(tmp_path: Path, ending: str, damage: tuple[str, float, int]) -> None:
    """Drop or double bytes anywhere, or blank some of the first: refused, or the true samples."""
    kind, place, count = damage
    path = tmp_path / f'run.{ending}'
    path.unlink(missing_ok=True)
    raw = WRITERS[ending](path).read_bytes()
    first = int(place * (len(raw) if kind != 'blank' else 200))
    piece = raw[first : first + count]
    if kind == 'blank':
        piece = piece[: 1 + count // 20]
    middle = {'drop': b'', 'double': 2 * piece, 'blank': bytes(len(piece))}[kind]
    path.write_bytes(raw[:first] + middle + raw[first + len(piece) :])
    try:
        with warnings.catch_warnings():
            warnings.simplefilter('ignore')
            records = load(path)
    except PiezoError:
        return
    finally:
        gc.collect()  # here, and not while hypothesis parses a source
    for record in records:
        count = len(record)
        assert record.dt == pytest.approx(STEP, rel=1e-3)
        np.testing.assert_allclose(record.voltage, VOLTAGE[:count], rtol=1e-6)
        np.testing.assert_allclose(
            record.displacement, 1e-6 * MOVED[:count], rtol=1e-6, atol=1e-12
        )


def test_a_wave_whose_header_or_length_is_wrong_is_refused(tmp_path: Path) -> None:
    raw = igor(tmp_path / 'run.ibw').read_bytes()
    for changed, match in ((raw[:120] + b'\1' + raw[121:], 'checksum'), (raw + b'\0', 'longer')):
        (tmp_path / 'run.ibw').write_bytes(changed)
        with pytest.raises(RecordError, match=match):
            load(tmp_path / 'run.ibw')


@pytest.mark.parametrize('place', [5249, 11729])
@pytest.mark.parametrize('there', [b'', b'12'])
def test_a_universal_file_with_lines_of_other_widths_is_refused(
    tmp_path: Path, there: bytes, place: int
) -> None:
    raw = uff(tmp_path / 'run.uff').read_bytes()
    (tmp_path / 'run.uff').write_bytes(raw[:place] + there + raw[place + 1 :])
    with pytest.raises(RecordError, match='of another width'):
        load(tmp_path / 'run.uff')


def test_channels_whose_times_stand_still_are_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordError, match='do not advance'):
        load(mdf(tmp_path / 'run.mf4', 0.0 * TIME))


def test_a_wave_that_is_scaled_in_metres_has_no_time(tmp_path: Path) -> None:
    with pytest.raises(RecordError, match='--interval'):
        load(igor(tmp_path / 'run.ibw', unit='m'))


def test_a_wave_of_one_dimension_is_no_record(tmp_path: Path) -> None:
    with pytest.raises(RecordError, match='columns of one wave'):
        load(igor(tmp_path / 'run.ibw', columns=1))


def test_a_universal_file_of_spectra_is_no_record(tmp_path: Path) -> None:
    with pytest.raises(RecordError, match='no time responses'):
        load(uff(tmp_path / 'run.uff', func_type=4))


def test_a_missing_library_is_named_with_its_extra(tmp_path: Path, monkeypatch: Any) -> None:
    path = tmp_path / 'run.uff'
    path.write_text('    -1\n')
    monkeypatch.setitem(sys.modules, 'pyuff', None)
    with pytest.raises(RecordError, match=r'needs pyuff; pip install .*\[instruments\]'):
        load(path)
