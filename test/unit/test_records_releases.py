"""Messages and bags are the same in the releases of ROS 2 that users may have."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from piezo_hysteresis.records import read_bag
from piezo_hysteresis.records.definitions import MESSAGES, STATE, typestore

OTHERS = [store for store in Stores if store.name in ('ROS2_KILTED', 'ROS2_LYRICAL')]


def of_release(release: Stores) -> Any:
    """Return its common types with our messages."""
    store = get_typestore(release)
    for name, text in MESSAGES.items():
        store.register(get_types_from_msg(text, name))
    return store


def state(types: Any, k: int) -> Any:
    stamp = types['builtin_interfaces/msg/Time'](sec=1_800_000_000, nanosec=k * 1_000_000)
    header = types['std_msgs/msg/Header'](stamp=stamp, frame_id='stage')
    return types[STATE](
        header=header, sample=k, voltage=10 * np.sin(0.1 * k), displacement=1e-6 * np.sin(0.1 * k)
    )


def test_rosbags_knows_both_later_releases() -> None:
    assert len(OTHERS) == 2


@pytest.mark.parametrize('release', OTHERS, ids=lambda each: each.name)
def test_messages_have_the_hash_and_the_bytes_of_jazzy(release: Stores) -> None:
    jazzy, other = typestore(), of_release(release)
    for name in (*MESSAGES, 'std_msgs/msg/Float64', 'sensor_msgs/msg/JointState'):
        assert other.hash_rihs01(name) == jazzy.hash_rihs01(name)
    raw = other.serialize_cdr(state(other.types, 3), STATE)
    assert raw == jazzy.serialize_cdr(state(jazzy.types, 3), STATE)
    assert jazzy.deserialize_cdr(raw, STATE).voltage == pytest.approx(10 * np.sin(0.3))


@pytest.mark.parametrize('release', OTHERS, ids=lambda each: each.name)
def test_a_bag_of_the_release_is_read(tmp_path: Path, release: Stores) -> None:
    store, folder = of_release(release), tmp_path / 'bag'
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topic = writer.add_connection('/actuator/state', STATE, typestore=store)
        for k in range(100):
            raw = store.serialize_cdr(state(store.types, k), STATE)
            writer.write(topic, 1_800_000_000_000_000_000 + k * 1_000_000, raw)
    metadata = folder / 'metadata.yaml'
    text = metadata.read_text('utf-8')
    name = release.name.removeprefix('ROS2_').lower()
    metadata.write_text(text.replace('ros_distro: rosbags', f'ros_distro: {name}'), 'utf-8')
    (record,) = read_bag(folder)
    assert record.voltage == pytest.approx(10 * np.sin(0.1 * np.arange(100)))
