"""Parameters of the simulator node for a found model, so that a running simulator can use it.

Each block defines the equivalent parameters of the simulator. Blocks without an equivalent are
omitted and listed.
"""

from __future__ import annotations

from dataclasses import dataclass

from piezo_hysteresis.blocks._counterpart import SimulatorValues
from piezo_hysteresis.models import ModelFile


@dataclass(frozen=True)
class SimulatorParameters:
    """Parameters for the simulator node.

    Attributes
    ----------
    values : dict
        Parameter name to value.
    missing : tuple of str
        Blocks of the model without an equivalent in the simulator.
    """

    values: SimulatorValues
    missing: tuple[str, ...]

    def to_ros(self) -> dict[str, object]:
        """Return the content of a parameter file for ``ros2 param load NODE FILE``."""
        return {'/**': {'ros__parameters': dict(self.values)}}


def simulator_parameters(found: ModelFile) -> SimulatorParameters:
    """Return the model of `found` with the parameter names of the simulator."""
    values: SimulatorValues = {}
    missing = []
    used: set[str] = set()
    model = found.model
    for block in (part for each in model.blocks for part in each.parts or (each,)):
        name = block.name
        if block.counterpart is None or name in used:
            missing.append(name)
            continue
        # The simulator normalizes strain by the gain of the actuator.
        gain = {'A1': found.values['A1']} if 'A1' in found.values else {}
        try:
            values.update(block.counterpart({**gain, **model.block_values(found.values, name)}))
        except KeyError:  # a model without such a gain
            missing.append(name)
            continue
        used.add(name)
    return SimulatorParameters(values, tuple(missing))
