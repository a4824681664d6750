"""The node that excites the actuator: references, voltages, sweeps."""
