"""The player: every message once, in the order of its log time, when it is due."""

from __future__ import annotations

import math
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag2 import Reader

from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records import Record, bag_writer, write_bag
from piezo_hysteresis.records.player import Player
from piezo_hysteresis.records.recorder import Recorder


class Time:
    """A clock that only waiting moves."""

    def __init__(self) -> None:
        self.now = 100.0

    def clock(self) -> float:
        return self.now

    def wait(self, seconds: Any) -> None:
        assert seconds > 0
        self.now += seconds


@pytest.fixture(scope='module')
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    rng = np.random.default_rng(1)
    n = bag_writer.ROWS + 500
    records = [
        Record('a', 1e-3, rng.standard_normal(n), 1e-6 * rng.standard_normal(n),
               reference=rng.standard_normal(n)),
        Record('b', 2e-3, rng.standard_normal(20), 1e-6 * rng.standard_normal(20)),
    ]  # fmt: skip
    path = tmp_path_factory.mktemp('player') / 'bag'
    write_bag(path, records)
    return path


@pytest.mark.component
def test_order_and_content_are_those_of_rosbags(bag: Path) -> None:
    with Reader(bag) as reader:
        theirs = sorted((time, c.topic, data) for c, time, data in reader.messages())
    player = Player(bag, rate=math.inf)
    played = list(player)
    assert sorted((m.log_time, m.topic.name, m.payload) for m in played) == theirs
    times = [m.log_time for m in played]
    assert times == sorted(times)
    assert player.count == len(played)
    assert (player.first, player.last) == (times[0], times[-1])
    # At one tick the marker stands in front of the sample that it announces.
    assert [m.topic.name for m in played[:3]] != sorted(m.topic.name for m in played[:3])
    assert set(player.topics) == {
        '/piezo/actuator/state', '/piezo/record/marker', '/piezo/reference'}  # fmt: skip


@pytest.mark.parametrize('rate', [0.5, 1.0, 20.0])
def test_messages_come_when_they_are_due(bag: Path, rate: float) -> None:
    time = Time()
    player = Player(bag, rate=rate, topics=['piezo/record/marker'], clock=time.clock,
                    wait=time.wait)  # fmt: skip
    due = [(message.log_time, time.now - 100.0) for message in player]
    assert [log_time for log_time, _ in due] == [0, 34 * 10**9]
    assert due[0][1] == 0
    assert due[1][1] == pytest.approx(34 / rate)


def test_loops_until_stopped(bag: Path) -> None:
    time = Time()
    player = Player(bag, loop=True, topics=['/piezo/record/marker'], clock=time.clock,
                    wait=time.wait)  # fmt: skip
    laps = []
    for message in player:
        laps.append(message.lap)
        if len(laps) == 5:
            player.stop()
    assert laps == [0, 0, 1, 1, 2]
    assert time.now == pytest.approx(100.0 + 2 * 34)


def test_a_stop_ends_a_long_wait_at_once(bag: Path) -> None:
    player = Player(bag, rate=1e-3, topics=['/piezo/record/marker'])
    messages = iter(player)
    next(messages)
    timer = threading.Timer(0.05, player.stop)
    timer.start()
    assert list(messages) == []  # without the stop this would wait for nine hours
    timer.join()


def test_messages_of_overlapping_chunks_are_merged(tmp_path: Path) -> None:
    times = [5, 1, 9, 3, 2, 8, 0, 7]
    with Recorder(tmp_path / 'bag', flush_interval=30, split=1 << 14) as recorder:
        topic = recorder.add_topic('/x', 'lab_msgs/msg/X')
        for time in times:
            recorder.write(topic, bytes([time]) * 3000, time)
    assert len(list((tmp_path / 'bag').glob('*.mcap'))) > 1
    played = list(Player(tmp_path / 'bag', rate=math.inf))
    assert [m.log_time for m in played] == sorted(times)
    assert all(m.payload == bytes([m.log_time]) * 3000 for m in played)


def test_refusals(bag: Path, tmp_path: Path) -> None:
    with pytest.raises(RecordError, match='must be positive, got 0'):
        Player(bag, rate=0)
    with pytest.raises(RecordError, match='must be positive, got nan'):
        Player(bag, rate=math.nan)
    with pytest.raises(RecordError, match='none of the topics is in it'):
        Player(bag, topics=['/nothing'])
    with Recorder(tmp_path / 'none'):
        pass
    with pytest.raises(RecordError, match='holds no messages'):
        Player(tmp_path / 'none')
    with pytest.raises(RecordError, match='does not exist'):
        Player(tmp_path / 'nowhere')


@pytest.mark.component
def test_damaged_bags_are_played_only_when_salvaging(bag: Path, tmp_path: Path) -> None:
    data = (bag / 'bag_0.mcap').read_bytes()
    file = tmp_path / 'cut.mcap'
    file.write_bytes(data[: len(data) // 2])
    with pytest.raises(RecordError, match='ends early'):
        Player(file)
    player = Player(file, rate=math.inf, salvage=True)
    assert player.damage
    assert len(list(player)) == player.count > 1000
