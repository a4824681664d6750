"""How the middleware is set up, where the user has not done it."""

from __future__ import annotations

import os
from importlib.resources import files
from pathlib import Path

import rclpy
from rclpy.context import Context

# Names the file of profiles that Fast DDS reads when the first node of a process is created.
PROFILES = 'FASTRTPS_DEFAULT_PROFILES_FILE'


def profiles(name: str = '') -> str:
    """Return the path of profiles that come with this package, for the Fast DDS at hand."""
    chosen = name or ('fastdds3.xml' if _has_fast_dds_3() else 'fastdds.xml')
    return str(files('piezo_hysteresis.ros') / chosen)


def _has_fast_dds_3() -> bool:
    """Return whether the sourced ROS 2 has Fast DDS 3, from Kilted on: its library was renamed."""
    places = os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)
    libraries = ('lib/libfastdds.so*', 'lib/*-linux-gnu/libfastdds.so*')
    return any(any(Path(each).glob(name)) for each in places if each for name in libraries)


def prepare() -> None:
    """Configure discovery of this process within a fraction of a second; call before `init`.

    By default Fast DDS announces a process every three seconds, and sends heartbeats at the same
    rate. A profile file of the user has priority; other middleware ignores the setting.
    """
    os.environ.setdefault(PROFILES, profiles())


def joined(domain: int | None = None) -> Context:
    """Return a separate context in a domain, in addition to that of the process."""
    prepare()
    context = Context()
    rclpy.init(args=[], context=context, domain_id=domain)
    return context
