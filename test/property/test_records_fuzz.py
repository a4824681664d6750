"""Whatever bytes a file holds, reading gives the truth, a RecordError, or a finding; no traceback.

Never silence: where values differ from what was written, something must have been said.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import struct
import tempfile
import tracemalloc
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.convert.converter import convert

from piezo_hysteresis.cli.main import main
from piezo_hysteresis.errors import ModelError, RecordError
from piezo_hysteresis.models import ModelFile
from piezo_hysteresis.records import Record, RecordInfo, mcap_format, storage, survey, write_bag
from piezo_hysteresis.records.player import Player
from piezo_hysteresis.records.recorder import Recorder

N = 400
RNG = np.random.default_rng(5)
VOLTAGE = 50 * RNG.standard_normal(N)
DISPLACEMENT = 1e-5 * RNG.standard_normal(N)
INFO = RecordInfo('bimorph', 'sine', 23.0, 50.0, 0.1)


@pytest.fixture(scope='module')
def originals() -> Iterator[dict[str, Path]]:
    with tempfile.TemporaryDirectory() as folder:
        record = Record('a', 1e-3, VOLTAGE, DISPLACEMENT, reference=DISPLACEMENT, info=INFO)
        paths = {storage: Path(folder) / storage for storage in ('mcap', 'sqlite3')}
        write_bag(paths['mcap'], [record])
        nothing: tuple[str, ...] = ()
        convert([paths['mcap']], paths['sqlite3'], 'sqlite3', 9, None, 'none', None, None,
                nothing, nothing, nothing, nothing)  # fmt: skip
        yield paths


def same(record: Record) -> bool:
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


def one_line(error: ModelError | RecordError) -> None:
    assert '\n' not in str(error)


def truth(record: Record) -> bool:
    """Tell whether a record of an unfinished recording is a stretch of what was written."""
    first = round(record.start * 1000)
    part = slice(first, first + len(record))
    return np.array_equal(record.voltage, VOLTAGE[part]) and np.array_equal(
        record.displacement, DISPLACEMENT[part]
    )


def check(path: Any, *, closed: bool) -> None:
    """Read strictly and salvaging; a closed bag that is not refused must be the whole truth.

    A sqlite3 file has no checksums: of it, only that nothing else than a refusal is raised.
    """
    if path.name == 'sqlite3':
        for salvage in (False, True):
            try:
                survey([path], salvage=salvage)
            except RecordError as error:
                one_line(error)
        return
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


def damaged(original: Path, change: Callable[..., Any], *, closed: bool = True) -> None:
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
def test_flipped_bytes(originals: dict[str, Path], storage: str, flips: Any) -> None:
    def change(copy: Any) -> None:
        (file,) = (path for path in copy.iterdir() if path.suffix != '.yaml')
        data = bytearray(file.read_bytes())
        for place, mask in flips:
            data[int(place * len(data))] ^= mask
        file.write_bytes(data)

    damaged(originals[storage], change)


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
@given(flips=FLIPS, edge=st.sampled_from(['front', 'back']))
@settings(max_examples=60, deadline=None)
def test_flipped_bytes_where_the_structure_is(
    originals: dict[str, Path], storage: str, flips: Any, edge: Any
) -> None:
    def change(copy: Any) -> None:
        (file,) = (path for path in copy.iterdir() if path.suffix != '.yaml')
        data = bytearray(file.read_bytes())
        for place, mask in flips:
            at = int(place * 600)
            data[at if edge == 'front' else -1 - at] ^= mask
        file.write_bytes(data)

    damaged(originals[storage], change)


@pytest.mark.slow
@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
@given(part=st.floats(0, 1, exclude_max=True), tail=st.binary(max_size=64))
@settings(max_examples=60, deadline=None)
def test_truncated_files(originals: dict[str, Path], storage: str, part: Any, tail: Any) -> None:
    def change(copy: Any) -> None:
        (file,) = (path for path in copy.iterdir() if path.suffix != '.yaml')
        data = file.read_bytes()
        file.write_bytes(data[: int(part * len(data))] + tail)

    damaged(originals[storage], change)


@given(flips=FLIPS, part=st.floats(0, 1))
@settings(max_examples=80, deadline=None)
def test_damaged_metadata(originals: dict[str, Path], flips: Any, part: Any) -> None:
    def change(copy: Any) -> None:
        path = copy / 'metadata.yaml'
        data = bytearray(path.read_bytes())
        for place, mask in flips:
            data[int(place * len(data))] ^= mask
        path.write_bytes(data[: int((0.2 + part) * len(data))])

    damaged(originals['mcap'], change)


@given(data=st.binary(max_size=400), suffix=st.sampled_from(['.mcap', '.db3', '.csv']),
       magic=st.booleans())  # fmt: skip
@settings(max_examples=100, deadline=None)
def test_any_bytes(data: Any, suffix: Any, magic: Any) -> None:
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
def test_any_numbers_in_a_csv_file(rows: Any, salvage: Any) -> None:
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
def test_any_stamps_give_a_constant_rate_or_a_finding(steps: Any) -> None:
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
def test_a_recording_that_was_cut_off_and_then_damaged(
    tmp_path_factory: pytest.TempPathFactory, flips: Any
) -> None:
    from piezo_hysteresis.records import bag_writer, cdr
    from piezo_hysteresis.records.definitions import STATE, definition_of

    path = tmp_path_factory.getbasetemp() / 'cut_off'
    if not path.exists():
        ticks = np.arange(N)
        columns = {'sample': ticks, 'voltage': VOLTAGE, 'displacement': DISPLACEMENT}
        rows = cdr.encode(bag_writer.fixed_fields(STATE), ticks * 1_000_000, columns)
        recorder = Recorder(path.with_name('growing'), flush_interval=1e-3, split=1 << 16)
        topic = recorder.add_topic('/actuator/state', STATE, definition=definition_of(STATE)[0])
        for k, row in enumerate(rows):
            recorder.write(topic, row.tobytes(), k * 1_000_000)
        while recorder.status.written < N:
            pass
        shutil.copytree(path.with_name('growing'), path)
        recorder.close()
        assert survey([path]).notes

    def change(copy: Any) -> None:
        file = copy / 'growing_0.mcap'
        data = bytearray(file.read_bytes())
        for place, mask in flips:
            data[int(place * 40_000)] ^= mask
        file.write_bytes(data)

    damaged(path, change, closed=False)


# --- data made to do harm -----------------------------------------------------------------------


def mcap_of(folder: Path, *chunks: tuple[Any, Any]) -> Path:
    """Write chunks of (stated size, packed bytes) as a file that claims to be in order."""
    parts = [mcap_format.MAGIC, mcap_format.record(mcap_format.HEADER, bytes(8))]
    for size, packed in chunks:
        head = struct.pack('<QQQI', 0, 0, size, 0)
        stored = struct.pack('<Q', len(packed))
        parts.append(
            mcap_format.record(mcap_format.CHUNK, head, mcap_format.text('zstd'), stored, packed)
        )
    path = folder / 'bomb.mcap'
    path.write_bytes(b''.join([*parts, mcap_format.tail()]))
    return path


def zeros(size: int) -> bytes:
    from backports import zstd

    return zstd.compress(bytes(size))


@pytest.mark.parametrize('size', [(1 << 64) - 1, 1 << 40, 1 << 29, 10, 3 << 20])
def test_a_chunk_that_grows_costs_no_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, size: int
) -> None:
    """3 MB of zeros in 100 bytes, where at most 1 MB is read at once."""
    for module in (storage, mcap_format):
        for name, most in (('LARGEST', 1 << 20), ('MOST_OTHERS', 1000)):
            monkeypatch.setattr(module, name, most, raising=False)
    path = mcap_of(tmp_path, (size, zeros(3 << 20)))
    with pytest.raises(RecordError):
        survey([path])  # what it needs is loaded now
    tracemalloc.start()
    for salvage in (False, True):
        with pytest.raises(RecordError) as caught:
            survey([path], salvage=salvage)
        one_line(caught.value)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 8 << 20
    assert 'chunk at byte' in str(caught.value)


@pytest.mark.slow
def test_many_chunks_that_grow_are_not_all_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('piezo_hysteresis.records.mcap_reader.SMALL', 1 << 20)
    read = []
    inflated = storage.inflated

    def counted(*given: Any) -> bytes:
        read.append(given)
        return inflated(*given)

    monkeypatch.setattr('piezo_hysteresis.records.mcap_reader.inflated', counted)
    path = mcap_of(tmp_path, *[(1 << 18, zeros(1 << 18))] * 40)
    with pytest.raises(RecordError, match='chunk at byte'):
        survey([path], salvage=True)
    assert 0 < len(read) < 40


BOMBS = {
    'deep': '[' * 20_000,
    'digits': f'schema: {"9" * 200_000}',
    'sexagesimal': f'schema: 1{":59" * 100_000}',
    'long': f'chain: [{"1.5," * 300_000}]',
    'laughs': 'a0: &a0 [x]\n' + ''.join(
        f'a{k}: &a{k} [{f"*a{k - 1}," * 10}]\n' for k in range(1, 12)
    ),
    'merges': 'a0: &a0 {x: 1}\n' + ''.join(
        f'a{k}: &a{k} {{<<: [*a{k - 1}, *a{k - 1}]}}\n' for k in range(1, 30)
    ),
    'itself': '&a [*a]',
    'date': 'date: 2026-99-99',
    'key': '? [1]\n: 2',
    'no text': '\udcff',
}  # fmt: skip


@pytest.mark.parametrize('bomb', BOMBS)
def test_yaml_made_to_do_harm(tmp_path: Path, bomb: Any) -> None:
    path = tmp_path / 'model.yaml'
    path.write_text(BOMBS[bomb], 'utf-8', 'surrogateescape')
    with pytest.raises(ModelError) as caught:
        ModelFile.load(path)
    one_line(caught.value)
    assert len(str(caught.value)) < 600
    path.rename(tmp_path / 'metadata.yaml')
    with pytest.raises(RecordError) as refused:
        survey([tmp_path])
    one_line(refused.value)


SCALARS = st.one_of(
    st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=8), st.dates()
)
MODEL = {
    'schema': 'piezo_hysteresis/model/1', 'name': 'x', 'chain': ['bouc_wen'],
    'parameters': {'A1': {'value': 1.0, 'std': 0.1, 'unit': 'm/V', 'held': False}},
    'correlation': {'names': ['A1'], 'matrix': [[1.0]]},
    'provenance': {'data': ['a'], 'rate': 1.0},
}  # fmt: skip
PLACES = [(), ('schema',), ('name',), ('chain',), ('parameters',), ('parameters', 'A1'),
          ('parameters', 'A1', 'value'), ('parameters', 'A1', 'std'), ('correlation',),
          ('correlation', 'matrix'), ('provenance',), ('provenance', 'data'),
          ('provenance', 'rate')]  # fmt: skip
TREES = st.recursive(
    SCALARS,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(SCALARS, inner, max_size=3),
)


def replaced(content: Any, place: Any, value: Any) -> Any:
    """Return a tree with something else at a place."""
    if not place:
        return value
    return {**content, place[0]: replaced(content[place[0]], place[1:], value)}


@given(place=st.sampled_from(PLACES), value=TREES)
@settings(max_examples=80, deadline=None)
def test_any_value_anywhere_in_a_model_file(place: Any, value: Any) -> None:
    import yaml

    text = yaml.safe_dump(replaced(MODEL, place, value))
    with contextlib.suppress(ModelError):
        ModelFile.parse(text)


@pytest.mark.parametrize('name', ['a.csv', 'a.mcap', 'a.db3', 'a.txt'])
@pytest.mark.parametrize('kind', ['pipe', 'device', 'folder'])
def test_what_is_no_file_is_not_waited_for(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, kind: str
) -> None:
    path = tmp_path / name
    if kind == 'pipe':
        os.mkfifo(path)
    elif kind == 'device':
        path.symlink_to('/dev/zero')
    else:
        path.mkdir()
    columns = ['--time', '1', '--voltage', '2', '--displacement', '3']
    for words in (['info'], ['import', '--out', str(tmp_path / 'out')],
                  ['import', *columns, '--out', str(tmp_path / 'out')]):  # fmt: skip
        assert main([words[0], str(path), *words[1:]]) == 2
        assert capsys.readouterr().err.count('\n') == 1
    assert main(['validate', str(path), '--model', str(path), '--out', str(tmp_path / 'out')]) == 2
