"""How the middleware is set up, where the user has not done it."""

from __future__ import annotations

import os
from importlib.resources import files

import rclpy
from rclpy.context import Context

# Names the file of profiles that Fast DDS reads when the first node of a process is created.
PROFILES = 'FASTRTPS_DEFAULT_PROFILES_FILE'


def profiles(name: str = 'fastdds.xml') -> str:
    """Return the path of profiles that come with this package."""
    return str(files('piezo_hysteresis.ros') / name)


def prepare() -> None:
    """Let nodes of this process be found within a fraction of a second; call before `init`.

    By itself Fast DDS announces a process every three seconds, and asks as seldom whether a
    message has arrived. A file that the user has named is left in place, and other middleware
    does not read it.
    """
    os.environ.setdefault(PROFILES, profiles())


def joined(domain: int | None = None) -> Context:
    """Return a context of its own in a domain, for nodes beside those of the process."""
    prepare()
    context = Context()
    rclpy.init(args=[], context=context, domain_id=domain)
    return context
