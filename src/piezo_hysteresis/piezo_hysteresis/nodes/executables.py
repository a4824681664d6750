"""The nodes as executables: ``ros2 run piezo_hysteresis feedforward`` and so on."""

from __future__ import annotations

from piezo_ros_common.starting import node_executable

NODES = (
    'attenuation',
    'control_loop',
    'dashboard',
    'discovery',
    'excitation',
    'feedback',
    'feedforward',
    'gap_monitor',
    'identification',
    'player',
    'recorder',
)

globals().update({name: node_executable(f'{__package__}.{name}') for name in NODES})
