"""Sheet and parameter tables of the simulator node; those of the plant come from the plant."""

from __future__ import annotations

from piezo_hysteresis.common import topics
from piezo_hysteresis.common.node_sheet import NodeSheet
from piezo_hysteresis.common.parameter_table import ParameterSpec, ParameterTable
from piezo_sim.axes_plant import FOLDER, AxesPlant
from piezo_sim.plant import Plant
from piezo_sim.presets import preset_names


def simulator_table() -> ParameterTable:
    """Return the parameters of the node itself, before a plant is loaded."""
    return ParameterTable(
        (
            ParameterSpec(
                'preset',
                'fdk_pzba_00030',
                'Simulated actuator, or actuators of several axes; setting it loads all its '
                'parameters, at rest.',
            ),
            ParameterSpec(
                'rate', 1000.0, 'Sampling rate.', 'Hz', low=1.0, high=1e5, read_only=True
            ),
            ParameterSpec(
                'clock',
                'real_time',
                'lock_step waits for the command of every tick; real_time runs by the clock.',
                choices=('real_time', 'lock_step'),
                read_only=True,
            ),
            ParameterSpec(
                'speed_factor',
                1.0,
                'Speed of the real_time clock relative to real time.',
                '1',
                above=0.0,
                high=100.0,
            ),
            ParameterSpec(
                'lock_step_deadline',
                5.0,
                'Time without a command after which a lock-step loop is reported as broken.',
                's',
                above=0.0,
                high=3600.0,
            ),
            ParameterSpec(
                'command_timeout',
                0.1,
                'Time without a command after which the voltage ramps to safe_voltage '
                '(real_time).',
                's',
                above=0.0,
                high=3600.0,
            ),
            ParameterSpec(
                'wait_for',
                0,
                'Number of subscribers of the state required before the first tick (lock_step).',
                low=0,
                high=99,
            ),
            ParameterSpec('safe_voltage', 0.0, 'Voltage without commands.', 'V', -500.0, 500.0),
            ParameterSpec(
                'ramp', 1.0, 'Slew of the ramp to safe_voltage.', 'V/s', above=0.0, high=1e6
            ),
            ParameterSpec(
                'command_slew',
                1e9,
                'Slew limit of the applied command, unless voltage/command/slew is lower; '
                'jumps become ramps.',
                'V/s',
                above=0.0,
                high=1e9,
            ),
            ParameterSpec(
                'publish_clock', False, 'Publish simulated time on /clock.', read_only=True
            ),
            ParameterSpec(
                'seed', 0, 'Seed of noise and drop-outs.', low=0, high=2**31 - 1, read_only=True
            ),
        )
    )


def plant_of(preset: str, rate: float | None = None, seed: int = 0) -> Plant | AxesPlant:
    """Return the actuator, or the actuators of several axes, of a preset."""
    kind = AxesPlant if preset in preset_names(FOLDER) else Plant
    return kind.from_preset(preset, rate, seed)


def axes_of(plant: Plant | AxesPlant) -> list[Plant]:
    """Return the plant of each axis."""
    return [plant] if isinstance(plant, Plant) else plant.plants


def plant_table(plant: Plant | AxesPlant) -> ParameterTable:
    """Return a row for every parameter and switch of `plant`, with its value as default."""
    values = plant.parameters
    parts: list[tuple[str, Plant | AxesPlant]] = [('', plant)]
    if isinstance(plant, AxesPlant):
        parts += [(f'axis_{i}.', each) for i, each in enumerate(plant.plants, 1)]
    numbers = [
        ParameterSpec(
            own + row.name, float(values[own + row.name]), row.description, row.unit, row.low,
            row.high,
        )
        for own, part in parts
        for row in part.parameter_table
    ]  # fmt: skip
    switches = [
        ParameterSpec(
            f'{own}effects.{effect.name}', bool(values[f'{own}effects.{effect.name}']),
            effect.description,
        )
        for own, part in parts
        for effect in part.effect_table
    ]  # fmt: skip
    return ParameterTable((*numbers, *switches))


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
        '[simulator.md](simulator.md). A preset of several axes has the topics of each below '
        '`axis_1/`, `axis_2/`, ... with equal stamps, and parameters such as '
        '`axis_1.effects.creep`: see [axes.md](axes.md).',
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
