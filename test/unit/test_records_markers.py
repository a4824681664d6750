"""Markers and references of a bag: ends of records, invalid content, omitted records."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from damaged_bags import FIELDS, STROKE, TICKS, chunk_starts, make, mcap_crc, refused

from piezo_hysteresis.records import RecordInfo, bag_writer, cdr, read_bag, survey, write_bag
from piezo_hysteresis.records.definitions import MARKER, REFERENCE, STATE, definition_of
from piezo_hysteresis.records.recorder import Recorder


def test_markers_end_records_and_samples_outside_are_noted(tmp_path: Path) -> None:
    """As a live sweep: idle, record one, pause, record two, idle."""
    from piezo_hysteresis.records.definitions import typestore

    types = typestore().types
    with Recorder(tmp_path / 'bag') as recorder:
        state = recorder.add_topic('/p/actuator/state', STATE, definition=definition_of(STATE)[0])
        mark = recorder.add_topic('/p/record/marker', MARKER, definition=definition_of(MARKER)[0])
        columns = {'sample': TICKS, 'voltage': TICKS * 1.0, 'displacement': STROKE}
        for k, row in enumerate(cdr.encode(FIELDS, TICKS * 1_000_000, columns)):
            recorder.write(state, row.tobytes(), k * 1_000_000)
        for tick, name in [(50, 'one'), (150, ''), (150, 'two'), (250, '')]:
            stamp = types['builtin_interfaces/msg/Time'](sec=0, nanosec=tick * 1_000_000)
            message = types[MARKER](
                header=types['std_msgs/msg/Header'](stamp=stamp, frame_id=''), record=name,
                actuator='x', excitation='sine', frequency=5.0, amplitude=1.0, warm_up=0.01,
                rate=1000.0, input_unit='V',
            )  # fmt: skip
            # Markers come from another process: later than the samples they belong to.
            raw = bytes(typestore().serialize_cdr(message, MARKER))
            recorder.write(mark, raw, 299_000_000)
    found = survey([tmp_path / 'bag'])
    assert [(r.name, len(r), r.voltage[0]) for r in found.records] == [
        ('one', 100, 50.0), ('two', 100, 150.0)]  # fmt: skip
    assert found.records[0].info == RecordInfo('x', 'sine', 5.0, 1.0, 0.01)
    assert any('100 samples lie outside' in str(note) for note in found.notes)


def test_a_marker_that_states_another_rate(tmp_path: Path) -> None:
    write_bag(tmp_path / 'bag', [make(100)])
    record = make(100)
    assert read_bag(tmp_path / 'bag')[0].dt == record.dt
    file = tmp_path / 'bag' / 'bag_0.mcap'
    data = file.read_bytes()
    at = data.index(np.float64(1000.0).tobytes())
    data = data[:at] + np.float64(2000.0).tobytes() + data[at + 8 :]
    start = chunk_starts(data)[0]
    size = int.from_bytes(data[start - 8 : start], 'little')
    content = data[start + 40 : start + size]
    crc = mcap_crc(content)
    file.write_bytes(data[: start + 24] + crc + data[start + 28 :])
    refused(tmp_path / 'bag', 'marker says 2000 Hz but its samples come at 1000 Hz')


def test_markers_of_another_definition(tmp_path: Path) -> None:
    """What was added is left alone; what is missing or no number is said."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    from piezo_hysteresis.records.definitions import MESSAGES

    plain = MESSAGES[MARKER]
    for name, text, value, message in [
        ('more', plain + 'string operator\n', 0.5, ''),
        ('less', plain.replace('float64 warm_up', 'float64 pause'), 0.5, 'lacks agreed fields'),
        ('nan', plain, np.nan, 'marker of record x has no usable amplitude'),
    ]:
        store = get_typestore(Stores.ROS2_JAZZY)
        store.register(get_types_from_msg(text, MARKER))
        kind: Any = store.types[MARKER]
        names = {field.name for field in fields(kind)}
        stamp = store.types['builtin_interfaces/msg/Time'](sec=0, nanosec=0)
        header = store.types['std_msgs/msg/Header'](stamp=stamp, frame_id='')
        values = dict.fromkeys(names, 0.5) | {
            'header': header, 'record': 'x', 'actuator': '', 'excitation': '', 'input_unit': 'N',
            'operator': 'me', 'amplitude': value, 'rate': 1000.0,
        }  # fmt: skip
        marker = kind(**{k: v for k, v in values.items() if k in names})
        with Recorder(tmp_path / name) as recorder:
            state = recorder.add_topic('/p/actuator/state', STATE,
                                       definition=definition_of(STATE)[0])  # fmt: skip
            definition, _ = store.generate_msgdef(MARKER, ros_version=2)
            mark = recorder.add_topic('/p/record/marker', MARKER, definition=definition)
            recorder.write(mark, bytes(store.serialize_cdr(marker, MARKER)), 0)
            columns = {'sample': TICKS, 'voltage': TICKS * 1.0, 'displacement': STROKE}
            for row in cdr.encode(FIELDS, TICKS * 1_000_000, columns):
                recorder.write(state, row.tobytes(), 0)
        found = refused(tmp_path / name, message) if message else survey([tmp_path / name])
        assert [record.name for record in found.records] == ['x']
        assert found.records[0].info.input_unit == 'N'
        assert found.records[0].info.amplitude == (0.0 if np.isnan(value) else 0.5)


@pytest.mark.parametrize('kept', [slice(0, 290), slice(7, 300), slice(0, 100), slice(0, 300, 2)])
def test_a_record_ends_with_its_reference(tmp_path: Path, kept: slice) -> None:
    fields = bag_writer.fixed_fields(REFERENCE)
    with Recorder(tmp_path / 'bag') as recorder:
        state = recorder.add_topic('/p/actuator/state', STATE, definition=definition_of(STATE)[0])
        text = definition_of(REFERENCE)[0]
        wish = recorder.add_topic('/p/reference', REFERENCE, definition=text)
        columns = {'sample': TICKS, 'voltage': TICKS * 1.0, 'displacement': STROKE}
        for k, row in enumerate(cdr.encode(FIELDS, TICKS * 1_000_000, columns)):
            recorder.write(state, row.tobytes(), k * 1_000_000)
        wished = dict.fromkeys([name for name, _ in fields], 0.0) | {'sample': TICKS[kept]}
        for row in cdr.encode(fields, TICKS[kept] * 1_000_000, wished):
            recorder.write(wish, row.tobytes(), 0)
    found = survey([tmp_path / 'bag'])
    (record,) = found.records
    number = TICKS[kept].size
    notes = ' '.join(map(str, found.notes))
    if kept.step is None and number > 0.5 * TICKS.size:
        assert record.reference is not None
        np.testing.assert_array_equal(record.voltage, TICKS[kept])
        assert f'{TICKS.size - number} samples before or after the reference left out' in notes
    else:  # gaps, or the smaller part: the samples stay
        assert record.reference is None
        assert len(record) == TICKS.size
        assert f'{TICKS.size - number} samples have no reference' in notes


def test_metadata_of_our_bags_are_plain_yaml(tmp_path: Path) -> None:
    write_bag(tmp_path / 'bag', [make()])
    content = yaml.safe_load((tmp_path / 'bag' / 'metadata.yaml').read_text())
    assert content['rosbag2_bagfile_information']['storage_identifier'] == 'mcap'
