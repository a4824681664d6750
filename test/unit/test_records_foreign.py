"""Bags of other message types, by the names of their fields."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from piezo_hysteresis.cli.main import main
from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records import read_bag
from piezo_hysteresis.records.damage import DamageLog
from piezo_hysteresis.records.foreign import foreign_records, parse_signal

VOLTAGE = '/amplifier/command.channels[1].volt:mV'
DISPLACEMENT = '/laser.point.x:um'


@pytest.fixture(scope='module')
def lab_bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a bag: voltage each 4 ms without header, displacement each 2 ms with one."""
    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(get_types_from_msg('lab_msgs/Channel[] channels', 'lab_msgs/msg/Command'))
    store.register(get_types_from_msg('string name\nfloat32 volt', 'lab_msgs/msg/Channel'))
    types = store.types
    channel = types['lab_msgs/msg/Channel']
    path = tmp_path_factory.mktemp('lab') / 'lab'
    rng = np.random.default_rng(0)
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        command = writer.add_connection(
            '/amplifier/command', 'lab_msgs/msg/Command', typestore=store
        )
        laser = writer.add_connection('/laser', 'geometry_msgs/msg/PointStamped', typestore=store)
        for k in range(200):
            time = 1_800_000_000_000_000_000 + k * 2_000_000
            if k % 2 == 0 and k > 4:
                message = types['lab_msgs/msg/Command'](
                    channels=[channel(name='a', volt=0.0), channel(name='b', volt=1000.0 * k)]
                )
                raw = store.serialize_cdr(message, 'lab_msgs/msg/Command')
                writer.write(command, time, raw)
            stamp = types['builtin_interfaces/msg/Time'](sec=time // 10**9, nanosec=time % 10**9)
            point = types['geometry_msgs/msg/PointStamped'](
                header=types['std_msgs/msg/Header'](stamp=stamp, frame_id='laser'),
                point=types['geometry_msgs/msg/Point'](x=0.25 * k, y=0.0, z=0.0),
            )
            late = time + int(rng.integers(0, 5_000_000))
            raw = store.serialize_cdr(point, 'geometry_msgs/msg/PointStamped')
            writer.write(laser, late, raw)
    return path


def test_voltages_hold_and_displacements_are_the_samples(lab_bag: Path) -> None:
    log = DamageLog()
    (record,) = foreign_records(lab_bag, log, voltage=VOLTAGE, displacement=DISPLACEMENT)
    tick = np.arange(6, 200)
    assert record.dt == 2e-3
    assert record.name == 'lab'
    np.testing.assert_array_equal(record.voltage, 2 * (tick // 2))
    np.testing.assert_array_equal(record.displacement, 0.25 * tick / 1e6)
    assert [note.count for note in log.notes] == [6]


def test_the_verb_makes_a_bag_of_ours(
    lab_bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ['import', str(lab_bag), '--out', str(tmp_path / 'bag'), '--voltage', VOLTAGE]
    assert main(words) == 2
    assert 'belong together' in capsys.readouterr().err
    assert main([*words, '--displacement', DISPLACEMENT, '--actuator', 'stack']) == 0
    assert 'note: ' in capsys.readouterr().err
    (record,) = read_bag(tmp_path / 'bag')
    assert (record.name, len(record), record.info.actuator) == ('lab', 194, 'stack')


@pytest.mark.parametrize(
    ('voltage', 'displacement', 'message'),
    [
        ('/amplifier', DISPLACEMENT, r'write /topic\.field or /topic\.field:unit'),
        (VOLTAGE, '/laser.point.x:inch', 'has no unit of m, mm'),
        ('/none.data', DISPLACEMENT, 'nothing of topic /none, but /amplifier/command, /laser'),
        (VOLTAGE, '/laser.point.q', 'has header, point'),
        (VOLTAGE, '/laser.header', 'no number header'),
        ('/amplifier/command.channels[7].volt', DISPLACEMENT, 'no number channels.7.volt'),
    ],
)
def test_a_missing_source_is_reported(
    lab_bag: Path, voltage: Any, displacement: Any, message: str
) -> None:
    with pytest.raises(RecordError, match=message):
        foreign_records(lab_bag, DamageLog(), voltage=voltage, displacement=displacement)


def test_signals_are_parsed() -> None:
    signal = parse_signal('adc/raw.data[2]', 'voltage')
    assert (signal.topic, signal.field, signal.divisor) == ('/adc/raw', ('data', '2'), 1.0)
    assert parse_signal('/x.y.z:nm', 'reference').divisor == 1e9


@pytest.fixture(scope='module')
def robot_bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a bag of joint states and wrenches, as ros2_control publishes them."""
    store = get_typestore(Stores.ROS2_JAZZY)
    types = store.types
    path = tmp_path_factory.mktemp('robot') / 'robot'
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        joints, wrench = 'sensor_msgs/msg/JointState', 'geometry_msgs/msg/WrenchStamped'
        states = writer.add_connection('/joint_states', joints, typestore=store)
        forces = writer.add_connection('/ft', wrench, typestore=store)
        for k in range(200):
            time = 1_800_000_000_000_000_000 + k * 2_000_000
            stamp = types['builtin_interfaces/msg/Time'](sec=time // 10**9, nanosec=time % 10**9)
            header = types['std_msgs/msg/Header'](stamp=stamp, frame_id='')
            vector = types['geometry_msgs/msg/Vector3']
            load = types['geometry_msgs/msg/Wrench'](
                force=vector(x=0.0, y=0.0, z=0.5 * k), torque=vector(x=0.0, y=0.0, z=0.0)
            )
            writer.write(forces, time, store.serialize_cdr(types[wrench](header, load), wrench))
            # the order of the joints changes, as it may
            names = ['x', 'stage'] if k % 2 else ['stage', 'x']
            places = [9.0, 1e-7 * k] if k % 2 else [1e-7 * k, 9.0]
            message = types[joints](
                header=header, name=names, position=np.array(places), velocity=np.zeros(0),
                effort=np.zeros(0),
            )  # fmt: skip
            writer.write(states, time, store.serialize_cdr(message, joints))
    return path


def test_a_joint_is_found_by_its_name_and_a_wrench_is_a_force(
    robot_bag: Path, tmp_path: Path
) -> None:
    words = ['--force', '/ft.wrench.force.z:N', '--displacement', '/joint_states.position[stage]']
    assert main(['import', str(robot_bag), '--out', str(tmp_path / 'bag'), *words]) == 0
    (record,) = read_bag(tmp_path / 'bag')
    assert record.info.input_unit == 'N'
    np.testing.assert_allclose(record.displacement, 1e-7 * np.arange(200), atol=1e-15)
    np.testing.assert_allclose(record.voltage, 0.5 * np.arange(200))


def test_a_missing_joint_is_reported(
    robot_bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ['--force', '/ft.wrench.force.z:N', '--displacement', '/joint_states.position[tip]']
    assert main(['import', str(robot_bag), '--out', str(tmp_path / 'bag'), *words]) == 2
    assert 'position.tip' in capsys.readouterr().err
