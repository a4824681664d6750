"""QoS that a subscriber needs to match all publishers of a topic."""

from __future__ import annotations

from collections.abc import Sequence

import yaml
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.topic_endpoint_info import TopicEndpointInfo

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
    """Return a profile as rosbag2 stores it, so that players offer the same again."""
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
