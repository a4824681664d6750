"""The recorder loses nothing: not when killed, not when terminated, not on a full disk."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from rosbags.rosbag2 import Reader

from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records import bag_writer, cdr, read_bag, survey
from piezo_hysteresis.records.definitions import STATE, definition_of
from piezo_hysteresis.records.recorder import Recorder

NAME = '/piezo/actuator/state'
FIELDS = bag_writer.fixed_fields(STATE)


def payloads(count: int, first: int = 0) -> list[Any]:
    ticks = np.arange(first, first + count)
    columns = {'sample': ticks, 'voltage': ticks * 0.5, 'displacement': ticks * 1e-9}
    rows = cdr.encode(FIELDS, ticks * 1_000_000, columns)
    return [row.tobytes() for row in rows]


def feed(recorder: Recorder, topic: int, messages: list[Any], first: int = 0) -> None:
    for k, message in enumerate(messages, start=first):
        recorder.write(topic, message, k * 1_000_000)


def by_rosbags(path: Path) -> list[Any]:
    with Reader(path) as reader:
        return [data for _, _, data in reader.messages()]


@pytest.mark.parametrize('split', [1 << 26, 1 << 16])
def test_what_was_handed_over_is_in_the_bag_byte_for_byte(tmp_path: Path, split: int) -> None:
    messages = payloads(3000)
    odd = [bytes([k % 256]) * (k % 300) for k in range(500)]
    with Recorder(tmp_path / 'bag', flush_interval=0.02, split=split) as recorder:
        state = recorder.add_topic(NAME, STATE, definition=definition_of(STATE)[0])
        feed(recorder, state, messages[:1000])
        time.sleep(0.05)
        other = recorder.add_topic('/odd', 'lab_msgs/msg/Odd', definition='uint8[] data\n')
        feed(recorder, other, odd)
        feed(recorder, state, messages[1000:], 1000)
    status = recorder.status
    assert (status.received, status.written, status.dropped) == (3500, 3500, 0)
    with Reader(tmp_path / 'bag') as reader:
        found: dict[str, list[bytes]] = {NAME: [], '/odd': []}
        for connection, _, data in reader.messages():
            found[connection.topic].append(data)
        assert reader.message_count == 3500
    # Split files: rosbags goes file by file, and our two topics were written side by side.
    assert sorted(found[NAME]) == sorted(messages)
    assert sorted(found['/odd']) == sorted(odd)
    files = sorted(path.name for path in (tmp_path / 'bag').glob('*'))
    assert files[0] == 'bag_0.mcap'
    assert (len(files) > 3) == (split < 1 << 20)
    (record,) = read_bag(tmp_path / 'bag')
    np.testing.assert_array_equal(record.voltage, np.arange(3000) * 0.5)
    assert not survey([tmp_path / 'bag']).notes
    total = sum(path.stat().st_size for path in (tmp_path / 'bag').glob('*.mcap'))
    assert total < 1_000_000  # nothing of the reserved room is left


@pytest.mark.component
def test_memory_does_not_grow_with_what_was_written(tmp_path: Path) -> None:
    """The index of a file that is recorded for hours is read back from it, not kept."""
    import tracemalloc

    def record(chunks: int) -> int:
        for k in range(chunks):
            for topic in topics:
                recorder.write(topic, bytes(40), k)
            while recorder.status.written < recorder.status.received:
                time.sleep(1e-4)
        return tracemalloc.get_traced_memory()[0]

    with Recorder(tmp_path / 'bag', flush_interval=1e-3) as recorder:
        topics = [recorder.add_topic(f'/t{k}', 'std_msgs/msg/Empty') for k in range(3)]
        tracemalloc.start()
        try:
            started = record(200)
            grown = record(1000) - started
        finally:
            tracemalloc.stop()
    assert grown < 20_000
    with Reader(tmp_path / 'bag') as reader:
        assert len(list(reader.messages())) == 3600


@pytest.mark.slow
def test_every_state_on_disk_is_a_valid_bag(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Copy the bag in front of every single write that the recorder makes."""
    import shutil

    seen: list[Path] = []
    write = os.pwrite
    cut = os.ftruncate

    def look() -> None:
        if (tmp_path / 'bag').exists():
            copy = tmp_path / f'copy_{len(seen)}'
            shutil.copytree(tmp_path / 'bag', copy)
            seen.append(copy)

    def pwrite(fd: Any, data: Any, at: Any) -> int:
        look()
        # A write may also stop half way: the next look must find that harmless too.
        half = write(fd, bytes(data)[: max(len(data) // 2, 9)], at)
        look()
        return half

    def ftruncate(fd: Any, size: Any) -> None:
        look()
        cut(fd, size)
        look()

    monkeypatch.setattr(os, 'pwrite', pwrite)
    monkeypatch.setattr(os, 'ftruncate', ftruncate)
    messages = payloads(450)
    with Recorder(tmp_path / 'bag', flush_interval=1e-3, split=1 << 14) as recorder:
        topic = recorder.add_topic(NAME, STATE, definition=definition_of(STATE)[0])
        for first in range(0, 450, 90):
            feed(recorder, topic, messages[first : first + 90], first)
            while recorder.status.written < first + 90:
                time.sleep(0.001)
    assert len(seen) > 30
    counts = []
    for copy in seen:
        found = by_rosbags(copy)
        assert found == messages[: len(found)]
        counts.append(len(found))
        if found:
            (record,) = read_bag(copy)
            np.testing.assert_array_equal(record.voltage, np.arange(len(found)) * 0.5)
    assert counts == sorted(counts)
    assert counts[-1] == 450


SCRIPT = textwrap.dedent("""
    import signal, sys, time
    from piezo_hysteresis.records.recorder import Recorder
    from piezo_hysteresis.records.definitions import STATE, definition_of
    from piezo_hysteresis.records import bag_writer, cdr
    import numpy as np

    def stop(*_):
        raise SystemExit(0)

    signal.signal(signal.SIGTERM, stop)
    fields = bag_writer.fixed_fields(STATE)
    with Recorder(sys.argv[1]) as recorder:
        topic = recorder.add_topic('/piezo/actuator/state', STATE,
                                   definition=definition_of(STATE)[0])
        start = time.time()
        k = 0
        while True:
            columns = {'sample': k, 'voltage': time.time() - start, 'displacement': 0.0}
            stamp = np.array([k * 1_000_000])
            recorder.write(topic, cdr.encode(fields, stamp, columns).tobytes(), int(stamp[0]))
            k += 1
            print(k, time.time() - start, flush=True)
            time.sleep(0.001)
""")


@pytest.mark.component
@pytest.mark.parametrize('how', [signal.SIGKILL, signal.SIGTERM])
def test_a_killed_recording_is_readable(tmp_path: Path, how: Any) -> None:
    script = tmp_path / 'script.py'
    script.write_text(SCRIPT)
    with subprocess.Popen(
        [sys.executable, script, tmp_path / 'bag'], stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        handed, last = 0, 0.0
        for line in process.stdout:
            handed, last = int(line.split()[0]), float(line.split()[1])
            if last > 1.5:
                process.send_signal(how)
                break
        for line in process.stdout:
            handed, last = int(line.split()[0]), float(line.split()[1])
    found = survey([tmp_path / 'bag'])
    (record,) = found.records
    assert len(by_rosbags(tmp_path / 'bag')) == len(record)
    np.testing.assert_array_equal(np.diff(record.voltage) > 0, True)
    if how == signal.SIGTERM:
        assert len(record) >= handed  # the last line may not have been printed
        assert not found.notes
    else:
        assert record.voltage[-1] > last - 1.0
        assert len(record) > 10
        assert any('not closed' in str(note) for note in found.notes)


def test_a_full_disk_keeps_everything_and_counts_the_rest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from piezo_hysteresis.records import metadata

    write = os.pwrite
    room = [60_000]

    def pwrite(fd: Any, data: Any, at: Any) -> int:
        if room[0] < len(data):
            raise OSError(28, 'No space left on device')
        room[0] -= len(data)
        return write(fd, data, at)

    monkeypatch.setattr(os, 'pwrite', pwrite)
    plain = metadata.Metadata.write

    def write_metadata(self: Any, folder: Any) -> None:
        if room[0] < 10_000:
            raise OSError(28, 'No space left on device')
        plain(self, folder)

    monkeypatch.setattr(metadata.Metadata, 'write', write_metadata)
    messages = payloads(2000)
    recorder = Recorder(tmp_path / 'bag', flush_interval=0.01, queue=30_000)
    topic = recorder.add_topic(NAME, STATE, definition=definition_of(STATE)[0])
    for first in range(0, 2000, 50):
        feed(recorder, topic, messages[first : first + 50], first)
        time.sleep(0.012)
    assert 'the disk is full' in recorder.status.problem
    status = recorder.close()
    assert status.received == 2000
    assert 0 < status.written < 2000
    assert status.dropped == 2000 - status.written
    (record,) = read_bag(tmp_path / 'bag')
    assert by_rosbags(tmp_path / 'bag') == messages[: status.written]
    assert len(record) == status.written


def test_recording_resumes_when_the_disk_has_space_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:

    write = os.pwrite
    full = [False]

    def pwrite(fd: Any, data: Any, at: Any) -> int:
        if full[0]:
            raise OSError(28, 'No space left on device')
        return write(fd, data, at)

    monkeypatch.setattr(os, 'pwrite', pwrite)
    messages = payloads(300)
    with Recorder(tmp_path / 'bag', flush_interval=0.01) as recorder:
        topic = recorder.add_topic(NAME, STATE, definition=definition_of(STATE)[0])
        feed(recorder, topic, messages[:100])
        full[0] = True
        feed(recorder, topic, messages[100:200], 100)
        while not recorder.status.problem:
            time.sleep(0.005)
        full[0] = False
        feed(recorder, topic, messages[200:], 200)
    assert recorder.status.dropped == 0
    assert by_rosbags(tmp_path / 'bag') == messages


def test_a_really_full_file_system(tmp_path: Path) -> None:
    """A file system of half a megabyte of our own, where the machine lets us mount one."""
    mount = tmp_path / 'small'
    mount.mkdir()
    made = subprocess.run(
        ['mount', '-t', 'tmpfs', '-o', 'size=512k', 'tmpfs', mount], capture_output=True
    ) if os.geteuid() == 0 else None  # fmt: skip
    if made is None or made.returncode:
        pytest.skip('no right to mount a file system')
    try:
        recorder = Recorder(mount / 'bag', flush_interval=0.01)
        topic = recorder.add_topic(NAME, STATE, definition=definition_of(STATE)[0])
        messages = payloads(20_000)
        for first in range(0, 20_000, 500):
            feed(recorder, topic, messages[first : first + 500], first)
            time.sleep(0.01)
        status = recorder.close()
        assert 'the disk is full' in status.problem
        assert status.written > 2000
        assert by_rosbags(mount / 'bag') == messages[: status.written]
        (record,) = read_bag(mount / 'bag')
        assert len(record) == status.written
    finally:
        subprocess.run(['umount', mount], check=True)


def test_a_slow_disk_drops_and_counts(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / 'bag', flush_interval=30, queue=1000)
    topic = recorder.add_topic('/x', 'lab_msgs/msg/X')
    taken = [recorder.write(topic, bytes(100), k) for k in range(30)]
    assert taken == [True] * 10 + [False] * 20
    status = recorder.close()
    assert (status.received, status.written, status.dropped) == (30, 10, 20)
    assert not recorder.write(topic, b'', 0)
    content = yaml.safe_load((tmp_path / 'bag' / 'metadata.yaml').read_text())
    custom = content['rosbag2_bagfile_information']['custom_data']
    assert custom['piezo_hysteresis.dropped'] == '20'
    assert custom['piezo_hysteresis.state'] == 'closed'


def test_refusals(tmp_path: Path) -> None:
    (tmp_path / 'bag').mkdir()
    with pytest.raises(RecordError, match='exists already'):
        Recorder(tmp_path / 'bag')
    (tmp_path / 'file').write_text('')
    with pytest.raises(RecordError, match='cannot be created'):
        Recorder(tmp_path / 'file' / 'bag')
    with Recorder(tmp_path / 'new') as recorder:
        recorder.add_topic('/x', 'lab_msgs/msg/X')
        with pytest.raises(RecordError, match='recorded already'):
            recorder.add_topic('/x', 'lab_msgs/msg/X')
        with pytest.raises(RecordError, match='no YAML'):
            recorder.add_topic('/y', 'lab_msgs/msg/X', qos='[')
    assert not [path for path in Path(tmp_path).iterdir() if path.name.startswith('.')]
    with pytest.raises(RecordError, match='holds no messages'):
        read_bag(tmp_path / 'new')


@pytest.mark.parametrize('room', [1000, 3000, 5000, 20_000, 40_000])
def test_written_is_what_rosbags_finds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, room: int
) -> None:
    """A disk that is full at any stage, metadata and second file included."""
    left = [room]

    def pwrite(file: int, data: Any, at: int) -> int:
        left[0] -= len(data)
        if left[0] < 0:
            raise OSError(28, 'No space left on device')
        return write(file, data, at)

    def write_text(self: Path, text: str, *_: Any) -> int:
        left[0] -= len(text)
        if left[0] < 0:
            raise OSError(28, 'No space left on device')
        return int(put(self, text, 'utf-8'))

    recorder = Recorder(tmp_path / 'bag', flush_interval=0.01, split=1 << 14)
    write, put = os.pwrite, Path.write_text
    monkeypatch.setattr(os, 'pwrite', pwrite)
    monkeypatch.setattr(Path, 'write_text', write_text)
    topic = recorder.add_topic(NAME, STATE, definition=definition_of(STATE)[0])
    messages = payloads(1000)
    for first in range(0, 1000, 100):
        feed(recorder, topic, messages[first : first + 100], first)
        for _ in range(100):
            if recorder.status.written == first + 100 or recorder.status.problem:
                break
            time.sleep(0.01)
    status = recorder.close()
    assert status.written + status.dropped == 1000
    assert status.dropped == 0 or status.problem
    assert by_rosbags(tmp_path / 'bag') == messages[: status.written]
