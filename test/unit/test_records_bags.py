"""Bags: written and read back to the same bits, by us, by rosbags and as ros2 bag expects."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from damaged_bags import write_stored
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from rosbags.rosbag2.enums import CompressionFormat, CompressionMode
from rosbags.typesys import get_types_from_msg

from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records import Record, RecordInfo, cdr, load, read_bag, survey, write_bag
from piezo_hysteresis.records import mcap_format as mcap
from piezo_hysteresis.records.bag_writer import ROWS, fixed_fields
from piezo_hysteresis.records.definitions import (
    MARKER,
    MESSAGES,
    REFERENCE,
    STATE,
    definition_of,
    typestore,
)

STORAGES = ('mcap', 'sqlite3')
INTERFACES = Path(__file__).parents[2] / 'src' / 'piezo_interfaces' / 'msg'


def make(
    name: Any = 'a',
    n: int = 200,
    dt: float = 1e-3,
    *,
    reference: bool = False,
    start: float = 0.0,
    info: RecordInfo | None = None,
) -> Record:
    rng = np.random.default_rng(n)
    return Record(
        name,
        dt,
        50 * rng.standard_normal(n),
        1e-5 * rng.standard_normal(n),
        start=start,
        reference=1e-5 * rng.standard_normal(n) if reference else None,
        info=info or RecordInfo('bimorph', 'sine', 23.0, 50.0, 0.1),
    )


def assert_same(one: Record, other: Record) -> None:
    assert one.name == other.name
    assert one.dt == other.dt
    assert one.info == other.info
    np.testing.assert_array_equal(one.voltage, other.voltage)
    np.testing.assert_array_equal(one.displacement, other.displacement)
    assert (one.reference is None) == (other.reference is None)
    if one.reference is not None:
        np.testing.assert_array_equal(one.reference, other.reference)


@pytest.mark.parametrize('storage', STORAGES)
def test_records_come_back_bit_for_bit(tmp_path: Path, storage: Any) -> None:
    given_records = [
        make('slow', 300),
        make('long', ROWS + 77, 1 / 3000, reference=True),
        make('force', 50, 1 / 750, info=RecordInfo(input_unit='N')),
        make('late', 50, start=1000.0),
    ]
    write_stored(tmp_path / 'bag', given_records, storage)
    found = read_bag(tmp_path / 'bag')
    assert [record.name for record in found] == ['slow', 'long', 'force', 'late']
    for one, other in zip(given_records, found, strict=True):
        assert_same(one, other)
    # One after another: each begins with a full second behind the one in front of it.
    assert [record.start for record in found] == [0.0, 1.0, 12.0, 1000.0]


def test_rosbags_reads_the_same(tmp_path: Path) -> None:
    record = make(n=500, reference=True)
    write_bag(tmp_path / 'bag', [record])
    # A store that knows nothing of ours: the definitions must come out of the bag.
    from rosbags.highlevel import AnyReader

    with AnyReader([tmp_path / 'bag']) as reader:
        assert {c.msgtype for c in reader.connections} == {STATE, REFERENCE, MARKER}
        states: list[Any] = [
            reader.deserialize(data, connection.msgtype)
            for connection, _, data in reader.messages()
            if connection.msgtype == STATE
        ]
        markers: list[Any] = [
            reader.deserialize(data, connection.msgtype)
            for connection, _, data in reader.messages()
            if connection.msgtype == MARKER
        ]
    np.testing.assert_array_equal([m.voltage for m in states], record.voltage)
    np.testing.assert_array_equal([m.displacement for m in states], record.displacement)
    assert [m.sample for m in states] == list(range(500))
    stamps = [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in states]
    assert stamps == [k * 10**6 for k in range(500)]
    assert len(markers) == 1
    assert (markers[0].record, markers[0].rate) == ('a', 1000.0)


def test_layout_is_what_ros2_bag_expects(tmp_path: Path) -> None:
    write_bag(tmp_path / 'bag', [make()])
    names = {path.name for path in (tmp_path / 'bag').iterdir()}
    assert names == {'metadata.yaml', 'bag_0.mcap'}
    assert [path.name for path in tmp_path.iterdir()] == ['bag']
    content = yaml.safe_load((tmp_path / 'bag' / 'metadata.yaml').read_text())
    content = content['rosbag2_bagfile_information']
    assert content['version'] == 9
    assert content['storage_identifier'] == 'mcap'
    assert content['relative_file_paths'] == ['bag_0.mcap']
    assert content['message_count'] == content['files'][0]['message_count'] == 201
    assert content['duration']['nanoseconds'] == 199_000_000
    topics = {
        entry['topic_metadata']['name']: entry for entry in content['topics_with_message_count']
    }
    assert topics['/piezo/actuator/state']['message_count'] == 200
    for entry in topics.values():
        about = entry['topic_metadata']
        assert about['type_description_hash'] == typestore().hash_rihs01(about['type'])
    with Reader(tmp_path / 'bag') as reader:
        assert reader.message_count == sum(1 for _ in reader.messages()) == 201


def test_the_index_of_an_mcap_file_is_right(tmp_path: Path) -> None:
    """Rosbags seeks by our chunk index: a time window must give exactly its messages."""
    write_bag(tmp_path / 'bag', [make(n=2 * ROWS + 5, reference=True)])
    with Reader(tmp_path / 'bag') as reader:
        window = (ROWS - 3) * 10**6, (ROWS + 4) * 10**6
        times = [time for _, time, _ in reader.messages(start=window[0], stop=window[1])]
    assert times == sorted(2 * list(range(window[0], window[1], 10**6)))


# sqlite3 does not compress by itself.
KINDS = [
    (plugin, mode)
    for plugin in StoragePlugin
    for mode in CompressionMode
    if (plugin, mode) != (StoragePlugin.SQLITE3, CompressionMode.STORAGE)
]


@pytest.mark.parametrize(('plugin', 'mode'), KINDS)
def test_bags_of_others_are_read(tmp_path: Path, plugin: Any, mode: Any) -> None:
    """Other writer, frames of several lengths, compression, other topics beside ours."""
    store = typestore()
    types = store.types
    record = make(n=300)
    path = tmp_path / 'other'
    writer = Writer(path, version=9, storage_plugin=plugin)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        state = writer.add_connection('/x/actuator/state', STATE, typestore=store)
        text = writer.add_connection('/chatter', 'std_msgs/msg/String', typestore=store)
        for k in range(300):
            time = 1_700_000_000_000_000_000 + k * 1_000_000
            stamp = types['builtin_interfaces/msg/Time'](sec=time // 10**9, nanosec=time % 10**9)
            header = types['std_msgs/msg/Header'](stamp=stamp, frame_id='piezo'[: k % 5])
            message = types[STATE](
                header=header, sample=k, voltage=record.voltage[k],
                displacement=record.displacement[k],
            )  # fmt: skip
            writer.write(state, time, store.serialize_cdr(message, STATE))
            hello = types['std_msgs/msg/String'](data='x' * (k % 7))
            writer.write(text, time, store.serialize_cdr(hello, 'std_msgs/msg/String'))
    (found,) = read_bag(path)
    np.testing.assert_array_equal(found.voltage, record.voltage)
    np.testing.assert_array_equal(found.displacement, record.displacement)
    assert found.name == 'other'
    assert found.dt == 1e-3
    assert found.start == 0.0  # of a wall clock, seconds in float64 would lose nanoseconds


def test_mcap_without_chunks_and_with_lz4_chunks(tmp_path: Path) -> None:
    """As other writers lay it out: messages outside chunks, and another compression."""
    from zlib import crc32

    from lz4.frame import compress

    record = make(n=3000)
    write_bag(tmp_path / 'bag', [record])
    data = (tmp_path / 'bag' / 'bag_0.mcap').read_bytes()
    walk = mcap.walk(np.frombuffer(data[8:], np.uint8))
    (chunk,) = [(at + 8, size) for code, at, size in walk.others.tolist() if code == mcap.CHUNK]
    content = data[chunk[0] + 40 : chunk[0] + chunk[1]]
    head = data[: chunk[0] - 9]
    tail = mcap.record(mcap.DATA_END, bytes(4)) + mcap.tail()
    packed = compress(content)
    squeezed = mcap.record(
        mcap.CHUNK,
        struct.pack('<QQQI', 0, 0, len(content), crc32(content)),
        mcap.text('lz4'),
        struct.pack('<Q', len(packed)),
        packed,
    )
    for name, middle in [('plain', content), ('lz4', squeezed)]:
        path = tmp_path / f'{name}.mcap'
        path.write_bytes(head + middle + tail)
        assert_same(record, read_bag(path)[0])
    damaged = squeezed[:-200] + bytes(200)
    (tmp_path / 'bad.mcap').write_bytes(head + damaged + tail)
    with pytest.raises(RecordError, match='chunk at byte'):
        read_bag(tmp_path / 'bad.mcap')


def test_definitions_agree_with_the_interfaces() -> None:
    for msgtype, text in MESSAGES.items():
        name = msgtype.rsplit('/', 1)[1]
        theirs = get_types_from_msg((INTERFACES / f'{name}.msg').read_text(), msgtype)
        assert get_types_from_msg(text, msgtype) == theirs


def test_an_unknown_definition_is_found_in_the_sourced_prefixes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / 'share' / 'lab_msgs' / 'msg'
    folder.mkdir(parents=True)
    (folder / 'Outer.msg').write_text('lab_msgs/Inner[] parts\nstd_msgs/Header header\n')
    (folder / 'Inner.msg').write_text('float64[3] value\n')
    monkeypatch.setenv('AMENT_PREFIX_PATH', f'/nowhere:{tmp_path}')
    text, type_hash = definition_of('lab_msgs/msg/Outer')
    assert 'MSG: lab_msgs/Inner' in text
    assert type_hash.startswith('RIHS01_')
    with pytest.raises(RecordError, match='source the workspace'):
        definition_of('lab_msgs/msg/Missing')


@given(frame=st.text(max_size=9), big=st.booleans(), noise=st.binary(min_size=8, max_size=8))
@settings(max_examples=50, deadline=None)
def test_decoding_ignores_padding_and_takes_both_byte_orders(
    frame: Any, big: Any, noise: Any
) -> None:
    store = typestore()
    types = store.types
    stamp = types['builtin_interfaces/msg/Time'](sec=-5, nanosec=17)
    header = types['std_msgs/msg/Header'](stamp=stamp, frame_id=frame)
    message = types[STATE](header=header, sample=2**63 + 1, voltage=-1.5, displacement=3e-6)
    raw = bytearray(store.serialize_cdr(message, STATE, little_endian=not big))
    text_end = 4 + 12 + len(frame.encode()) + 1
    for at in range(text_end, 4 + -(-(text_end - 4) // 8) * 8):
        raw[at] = noise[at % 8]
    raw += noise[: -len(raw) % 4]
    buffer = np.frombuffer(b'??' + bytes(raw), np.uint8)
    decoded = cdr.decode(fixed_fields(STATE), buffer, np.array([2]), np.array([len(raw)]))
    assert decoded.good.all()
    assert decoded.stamps[0] == -5 * 10**9 + 17
    assert decoded.columns['sample'][0] == 2**63 + 1
    assert decoded.columns['voltage'][0] == -1.5
    assert decoded.columns['displacement'][0] == 3e-6


def test_a_short_or_foreign_message_is_not_decoded() -> None:
    rows = cdr.encode(fixed_fields(STATE), np.arange(3), {'sample': 1, 'voltage': 2.0,
                                                          'displacement': 3.0})  # fmt: skip
    size = rows.itemsize
    raw = bytearray(rows.tobytes())
    raw[size + 1] = 7  # an encapsulation that is not CDR
    struct.pack_into('<I', raw, 2 * size + cdr.FRAME_ID, 2**31)  # an endless frame
    offset, length = np.arange(3) * size, np.full(3, size)
    decoded = cdr.decode(fixed_fields(STATE), np.frombuffer(raw, np.uint8), offset, length)
    np.testing.assert_array_equal(decoded.good, [True, False, False])
    length[0] -= 8
    decoded = cdr.decode(fixed_fields(STATE), np.frombuffer(raw, np.uint8), offset, length)
    assert not decoded.good.any()


def test_nothing_is_overwritten_and_nothing_half_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_bag(tmp_path / 'bag', [make()])
    before = {p: p.read_bytes() for p in (tmp_path / 'bag').iterdir()}
    with pytest.raises(RecordError, match='exists already'):
        write_bag(tmp_path / 'bag', [make('b')])
    assert {p: p.read_bytes() for p in (tmp_path / 'bag').iterdir()} == before

    def full(*_: Any) -> None:
        raise OSError(28, 'No space left on device')

    monkeypatch.setattr('piezo_hysteresis.records.metadata.Metadata.write', full)
    with pytest.raises(RecordError, match='the disk is full'):
        write_bag(tmp_path / 'new', [make()])
    assert [path.name for path in tmp_path.iterdir()] == ['bag']


@pytest.mark.parametrize(
    ('records', 'storage', 'message'),
    [
        ([], 'mcap', 'no records'),
        ([make('a'), make('a')], 'mcap', "unique name, not 'a'"),
        ([make('')], 'mcap', 'unique name'),
        ([make()], 'sqlite3', 'ros2 bag convert'),
    ],
)
def test_bad_requests_are_refused(
    tmp_path: Path, records: Any, storage: str, message: str
) -> None:
    with pytest.raises(RecordError, match=message):
        write_bag(tmp_path / 'bag', records, storage=storage)
    assert not list(tmp_path.iterdir())


def test_load_mixes_sources_and_names_records_uniquely(tmp_path: Path) -> None:
    write_bag(tmp_path / 'one', [make('a'), make('b')])
    write_stored(tmp_path / 'two', [make('a')], 'sqlite3')
    csv = tmp_path / 'a.csv'
    lines = ['time_s,voltage_V,displacement_um']
    lines += [f'{k / 1000},{k % 7},{k % 5}' for k in range(50)]
    csv.write_text('\n'.join(lines))
    found = load([tmp_path / 'one', tmp_path / 'two' / 'two.db3', csv])
    assert [record.name for record in found] == ['a', 'b', 'a-2', 'a-3']
    assert survey([tmp_path / 'one']).bags[0].topics['/piezo/actuator/state'].count == 400
