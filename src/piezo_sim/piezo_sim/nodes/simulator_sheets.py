"""Purpose and interfaces of the simulator node, for ``--help`` and documents."""

from __future__ import annotations

from piezo_hysteresis.common import topics
from piezo_hysteresis.common.node_sheet import NodeSheet
from piezo_hysteresis.common.parameter_table import ParameterTable
from piezo_sim.nodes.simulator_tables import plant_table, simulator_table
from piezo_sim.plant import Plant


def _plant() -> dict[str, ParameterTable]:
    preset = str(simulator_table().defaults()['preset'])
    return {
        f'of the plant, as the preset {preset} has them': plant_table(Plant.from_preset(preset))
    }


SHEETS = {
    'simulator': NodeSheet(
        'simulator',
        'Simulates the actuator, its amplifier and its sensor. Every effect of the plant has '
        'a switch `effects.NAME` and parameters, all tunable at run time: see '
        '[simulator.md](simulator.md).',
        simulator_table(),
        subscribes=(
            topics.VOLTAGE_COMMAND,
            topics.slew_of(topics.VOLTAGE_COMMAND),
            '/diagnostics',
        ),
        publishes=(topics.STATE, topics.LOOP_STATUS, '/diagnostics'),
        services=('~/load_preset', '~/reset', '~/inject_fault'),
        more=_plant,
    )
}
