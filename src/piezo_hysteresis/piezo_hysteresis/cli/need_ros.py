"""Loads a node only when a verb needs it; everything else works without ROS 2."""

from __future__ import annotations

import importlib
from pathlib import Path
from types import ModuleType

from piezo_hysteresis.errors import PiezoError

_NOT_SOURCED = (
    'this verb needs ROS 2 and {} is not there; '
    'run `source setup.bash` at the root of the workspace first'
)

ROS_PACKAGES = ('rclpy', 'piezo_interfaces', 'piezo_ros_common')


def node_module(name: str) -> ModuleType:
    """Return a module of the room `nodes`.

    Raises
    ------
    PiezoError
        If ROS 2 or the built workspace is not there.
    """
    return ros_module(f'piezo_hysteresis.nodes.{name}')


def ros_module(name: str) -> ModuleType:
    """Return a module that needs ROS 2.

    Raises
    ------
    PiezoError
        If ROS 2 or the built workspace is not there.
    """
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        missing = (error.name or '').split('.')[0]
        if missing not in ROS_PACKAGES:
            raise
        raise PiezoError(_NOT_SOURCED.format(missing)) from None


def installed(package: str) -> Path:
    """Return the folder that a package of the workspace is installed in.

    Raises
    ------
    PiezoError
        If the workspace is not sourced.
    """
    try:
        from ament_index_python.packages import PackageNotFoundError, get_package_prefix
    except ModuleNotFoundError:
        raise PiezoError(_NOT_SOURCED.format('ament_index_python')) from None
    try:
        return Path(get_package_prefix(package))
    except PackageNotFoundError:
        raise PiezoError(_NOT_SOURCED.format(package)) from None
