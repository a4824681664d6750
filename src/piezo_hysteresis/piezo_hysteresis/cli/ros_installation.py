"""Error message for a missing ROS 2 installation; only verbs that run nodes import this module."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from piezo_hysteresis.errors import PiezoError

_NOT_SOURCED = (
    'this verb needs ROS 2 and {} is not there; '
    'run `source setup.bash` at the root of the workspace first'
)

ROS_PACKAGES = (
    'ament_index_python',
    'builtin_interfaces',
    'diagnostic_msgs',
    'lifecycle_msgs',
    'piezo_interfaces',
    'rcl_interfaces',
    'rclpy',
    'rosgraph_msgs',
    'std_msgs',
    'std_srvs',
)


@contextmanager
def ros_needed() -> Iterator[None]:
    """Convert import errors of `nodes` and other ROS 2 modules to one error message."""
    try:
        yield
    except ModuleNotFoundError as error:
        missing = (error.name or '').split('.')[0]
        if missing not in ROS_PACKAGES:
            raise
        raise PiezoError(_NOT_SOURCED.format(missing)) from None


def installed(package: str) -> Path:
    """Return the installation folder of a package of the workspace."""
    try:
        from ament_index_python.packages import PackageNotFoundError, get_package_prefix
    except ModuleNotFoundError:
        raise PiezoError(_NOT_SOURCED.format('ament_index_python')) from None
    try:
        return Path(get_package_prefix(package))
    except PackageNotFoundError:
        raise PiezoError(_NOT_SOURCED.format(package)) from None
