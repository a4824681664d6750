"""The parameter table of the live page; knows no ROS."""

from __future__ import annotations

from piezo_ros_common.table import ParameterSpec, ParameterTable

# Of the page and of the discovery node, wherever they are started: no folder of sources fills up.
RESULTS = '~/piezo_hysteresis'

DASHBOARD = ParameterTable(
    (
        ParameterSpec(
            'actuators',
            [''],
            'Namespaces of the actuators; where none is given, its own, or all that are found.',
            read_only=True,
        ),
        ParameterSpec(
            'folder', RESULTS, 'Folder for recorded sweeps and discoveries; reports in it are '
            'served.', read_only=True,
        ),
        ParameterSpec(
            'port', 5006, 'Where the page is served; 0 takes a free port.', low=0, high=65535,
            read_only=True,
        ),
        ParameterSpec(
            'address', '127.0.0.1', 'Address it listens at; others than this machine see it only '
            'at another one, and can then move the actuator.', read_only=True,
        ),
        ParameterSpec(
            'origins', [''], 'Further HOST:PORT that browsers may open the page as.',
            read_only=True,
        ),
        ParameterSpec(
            'token', '', 'What a reader has to show once, as ?token=... behind the address; '
            'empty: nothing. At least 16 characters.', read_only=True,
        ),
        ParameterSpec('refresh', 10.0, 'How often it is drawn.', 'Hz', 1.0, 30.0, read_only=True),
    )
)  # fmt: skip
