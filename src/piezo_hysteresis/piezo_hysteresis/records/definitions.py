"""The messages a record is made of, as text, so that bags need no ROS 2 workspace.

A test compares these texts with ``piezo_interfaces/msg``, so that the two cannot drift apart.
"""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path
from typing import Any

from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records.storage import Topic

STATE = 'piezo_interfaces/msg/ActuatorState'
REFERENCE = 'piezo_interfaces/msg/Reference'
MARKER = 'piezo_interfaces/msg/RecordMarker'
COMMAND = 'piezo_interfaces/msg/VoltageCommand'

MESSAGES = {
    STATE: """\
std_msgs/Header header
uint64 sample          # number of the tick [1]
float64 voltage        # commanded voltage of this tick [V]
float64 displacement   # measured at this tick, before the voltage acts [m]
""",
    REFERENCE: """\
std_msgs/Header header
uint64 sample          # number of the tick [1]
float64 displacement   # desired displacement [m]
float64 velocity       # its first derivative [m/s]
float64 acceleration   # its second derivative [m/s^2]
float64 frequency      # fundamental frequency, 0 where there is none [Hz]
float64 phase          # accumulated phase of the fundamental [rad]
""",
    MARKER: """\
std_msgs/Header header
string record          # name of the record; empty: the record before ends
string actuator        # name of the actuator
string excitation      # kind of waveform
float64 frequency      # fundamental frequency, 0 where there is none [Hz]
float64 amplitude      # amplitude of the commanded input [V]
float64 warm_up        # time at the start that errors leave out [s]
float64 rate           # sampling rate [Hz]
string input_unit      # V for voltage, N for force
""",
    COMMAND: """\
std_msgs/Header header
uint64 sample          # number of the tick it is meant for [1]
float64 voltage        # [V]
""",
}


@cache
def typestore() -> Any:
    """Return the rosbags type store of Jazzy with our messages."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    for name, text in MESSAGES.items():
        store.register(get_types_from_msg(text, name))
    return store


def definition_of(msgtype: str) -> tuple[str, str]:
    """Return the definition with all it depends on, and the type hash (RIHS01).

    Types that are neither ours nor common are searched in the sourced ROS 2 prefixes.
    """
    store = typestore()
    _register_from_prefixes(store, msgtype)
    text, _ = store.generate_msgdef(msgtype, ros_version=2)
    return text, store.hash_rihs01(msgtype)


@cache
def store_of(topic: Topic) -> Any:
    """Return the type store of a bag's own definition of a topic."""
    from rosbags.typesys import (
        Stores,
        TypesysError,
        get_types_from_idl,
        get_types_from_msg,
        get_typestore,
    )

    if not topic.definition:
        raise RecordError(f'the bag holds no definition of {topic.msgtype}')
    store = get_typestore(Stores.EMPTY)
    try:
        if topic.encoding == 'ros2idl':
            types = get_types_from_idl(topic.definition)
        else:
            types = get_types_from_msg(topic.definition, topic.msgtype)
        store.register(types)
        type_hash = store.hash_rihs01(topic.msgtype)
    except (TypesysError, KeyError, ValueError, TypeError) as error:
        reason = f'the stored definition of {topic.msgtype} cannot be read ({error})'
        raise RecordError(reason) from None
    if topic.type_hash not in ('', type_hash):
        raise RecordError(f'the stored definition of {topic.msgtype} does not agree with its hash')
    return store


def _register_from_prefixes(store: Any, msgtype: str) -> None:
    from rosbags.typesys import get_types_from_msg

    if msgtype in store.fielddefs:
        return
    found = get_types_from_msg(_installed_text(msgtype), msgtype)
    for needed in _types_needed(found[msgtype][1]):
        _register_from_prefixes(store, needed)
    store.register(found)


def _installed_text(msgtype: str) -> str:
    package, _, name = msgtype.partition('/msg/')
    prefixes = os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)
    for prefix in filter(None, prefixes):
        path = Path(prefix) / 'share' / package / 'msg' / f'{name}.msg'
        if name and path.is_file():
            return path.read_text('utf-8')
    raise RecordError(
        f'the definition of {msgtype} was not found; source the workspace that holds it'
    )


def _types_needed(fields: Any) -> list[str]:
    """Return the message types among field descriptions of rosbags (nested tuples)."""
    from rosbags.interfaces import Nodetype

    needed = []
    for _, (kind, detail) in fields:
        if kind == Nodetype.NAME:
            needed.append(detail)
        elif kind in (Nodetype.ARRAY, Nodetype.SEQUENCE) and detail[0][0] == Nodetype.NAME:
            needed.append(detail[0][1])
    return needed
