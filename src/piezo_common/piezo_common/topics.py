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
