"""Timers in real time, independent of simulated time."""

from collections.abc import Callable

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.timer import Timer


def wall_timer(node: Node, period: float, callback: Callable[[], None]) -> Timer:
    """Call `callback` every `period` seconds of real time, regardless of ``use_sim_time``."""
    return node.create_timer(period, callback, clock=Clock(clock_type=ClockType.STEADY_TIME))
