"""Class of the messages of a topic, and the QoS that matches all of its publishers."""

from __future__ import annotations

import importlib
from collections.abc import Sequence

import yaml
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.topic_endpoint_info import TopicEndpointInfo

from piezo_hysteresis.errors import PiezoError


def message_type(name: str) -> type:
    """Return the class of ``package/msg/Name``, or of a service or an action."""
    package, _, rest = name.partition('/')
    room, _, kind = rest.partition('/')
    try:
        found: type = getattr(importlib.import_module(f'{package}.{room or "msg"}'), kind)
    except (ImportError, AttributeError):
        raise PiezoError(
            f'messages of type {name} are not known here: source the workspace that has {package}'
        ) from None
    return found


DEPTH = 20000


def matching(publishers: Sequence[TopicEndpointInfo]) -> QoSProfile:
    """Return the strongest profile that every one of `publishers` can serve."""
    profiles = [publisher.qos_profile for publisher in publishers]
    reliable = all(p.reliability == ReliabilityPolicy.RELIABLE for p in profiles)
    latched = all(p.durability == DurabilityPolicy.TRANSIENT_LOCAL for p in profiles)
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=DEPTH,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


def offered_as_yaml(qos: QoSProfile) -> str:
    """Return a profile in the format of rosbag2, so that players offer the same profile."""
    forever = {'sec': 9223372036, 'nsec': 854775807}
    return str(
        yaml.safe_dump(
            [
                {
                    'history': 'keep_last',
                    'depth': 64,
                    'reliability': qos.reliability.name.lower(),
                    'durability': qos.durability.name.lower(),
                    'deadline': forever,
                    'lifespan': forever,
                    'liveliness': 'automatic',
                    'liveliness_lease_duration': forever,
                    'avoid_ros_namespace_conventions': False,
                }
            ],
            sort_keys=False,
        )
    )
