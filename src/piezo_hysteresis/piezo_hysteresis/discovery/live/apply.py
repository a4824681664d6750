"""What was found, under the names of the simulator node, so that a running simulator gets it too.

Each block says itself which numbers of the simulator mean the same as its own. What has no
counterpart there is left out and named.
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
        Blocks of the model that the simulator has no counterpart of.
    """

    values: SimulatorValues
    missing: tuple[str, ...]

    def to_ros(self) -> dict[str, object]:
        """Return what ``ros2 param load NODE FILE`` reads."""
        return {'/**': {'ros__parameters': dict(self.values)}}


def simulator_parameters(found: ModelFile) -> SimulatorParameters:
    """Return the model of `found` under the simulator's own parameter names."""
    values: SimulatorValues = {}
    missing = []
    used: set[str] = set()
    model = found.model
    for block in (part for each in model.blocks for part in each.parts or (each,)):
        name = block.name
        if block.counterpart is None or name in used:
            missing.append(name)
            continue
        # A strain is counted against the gain of the actuator there.
        gain = {'A1': found.values['A1']} if 'A1' in found.values else {}
        try:
            values.update(block.counterpart({**gain, **model.block_values(found.values, name)}))
        except KeyError:  # a model without such a gain
            missing.append(name)
            continue
        used.add(name)
    return SimulatorParameters(values, tuple(missing))
