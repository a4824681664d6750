"""Damage: each kind has a clear one-line refusal, and what is readable is salvaged and counted."""

from __future__ import annotations

import sqlite3
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from damaged_bags import (
    NAME,
    STROKE,
    TICKS,
    chunk_starts,
    make,
    mcap_of,
    raw_bag,
    refused,
    write_stored,
)

from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records import (
    Record,
    bag_writer,
    cdr,
    load,
    mcap_format,
    read_bag,
    survey,
    write_bag,
)
from piezo_hysteresis.records.definitions import STATE, definition_of
from piezo_hysteresis.records.recorder import Recorder
from piezo_hysteresis.records.storage import Topic


def test_gaps(tmp_path: Path) -> None:
    keep = np.delete(TICKS, [100, 101, 150])
    path = raw_bag(tmp_path / 'bag', [(keep, keep * 1e-3, 1e-9 * keep)])
    found = refused(path, '3 samples are missing in 2 gaps, the first after 0.099 s')
    assert [len(record) for record in found.records] == [100, 48, 149]
    assert [record.name for record in found.records] == ['bag.1', 'bag.2', 'bag.3']
    assert [record.start for record in found.records] == [0, 0.102, 0.151]
    assert found.damage[0].count == 2


def test_repeated_messages_cost_nothing(tmp_path: Path) -> None:
    order = np.sort(np.concatenate([TICKS, [7, 8, 250]]))
    path = raw_bag(tmp_path / 'bag', [(order, order * 1e-3, 1e-8 * order)])
    found = survey([path])
    (record,) = found.records
    np.testing.assert_array_equal(record.voltage, TICKS)
    assert not found.damage
    assert [note.count for note in found.notes] == [3]


def test_doubled_samples(tmp_path: Path) -> None:
    order = np.sort(np.concatenate([TICKS, [7, 8, 250]]))
    stroke = 1e-9 * np.arange(order.size)  # the second of a pair says something else
    path = raw_bag(tmp_path / 'bag', [(order, order * 1e-3, stroke)])
    found = refused(path, '3 samples come twice')
    (record,) = found.records
    np.testing.assert_array_equal(record.voltage, TICKS)
    assert found.damage[0].lost == 3


def test_unsorted_samples(tmp_path: Path) -> None:
    order = TICKS.copy()
    order[[20, 21]] = order[[21, 20]]
    path = raw_bag(tmp_path / 'bag', [(order, order * 1e-3, 1e-9 * order)])
    (record,) = refused(path, '1 sample is out of order').records
    np.testing.assert_array_equal(record.voltage, TICKS)


def test_numbers_that_start_again(tmp_path: Path) -> None:
    sample = np.concatenate([TICKS, TICKS])
    stamp = np.concatenate([TICKS * 1e-3, 1.0 + TICKS * 1e-3])
    path = raw_bag(tmp_path / 'bag', [(sample, stamp, 1e-9 * sample)])
    found = survey([path])
    assert [(record.name, len(record)) for record in found.records] == [
        ('bag.1', 300), ('bag.2', 300)]  # fmt: skip
    assert 'start again 1 time: read as 2 runs' in str(found.notes[0])


def test_a_clock_that_starts_again_with_the_numbers(tmp_path: Path) -> None:
    """A simulator that was started anew stamps from 0 once more."""
    sample = np.concatenate([TICKS[40:], TICKS[:50]])
    path = raw_bag(tmp_path / 'bag', [(sample, sample * 1e-3, 1e-9 * sample)], in_order=True)
    assert [len(record) for record in survey([path]).records] == [260, 50]


def test_two_halves_in_the_wrong_order_are_no_restart(tmp_path: Path) -> None:
    sample = np.concatenate([TICKS[100:], TICKS[:100]])
    path = raw_bag(tmp_path / 'bag', [(sample, sample * 1e-3, 1e-9 * sample)])
    (record,) = refused(path, '1 sample is out of order').records
    np.testing.assert_array_equal(record.voltage, TICKS)


@pytest.mark.parametrize('numbered', [True, False])
def test_mixed_rates(tmp_path: Path, numbered: bool) -> None:
    stamp = np.concatenate([TICKS * 1e-3, 0.3 + 2e-3 * np.arange(200)])
    sample = np.arange(500) if numbered else np.zeros(500, int)
    path = raw_bag(tmp_path / 'bag', [(sample, stamp, 1e-9 * np.arange(500))])
    found = refused(path, r'the rate changes within the record \(1000, 500 Hz\)')
    assert [record.rate for record in found.records] == pytest.approx([1000, 500])
    assert sum(map(len, found.records)) == 500


def test_uneven_rate(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    stamp = np.cumsum(rng.uniform(0.5e-3, 1.4e-3, 300))
    path = raw_bag(tmp_path / 'bag', [(np.zeros(300, int), stamp, 1e-6 * np.sin(20 * stamp))])
    found = refused(path, 'the rate is uneven, steps are')
    (record,) = found.records
    truth = 1e-6 * np.sin(20 * record.time)
    assert np.abs(record.displacement - truth).max() < 1e-9  # interpolated, and said so
    assert 'interpolated' in found.damage[0].what


LATE = np.where(TICKS == 120, 0.6e-3, 0.0)
RNG = np.random.default_rng(4)
# A driver that stamps late by a part of a tick, is held up for 8 ticks, or is set back.
CLOCKS = {
    'one late': LATE,
    'all late': RNG.uniform(0, 0.9e-3, 300),
    'stalled': 1e-3 * np.clip(150 - TICKS, 0, None) * (TICKS >= 142),
    'set back': RNG.uniform(0, 1e-4, 300) - 5e-3 * (TICKS > 200),
}


@pytest.mark.parametrize('clock', CLOCKS)
def test_stamps_of_numbered_samples_may_jitter(tmp_path: Path, clock: Any) -> None:
    stamp = 1e9 + TICKS * 1e-3 + CLOCKS[clock]
    path = raw_bag(tmp_path / 'bag', [(TICKS, stamp, STROKE)], in_order=True)
    found = survey([path])
    (record,) = found.records
    assert record.rate == pytest.approx(1000.0, rel=0.02 if clock == 'set back' else 1e-12)
    np.testing.assert_array_equal(record.voltage, TICKS)
    assert any('its stamps jitter by up to' in str(note) for note in found.notes)


def test_missing_sample_numbers_are_a_gap_for_any_stamps(tmp_path: Path) -> None:
    kept = np.delete(TICKS, [100, 101])
    stamp = kept * 1e-3 + RNG.uniform(0, 0.9e-3, kept.size)
    found = refused(
        raw_bag(tmp_path / 'bag', [(kept, stamp, kept * 1e-9)]), '2 samples are missing'
    )
    assert [len(record) for record in found.records] == [100, 198]


def test_a_clock_that_jumps_is_reported(tmp_path: Path) -> None:
    stamp = TICKS * 1e-3 + 3600.0 * (TICKS > 150)
    found = refused(
        raw_bag(tmp_path / 'bag', [(TICKS, stamp, STROKE)]), 'stamps jump by up to 3.6e'
    )
    assert [len(record) for record in found.records] == [151, 149]


def test_a_clock_that_is_set_back_by_more_than_the_record_is_reported(tmp_path: Path) -> None:
    stamp = 3600.0 + TICKS * 1e-3 - 50.0 * (TICKS > 150)
    found = refused(
        raw_bag(tmp_path / 'bag', [(TICKS, stamp, STROKE)], in_order=True), 'stamps jump by up to'
    )
    assert [len(record) for record in found.records] == [151, 149]


def test_stamps_that_stand_still_are_reported(tmp_path: Path) -> None:
    path = raw_bag(tmp_path / 'bag', [(TICKS, np.full(TICKS.size, 7.0), STROKE)], in_order=True)
    with pytest.raises(
        RecordError, match='most of its stamps do not advance; let the driver stamp'
    ):
        load([path])


def test_values_that_are_not_numbers(tmp_path: Path) -> None:
    value = STROKE.copy()
    value[[40, 41]] = np.nan
    path = raw_bag(tmp_path / 'bag', [(TICKS, TICKS * 1e-3, value)])
    found = refused(path, '2 of 300 samples are not numbers, the first is number 40')
    assert [len(record) for record in found.records] == [40, 258]


@pytest.mark.parametrize(
    ('voltage', 'displacement', 'message'),
    [
        (100.0, 30.0, 'the displacement spans 30 m'),
        (100.0, 30e-12 * 0.1, 'less than an atom'),
        (1.5e5, 30e-6, 'the voltage reaches 1.5e'),
    ],
)
def test_wrong_units(tmp_path: Path, voltage: float, displacement: float, message: str) -> None:
    shape = np.linspace(0, 1, 100)
    write_bag(tmp_path / 'bag', [Record('a', 1e-3, voltage * shape, displacement * shape)])
    with pytest.raises(RecordError, match=message) as raised:
        load([tmp_path / 'bag'])
    assert '--salvage' not in str(raised.value)  # it keeps the wrong unit
    found = survey([tmp_path / 'bag'], salvage=True)
    assert [damage.what for damage in found.damage] == [str(raised.value).partition('a: ')[2]]
    (record,) = found.records
    np.testing.assert_array_equal(record.displacement, displacement * shape)


def test_two_actuators_by_topic(tmp_path: Path) -> None:
    part = (TICKS, TICKS * 1e-3, STROKE)
    path = raw_bag(tmp_path / 'bag', [part, (TICKS, TICKS * 1e-3, 2 * STROKE)])
    found = refused(path, r'it holds 2 actuators \(a, b\).*--actuator NAME')
    assert len(found.records) == 2
    (record,) = read_bag(path, actuator='b')
    np.testing.assert_array_equal(record.displacement, 2 * STROKE)
    with pytest.raises(RecordError, match="no actuator named 'z'"):
        read_bag(path, actuator='z')


def test_two_actuators_by_marker(tmp_path: Path) -> None:
    records = [make(100, 'p', actuator='one'), make(100, 'q', actuator='two'), make(100, 'r')]
    write_bag(tmp_path / 'bag', records)
    refused(tmp_path / 'bag', r'it holds 2 actuators \(one, two\)')
    assert [record.name for record in read_bag(tmp_path / 'bag', actuator='two')] == ['q']


def test_no_states_and_no_messages(tmp_path: Path) -> None:
    with Recorder(tmp_path / 'bag') as recorder:
        topic = recorder.add_topic('/chatter', 'std_msgs/msg/String')
        recorder.write(topic, b'\0\1\0\0\2\0\0\0x\0', 0)
    with pytest.raises(RecordError, match=r'but /chatter \(std_msgs/msg/String\)'):
        read_bag(tmp_path / 'bag')
    with Recorder(tmp_path / 'none'):
        pass
    with pytest.raises(RecordError, match='holds no messages'):
        read_bag(tmp_path / 'none', salvage=True)


@pytest.mark.component
@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
@pytest.mark.parametrize('part', [0.0, 0.3, 0.9, 0.999])
def test_truncated_file(tmp_path: Path, storage: str, part: float) -> None:
    write_stored(tmp_path / 'bag', [make(100_000)], storage)
    (file,) = (path for path in (tmp_path / 'bag').iterdir() if path.suffix != '.yaml')
    data = file.read_bytes()
    file.write_bytes(data[: int(part * len(data))])
    message = 'is empty' if part == 0 else 'ends early|cut off|is damaged'
    if storage == 'sqlite3' or part == 0:
        # A cut b-tree may be unreadable as a whole; the refusal must stay clear.
        with pytest.raises(RecordError, match=message):
            read_bag(tmp_path / 'bag')
        try:
            records = read_bag(tmp_path / 'bag', salvage=True)
        except RecordError:
            return
    else:
        records = refused(tmp_path / 'bag', message).records
        assert sum(map(len, records)) > 0.95 * part * 100_000
    for record in records:
        np.testing.assert_array_equal(np.diff(record.voltage), 1 / 256)


def test_missing_metadata(tmp_path: Path) -> None:
    for storage in ('mcap', 'sqlite3'):
        bag = tmp_path / storage
        write_stored(bag, [make()], storage)
        (bag / 'metadata.yaml').unlink()
        found = refused(bag, 'metadata.yaml is missing; run `ros2 bag reindex`')
        assert [len(record) for record in found.records] == [1000]


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('', 'an entry is missing'),
        ('{', 'it cannot be read'),
        ('rosbag2_bagfile_information: {version: 9}', 'an entry is missing'),
        ('\x00', 'it cannot be read'),
        ('[1, 2]', 'an entry is missing'),
    ],
)
def test_broken_metadata(tmp_path: Path, text: str, message: str) -> None:
    write_bag(tmp_path / 'bag', [make()])
    (tmp_path / 'bag' / 'metadata.yaml').write_text(text)
    found = refused(tmp_path / 'bag', message)
    assert [len(record) for record in found.records] == [1000]


def test_counts_that_do_not_agree(tmp_path: Path) -> None:
    write_bag(tmp_path / 'bag', [make()])
    path = tmp_path / 'bag' / 'metadata.yaml'
    path.write_text(path.read_text().replace('message_count: 1000', 'message_count: 1200'))
    refused(tmp_path / 'bag', 'metadata count 1200 messages of topic /piezo/actuator/state but '
            '1000 can be read')  # fmt: skip


def test_a_storage_file_that_is_missing(tmp_path: Path) -> None:
    write_bag(tmp_path / 'bag', [make()])
    (tmp_path / 'bag' / 'bag_0.mcap').unlink()
    with pytest.raises(RecordError, match=r'bag_0\.mcap is missing'):
        read_bag(tmp_path / 'bag')
    with pytest.raises(RecordError, match='holds no bag'):
        read_bag(tmp_path / 'bag', salvage=True)
    (tmp_path / 'empty').mkdir()
    with pytest.raises(RecordError, match='holds no bag'):
        load([tmp_path / 'empty'], salvage=True)


def test_a_flipped_bit_in_a_value(tmp_path: Path) -> None:
    file, data = mcap_of(tmp_path)
    start = chunk_starts(data)[1]
    data[start + 1_000_000] ^= 4
    file.write_bytes(data)
    found = refused(tmp_path / 'bag', 'the checksum of the chunk at byte')
    rows = bag_writer.ROWS
    assert [len(record) for record in found.records] == [rows, 100_000 - 2 * rows]
    assert sum(damage.lost for damage in found.damage) >= rows


def test_a_broken_page_of_sqlite_is_refused_with_what_repairs_it(tmp_path: Path) -> None:
    write_stored(tmp_path / 'bag', [make(20_000)], 'sqlite3')
    (file,) = (tmp_path / 'bag').glob('*.db3')
    data = bytearray(file.read_bytes())
    needle = np.float64(5000 / 256).tobytes() + np.float64(1e-9 * 5000).tobytes()
    page = bytes(data).index(needle) // 4096 * 4096
    data[page] = 0x77  # no kind of page
    file.write_bytes(data)
    with pytest.raises(RecordError, match=r'the database is damaged .*sqlite3 FILE \.recover'):
        read_bag(tmp_path / 'bag')


def test_a_broken_index(tmp_path: Path) -> None:
    file, data = mcap_of(tmp_path)
    (start,) = np.frombuffer(bytes(data[-28:-20]), '<u8')
    data[int(start) + 40] ^= 255
    file.write_bytes(data)
    found = refused(tmp_path / 'bag', 'the checksum of its index is wrong')
    assert [len(record) for record in found.records] == [100_000]
    data[-28:-20] = b'\xff' * 8
    file.write_bytes(data)
    found = refused(tmp_path / 'bag', 'its footer points to no index')
    assert [len(record) for record in found.records] == [100_000]


def test_a_broken_length_is_passed_with_the_help_of_the_index(tmp_path: Path) -> None:
    file, data = mcap_of(tmp_path)
    start = chunk_starts(data)[1]
    data[start - 3] = 255
    file.write_bytes(data)
    found = refused(tmp_path / 'bag', 'is broken or cut off')
    # The chunk itself is whole, as its checksum shows; the index knows where the next begins.
    assert [len(record) for record in found.records] == [100_000]


def test_data_that_seem_to_end_early(tmp_path: Path) -> None:
    """One flipped bit makes the head of a chunk look like the end of the data."""
    path = tmp_path / 'cut.mcap'
    _, data = mcap_of(tmp_path)
    start = chunk_starts(data)[-1] - 9
    unfinished = data[: data.index(mcap_format.record(mcap_format.DATA_END, bytes(4)), start)]
    unfinished += mcap_format.record(mcap_format.DATA_END, bytes(4)) + mcap_format.tail()
    path.write_bytes(unfinished)
    assert len(read_bag(path)[0]) == 100_000
    unfinished[start] = mcap_format.DATA_END
    path.write_bytes(unfinished)
    found = refused(path, 'bytes too early')
    assert [len(record) for record in found.records] == [3 * bag_writer.ROWS]


def test_unknown_definitions(tmp_path: Path) -> None:
    with Recorder(tmp_path / 'bag') as recorder:
        text = 'std_msgs/Header header\nuint64 sample\nstring voltage\nfloat64 displacement\n'
        header = definition_of(STATE)[0].split('=' * 80, 1)[1]
        topic = recorder.add_topic(NAME, STATE, definition=f'{text}{"=" * 80}{header}')
        recorder.write(topic, bytes(60), 0)
    with pytest.raises(RecordError, match='field voltage in the stored definition has no fixed'):
        read_bag(tmp_path / 'bag')


def test_other_fields_of_fixed_size_are_welcome(tmp_path: Path) -> None:
    """A driver may add what it likes, in any order, as long as ours are among it."""
    text = ('std_msgs/Header header\nuint8 mode\nuint64 sample\nfloat32 temperature\n'
            'float64 voltage\nfloat64 displacement\n')  # fmt: skip
    header = definition_of(STATE)[0].split('=' * 80, 1)[1]
    definition = f'{text}{"=" * 80}{header}'
    fields = cdr.fixed_fields(Topic(NAME, STATE, definition))
    columns = {'mode': 3, 'sample': TICKS, 'temperature': 20.5, 'voltage': TICKS * 2.0,
               'displacement': STROKE}  # fmt: skip
    rows = cdr.encode(fields, TICKS * 1_000_000, columns, 'lab')
    with Recorder(tmp_path / 'bag') as recorder:
        topic = recorder.add_topic(NAME, STATE, definition=definition)
        for k, row in enumerate(rows):
            recorder.write(topic, row.tobytes(), k)
    (record,) = read_bag(tmp_path / 'bag')
    np.testing.assert_array_equal(record.voltage, TICKS * 2.0)
    np.testing.assert_array_equal(record.displacement, STROKE)


def test_a_database_that_is_none(tmp_path: Path) -> None:
    (tmp_path / 'a.db3').write_bytes(b'not a database' * 100)
    with pytest.raises(RecordError, match='the database is damaged'):
        read_bag(tmp_path / 'a.db3')
    base = sqlite3.connect(tmp_path / 'b.db3')
    base.execute('CREATE TABLE other(x)')
    base.commit()
    base.close()
    with pytest.raises(RecordError, match='missing tables'):
        read_bag(tmp_path / 'b.db3')
    with pytest.raises(RecordError):
        read_bag(tmp_path / 'b.db3', salvage=True)


@pytest.mark.parametrize(
    'rows',
    [
        [],
        [(0.0, 0.0, 0.0)],
        [(0.0, 1.0 * k, 1.0 * k) for k in range(40)],  # stamps that do not advance
        [(0.1 * k, float('nan'), 1.0) for k in range(40)],
    ],
)
def test_salvage_is_advised_only_where_it_leaves_something(
    tmp_path: Path, rows: list[tuple[float, float, float]]
) -> None:
    broken, whole = tmp_path / 'a.csv', tmp_path / 'b.csv'
    header = 'time_s,voltage_V,displacement_um\n'
    broken.write_text(header + ''.join(f'{t},{u},{y}\n' for t, u, y in rows))
    whole.write_text(header + ''.join(f'{1e-3 * k},{k % 9},{k % 7}\n' for k in range(90)))
    with pytest.raises(RecordError) as alone:
        load(broken)
    assert '--salvage' not in str(alone.value)
    with pytest.raises(RecordError) as raised:
        load([broken, whole])
    if '--salvage' in str(raised.value):  # only if it helps
        assert len(load([broken, whole], salvage=True)) == 1
