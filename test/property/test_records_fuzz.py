"""Whatever bytes a file holds, reading gives the truth, a RecordError, or a finding; no traceback.

Never silence: where values differ from what was written, something must have been said.
"""

import contextlib
import shutil
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records import Record, RecordInfo, survey, write_bag
from piezo_hysteresis.records.player import Player
from piezo_hysteresis.records.recorder import Recorder

N = 400
RNG = np.random.default_rng(5)
VOLTAGE = 50 * RNG.standard_normal(N)
DISPLACEMENT = 1e-5 * RNG.standard_normal(N)
INFO = RecordInfo('bimorph', 'sine', 23.0, 50.0, 0.1)


@pytest.fixture(scope='module')
def originals():
    with tempfile.TemporaryDirectory() as folder:
        record = Record('a', 1e-3, VOLTAGE, DISPLACEMENT, reference=DISPLACEMENT, info=INFO)
        paths = {}
        for storage in ('mcap', 'sqlite3'):
            paths[storage] = Path(folder) / storage
            write_bag(paths[storage], [record], storage=storage)
        yield paths


def same(record):
    return (
        np.array_equal(record.voltage, VOLTAGE)
        and np.array_equal(record.displacement, DISPLACEMENT)
        and record.reference is not None
        and np.array_equal(record.reference, DISPLACEMENT)
        and record.dt == 1e-3
        and record.start == 0.0
        and record.info == INFO
        and record.name == 'a'
    )


def one_line(error):
    assert '\n' not in str(error)


def truth(record):
    """Tell whether a record of an unfinished recording is a stretch of what was written."""
    first = round(record.start * 1000)
    part = slice(first, first + len(record))
    return np.array_equal(record.voltage, VOLTAGE[part]) and np.array_equal(
        record.displacement, DISPLACEMENT[part]
    )


def check(path, *, closed):
    """Read strictly and salvaging; a closed bag that is not refused must be the whole truth."""
    try:
        found = survey([path])
    except RecordError as error:
        one_line(error)
    else:
        if closed:
            assert [same(record) for record in found.records] == [True]
        else:
            assert [truth(record) for record in found.records] == [True]
    try:
        found = survey([path], salvage=True)
    except RecordError as error:
        one_line(error)
    else:
        if closed and [same(record) for record in found.records] != [True]:
            assert found.damage
        assert closed or all(map(truth, found.records))
    with contextlib.suppress(RecordError):
        list(Player(path, rate=float('inf'), salvage=True))


def damaged(original, change, *, closed=True):
    """Read a copy of a bag whose files went through `change`."""
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / original.name
        shutil.copytree(original, copy)
        change(copy)
        check(copy, closed=closed)


FLIPS = st.lists(st.tuples(st.floats(0, 1, exclude_max=True), st.integers(1, 255)), min_size=1,
                 max_size=4)  # fmt: skip


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
@given(flips=FLIPS)
@settings(max_examples=120, deadline=None)
def test_flipped_bytes(originals, storage, flips):
    def change(copy):
        (file,) = (path for path in copy.iterdir() if path.suffix != '.yaml')
        data = bytearray(file.read_bytes())
        for place, mask in flips:
            data[int(place * len(data))] ^= mask
        file.write_bytes(data)

    damaged(originals[storage], change)


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
@given(flips=FLIPS, edge=st.sampled_from(['front', 'back']))
@settings(max_examples=60, deadline=None)
def test_flipped_bytes_where_the_structure_is(originals, storage, flips, edge):
    def change(copy):
        (file,) = (path for path in copy.iterdir() if path.suffix != '.yaml')
        data = bytearray(file.read_bytes())
        for place, mask in flips:
            at = int(place * 600)
            data[at if edge == 'front' else -1 - at] ^= mask
        file.write_bytes(data)

    damaged(originals[storage], change)


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
@given(part=st.floats(0, 1, exclude_max=True), tail=st.binary(max_size=64))
@settings(max_examples=60, deadline=None)
def test_truncated_files(originals, storage, part, tail):
    def change(copy):
        (file,) = (path for path in copy.iterdir() if path.suffix != '.yaml')
        data = file.read_bytes()
        file.write_bytes(data[: int(part * len(data))] + tail)

    damaged(originals[storage], change)


@given(flips=FLIPS, part=st.floats(0, 1))
@settings(max_examples=80, deadline=None)
def test_damaged_metadata(originals, flips, part):
    def change(copy):
        path = copy / 'metadata.yaml'
        data = bytearray(path.read_bytes())
        for place, mask in flips:
            data[int(place * len(data))] ^= mask
        path.write_bytes(data[: int((0.2 + part) * len(data))])

    damaged(originals['mcap'], change)


@given(data=st.binary(max_size=400), suffix=st.sampled_from(['.mcap', '.db3', '.csv']),
       magic=st.booleans())  # fmt: skip
@settings(max_examples=100, deadline=None)
def test_any_bytes(data, suffix, magic):
    heads = {'.mcap': b'\x89MCAP0\r\n', '.db3': b'SQLite format 3\0', '.csv': b'time_s,'}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f'file{suffix}'
        path.write_bytes((heads[suffix] if magic else b'') + data)
        for salvage in (False, True):
            try:
                found = survey([path], salvage=salvage)
            except RecordError as error:
                one_line(error)
            else:
                assert suffix == '.csv'
                assert len(found.records) == 1


CELLS = st.one_of(
    st.floats(), st.sampled_from(['', ' ', 'nan', 'inf', '1e999', '0x1', '1,2', '"', '-', '#'])
)


@given(rows=st.lists(st.tuples(CELLS, CELLS, CELLS), max_size=60), salvage=st.booleans())
@settings(max_examples=150, deadline=None)
def test_any_numbers_in_a_csv_file(rows, salvage):
    lines = [','.join(map(str, row)) for row in rows]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / 'a.csv'
        path.write_text('\n'.join(['time_s,voltage_V,displacement_um', *lines]))
        try:
            found = survey([path], salvage=salvage)
        except RecordError as error:
            one_line(error)
        else:
            total = sum(len(record) for record in found.records)
            written = sum(bool(line.strip()) for line in lines)
            assert total == written or found.damage


STEPS = st.lists(st.floats(-2e-3, 5e-3), min_size=1, max_size=80)


@given(steps=STEPS)
@settings(max_examples=100, deadline=None)
def test_any_stamps_give_a_constant_rate_or_a_finding(steps):
    """A record returned without a finding lies on its grid to half a step."""
    time = np.round(np.concatenate([[0.0], np.cumsum(steps)]), 9)
    lines = [f'{t!r},{k % 3},{k % 5}' for k, t in enumerate(time.tolist())]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / 'a.csv'
        path.write_text('\n'.join(['time_s,voltage_V,displacement_um', *lines]))
        try:
            found = survey([path], salvage=True)
        except RecordError:
            return
    if not found.damage:
        (record,) = found.records
        assert np.abs(record.time - time).max() <= 0.5 * record.dt
    for record in found.records:
        assert np.isfinite(record.voltage).all()


@given(flips=FLIPS)
@settings(max_examples=60, deadline=None)
def test_a_recording_that_was_cut_off_and_then_damaged(tmp_path_factory, flips):
    from piezo_hysteresis.records import bag_writer, cdr
    from piezo_hysteresis.records.definitions import STATE, definition_of

    path = tmp_path_factory.getbasetemp() / 'cut_off'
    if not path.exists():
        ticks = np.arange(N)
        columns = {'sample': ticks, 'voltage': VOLTAGE, 'displacement': DISPLACEMENT}
        rows = cdr.encode(bag_writer.fixed_fields(STATE), ticks * 1_000_000, columns)
        recorder = Recorder(path.with_name('growing'), flush_interval=30, split=1 << 16)
        topic = recorder.add_topic('/actuator/state', STATE, definition=definition_of(STATE)[0])
        for k, row in enumerate(rows):
            recorder.write(topic, row.tobytes(), k * 1_000_000)
        recorder.flush()
        while recorder.status.written < N:
            pass
        shutil.copytree(path.with_name('growing'), path)
        recorder.close()
        assert survey([path]).notes

    def change(copy):
        file = copy / 'growing_0.mcap'
        data = bytearray(file.read_bytes())
        for place, mask in flips:
            data[int(place * 40_000)] ^= mask
        file.write_bytes(data)

    damaged(path, change, closed=False)
