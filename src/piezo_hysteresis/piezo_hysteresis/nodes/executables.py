"""The nodes as executables: ``ros2 run piezo_hysteresis feedforward`` and so on."""

from __future__ import annotations

from collections.abc import Callable

from piezo_hysteresis.ros.starting import node_executable

# Folder of each node; a node is imported only by its own process.
_FOLDERS = {
    **dict.fromkeys(('feedforward', 'attenuation', 'feedback', 'control_loop'), 'links.'),
    **dict.fromkeys(('recorder', 'player'), 'recording.'),
    'dashboard': 'dashboard.',
    'excitation': 'excitation.',
}


def __getattr__(name: str) -> Callable[[], None]:
    """Return the entry point of the node `name`; which there are is said in setup.py."""
    if name.startswith('_'):
        raise AttributeError(name)
    module = f'{__package__}.{_FOLDERS.get(name, "")}{name}'
    return node_executable(module, 'piezo_hysteresis.parameters.sheets')
