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
    """Return the topic beside that of a voltage: how fast its sender lets it change [V/s].

    0 is any. A receiver keeps to it also where commands come late.
    """
    return f'{voltage}/slew'
