"""The nodes as executables: ``ros2 run piezo_hysteresis feedforward`` and so on."""

from __future__ import annotations

from collections.abc import Callable

from piezo_ros_common.starting import node_executable


def __getattr__(name: str) -> Callable[[], None]:
    """Return the entry point of the node `name`; which there are is said in setup.py."""
    if name.startswith('_'):
        raise AttributeError(name)
    return node_executable(f'{__package__}.{name}')
