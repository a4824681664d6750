"""Purpose, topics, services and actions of each node, the source of its page and ``--help``.

This file knows no ROS, so that a node answers ``--help`` without starting.
"""

from __future__ import annotations

from piezo_hysteresis.common import topics
from piezo_hysteresis.common.node_sheet import NodeSheet
from piezo_hysteresis.common.parameter_table import ParameterTable
from piezo_hysteresis.parameters import node_tables


def _inside() -> dict[str, ParameterTable]:
    nodes = {
        'excitation': node_tables.EXCITATION,
        'feedforward': node_tables.FEEDFORWARD,
        'attenuation': node_tables.ATTENUATION,
        'feedback': node_tables.FEEDBACK,
        'recorder': node_tables.RECORDER,
        'coupled': node_tables.COUPLED,
        'voltage_1': node_tables.VOLTAGE,
    }
    return {f'of {name} (-p {name}:NAME:=VALUE)': table for name, table in nodes.items()}


def _command_topics(voltage: str) -> tuple[str, str]:
    """Return the topics of a voltage and of how fast it may change."""
    return voltage, topics.slew_of(voltage)


_ALL = (
    NodeSheet(
        'excitation',
        'Publishes the reference (or open-loop voltage) of tick k + 1 after the state of tick '
        'k, and runs sweeps, one record per frequency and amplitude. It records a sweep that '
        'names a bag; a record with a lost state is repeated. Voltages beyond the range '
        'in `loop/status` are refused before the first sample.',
        node_tables.EXCITATION,
        subscribes=(
            topics.STATE,
            topics.LOOP_STATUS,
            topics.slew_of(topics.VOLTAGE_COMMAND),
            '/diagnostics',
        ),
        publishes=(
            topics.REFERENCE,
            *_command_topics(topics.VOLTAGE_COMMAND),
            topics.MARKER,
            '/diagnostics',
        ),
        actions=('run_sweep',),
    ),
    NodeSheet(
        'feedforward',
        'First controller of the voltage chain: computes the voltage for the reference by the '
        'inverse of the loaded model. Without a model it divides by `gain`, which compensates '
        'nothing. It subscribes to the actuator only while it receives no reference.',
        node_tables.FEEDFORWARD,
        subscribes=(topics.REFERENCE, topics.ESTIMATE, topics.STATE),
        publishes=(*_command_topics(topics.VOLTAGE_FEEDFORWARD), '~/status', '/diagnostics'),
        services=('~/load_model', '~/use_estimate'),
        managed=True,
        model=True,
    ),
    NodeSheet(
        'attenuation',
        'Second controller of the voltage chain: suppresses harmonics of the tracking error.',
        node_tables.ATTENUATION,
        subscribes=(topics.REFERENCE, topics.STATE, topics.VOLTAGE_FEEDFORWARD),
        publishes=(
            *_command_topics(topics.VOLTAGE_COMMAND),
            topics.HARMONICS,
            '~/status',
            '/diagnostics',
        ),
        services=('~/load_model', '~/reset'),
        managed=True,
    ),
    NodeSheet(
        'feedback',
        'Optional controller of the voltage chain: PID, fuzzy PID or H-infinity on the '
        'tracking error. It uses the topics of `attenuation`; remap them to place it before '
        'or after that node.',
        node_tables.FEEDBACK,
        subscribes=(topics.REFERENCE, topics.STATE, topics.VOLTAGE_FEEDFORWARD),
        publishes=(*_command_topics(topics.VOLTAGE_COMMAND), '~/status', '/diagnostics'),
        services=('~/load_model', '~/reset'),
        managed=True,
    ),
    NodeSheet(
        'control_loop',
        'Runs `excitation`, `feedforward`, `attenuation` and `feedback` in one process, and a '
        '`recorder` if it is given a bag (`-p recorder:out:=FOLDER`), each with its own name, '
        'parameters and lifecycle: `-p attenuation:orders:=[3]` sets one of them. Reference and '
        'voltage are forwarded within the process before they are published. The reference of '
        'another process is followed while the excitation publishes none. With a model of '
        'several axes (`-p coupled:model_file:=model.yaml`) it runs `coupled`, which decouples '
        'and attenuates all of them, and of each axis `excitation_1`, `voltage_1`, ... with the '
        'topics of the axis below `axis_1/`: see [axes.md](axes.md).',
        ParameterTable(()),
        subscribes=(
            topics.REFERENCE,
            topics.STATE,
            topics.ESTIMATE,
            topics.LOOP_STATUS,
            topics.slew_of(topics.VOLTAGE_COMMAND),
            '/diagnostics',
        ),
        publishes=(
            topics.REFERENCE,
            topics.MARKER,
            *_command_topics(topics.VOLTAGE_FEEDFORWARD),
            *_command_topics(topics.VOLTAGE_ATTENUATED),
            *_command_topics(topics.VOLTAGE_COMMAND),
            topics.HARMONICS,
            '/diagnostics',
        ),
        actions=('run_sweep',),
        more=_inside,
    ),
    NodeSheet(
        'identification',
        'Estimates the parameters of the extended model online by recursive least squares.',
        node_tables.IDENTIFICATION,
        subscribes=(topics.STATE, topics.MARKER),
        publishes=(topics.ESTIMATE, '~/status', '/diagnostics'),
        services=('~/reset', '~/save'),
    ),
    NodeSheet(
        'gap_monitor',
        'Simulates the loaded model in parallel with the actuator and publishes the residual '
        'in multiples of the noise floor and by harmonic.',
        node_tables.GAP_MONITOR,
        subscribes=(topics.STATE,),
        publishes=(topics.GAP, '/diagnostics'),
        services=('~/load_model', '~/reset'),
        model=True,
    ),
    NodeSheet(
        'gcs_driver',
        'Runs sweeps in a piezo controller, at the rate of its servo, instead of excitation, '
        'recorder and actuator: see [controllers.md](controllers.md). Each sweep becomes a bag '
        'below `folder`. `actuator/state` is for monitoring, at `monitor_rate`. Connecting moves '
        'nothing; a cancel, a shutdown and a loss stop the wave and ramp to 0 V.',
        node_tables.GCS_DRIVER,
        publishes=(topics.STATE, '/diagnostics'),
        actions=('run_sweep',),
    ),
    NodeSheet(
        'dashboard',
        'Serves the live page: see [dashboard.md](dashboard.md). It subscribes to the topics '
        'of every displayed actuator through nodes `dashboard_listener`, and is a client of '
        'the parameters and actions of the other nodes.',
        node_tables.DASHBOARD,
        publishes=('/diagnostics',),
        add_options=node_tables.configure,
    ),
    NodeSheet(
        'recorder',
        'Writes topics into a rosbag2 bag that is readable at any time, even after a kill. '
        'Its status contains the number of recorded samples, so that a player can wait for '
        'it.',
        node_tables.RECORDER,
        subscribes=(topics.STATE, topics.REFERENCE, topics.MARKER),
        publishes=('~/status', '/diagnostics'),
    ),
    NodeSheet(
        'player',
        'Plays a bag by the clock or in lock-step with its subscribers. It also publishes the '
        'topics of the bag. It waits for present recorders, so that they receive every sample.',
        node_tables.PLAYER,
        subscribes=('/diagnostics',),
        publishes=('/diagnostics',),
    ),
)

SHEETS = {sheet.executable: sheet for sheet in _ALL}
