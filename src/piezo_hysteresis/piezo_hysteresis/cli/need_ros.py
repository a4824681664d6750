"""Loads a node only when a verb needs it; everything else works without ROS 2."""

from __future__ import annotations

import importlib
from types import ModuleType

from piezo_hysteresis.errors import PiezoError

ROS_PACKAGES = ('rclpy', 'piezo_interfaces', 'piezo_ros_common')


def node_module(name: str) -> ModuleType:
    """Return a module of the room `nodes`.

    Raises
    ------
    PiezoError
        If ROS 2 or the built workspace is not there.
    """
    try:
        return importlib.import_module(f'piezo_hysteresis.nodes.{name}')
    except ModuleNotFoundError as error:
        missing = (error.name or '').split('.')[0]
        if missing not in ROS_PACKAGES:
            raise
        raise PiezoError(
            f'this verb needs ROS 2 and {missing} is not there; '
            'run `source setup.bash` at the root of the workspace first'
        ) from None
