"""The relative names under which the nodes meet; remap or put them in a namespace as usual."""

import re
from collections.abc import Iterable

STATE = 'actuator/state'
REFERENCE = 'reference'
VOLTAGE_FEEDFORWARD = 'voltage/feedforward'
VOLTAGE_ATTENUATED = 'voltage/attenuated'
VOLTAGE_COMMAND = 'voltage/command'
ESTIMATE = 'model/estimate'
HARMONICS = 'attenuation/harmonics'
GAP = 'gap'
MARKER = 'record/marker'
LOOP_STATUS = 'loop/status'


def slew_of(voltage: str) -> str:
    """Return the topic of the slew limit of a voltage topic [V/s].

    0 means no limit. A receiver also applies it to late commands.
    """
    return f'{voltage}/slew'


def of_axis(topic: str, axis: int) -> str:
    """Return a topic of one of several axes, counted from 1; 0 is that of the only one."""
    return f'axis_{axis}/{topic}' if axis else topic


def nodes_of(actuator: str, every: Iterable[str]) -> dict[str, str]:
    """Return the full names of the nodes of an actuator by the names without namespace.

    The nodes of one of several axes are those next to its namespace: ``excitation_2`` is the
    ``excitation`` of ``axis_2``, and what has no number is of all axes.
    """
    space, _, axis = actuator.rpartition('/')
    number = re.fullmatch(r'axis_(\d+)', axis)
    own = (space if number else actuator).strip('/')
    found = {}
    for full in every:
        folder, _, name = full.rpartition('/')
        if folder.strip('/') != own:
            continue
        of_one = re.fullmatch(r'(.+)_(\d+)', name) if number else None
        if of_one is None:
            found[name] = full
        elif number and of_one[2] == number[1]:
            found[of_one[1]] = full
    return found
