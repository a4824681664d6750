"""The relative names under which the nodes meet; remap or put them in a namespace as usual."""

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
