"""What each node is for and what it speaks: its page, its ``--help`` and the policy come from it.

This file knows no ROS, so that a node answers ``--help`` without starting.
"""

from __future__ import annotations

from piezo_hysteresis.common import topics
from piezo_hysteresis.common.sheet import NodeSheet
from piezo_hysteresis.common.table import ParameterTable
from piezo_hysteresis.parameters import dashboard, tables


def _links() -> dict[str, ParameterTable]:
    links = {
        'feedforward': tables.FEEDFORWARD,
        'attenuation': tables.ATTENUATION,
        'feedback': tables.FEEDBACK,
    }
    return {f'of {name} (-p {name}:NAME:=VALUE)': table for name, table in links.items()}


def _told(voltage: str) -> tuple[str, str]:
    """Return the topics of a voltage and of how fast it may change."""
    return voltage, topics.slew_of(voltage)


_ALL = (
    NodeSheet(
        'excitation',
        'Answers the state of tick k with the reference (or open-loop voltage) of tick k + 1, and '
        'runs sweeps, one record per frequency and amplitude. It finds the recorders by itself: a '
        'record begins once each has confirmed its marker, counts once each has all its samples, '
        'and is run again where one missed some. Voltages beyond what the actuator says in '
        '`loop/status` that it takes are refused before the first sample.',
        tables.EXCITATION,
        subscribes=(topics.STATE, topics.LOOP_STATUS, '/diagnostics'),
        publishes=(
            topics.REFERENCE,
            *_told(topics.VOLTAGE_COMMAND),
            topics.MARKER,
            '/diagnostics',
        ),
        actions=('run_sweep',),
    ),
    NodeSheet(
        'feedforward',
        'First link of the voltage chain: the voltage that the loaded model says the reference '
        'takes. Without a model it divides by `gain`, which is no compensation. It hears the '
        'actuator only while no reference comes.',
        tables.FEEDFORWARD,
        subscribes=(topics.REFERENCE, topics.ESTIMATE, topics.STATE),
        publishes=(*_told(topics.VOLTAGE_FEEDFORWARD), '~/status', '/diagnostics'),
        services=('~/load_model', '~/use_estimate'),
        managed=True,
        model=True,
    ),
    NodeSheet(
        'attenuation',
        'Second link of the voltage chain: takes harmonics of the tracking error off.',
        tables.ATTENUATION,
        subscribes=(topics.REFERENCE, topics.STATE, topics.VOLTAGE_FEEDFORWARD),
        publishes=(*_told(topics.VOLTAGE_COMMAND), topics.HARMONICS, '~/status', '/diagnostics'),
        services=('~/load_model', '~/reset'),
        managed=True,
    ),
    NodeSheet(
        'feedback',
        'Optional link of the voltage chain: PID, fuzzy PID or H-infinity on the tracking error. '
        'It speaks the topics of `attenuation`; remap them to put it behind or in front of it.',
        tables.FEEDBACK,
        subscribes=(topics.REFERENCE, topics.STATE, topics.VOLTAGE_FEEDFORWARD),
        publishes=(*_told(topics.VOLTAGE_COMMAND), '~/status', '/diagnostics'),
        services=('~/load_model', '~/reset'),
        managed=True,
    ),
    NodeSheet(
        'control_loop',
        'Holds `feedforward`, `attenuation` and `feedback` in one process, each with its own '
        'name, parameters and life cycle: `-p attenuation:orders:=[3]` sets one of them. The '
        'voltage goes on within the process before it is published.',
        ParameterTable(()),
        subscribes=(topics.REFERENCE, topics.STATE, topics.ESTIMATE),
        publishes=(
            *_told(topics.VOLTAGE_FEEDFORWARD),
            *_told(topics.VOLTAGE_ATTENUATED),
            *_told(topics.VOLTAGE_COMMAND),
            topics.HARMONICS,
            '/diagnostics',
        ),
        more=_links,
    ),
    NodeSheet(
        'identification',
        'Estimates the parameters of the extended model online by recursive least squares.',
        tables.IDENTIFICATION,
        subscribes=(topics.STATE, topics.MARKER),
        publishes=(topics.ESTIMATE, '~/status', '/diagnostics'),
        services=('~/reset', '~/save'),
    ),
    NodeSheet(
        'gap_monitor',
        'Runs the loaded model beside the actuator and says how far apart they are, in multiples '
        'of the noise floor and by harmonic.',
        tables.GAP_MONITOR,
        subscribes=(topics.STATE,),
        publishes=(topics.GAP, '/diagnostics'),
        services=('~/load_model', '~/reset'),
        model=True,
    ),
    NodeSheet(
        'discovery',
        'Finds what a model misses: in recorded data, as the verb `discover` does, or on the '
        'running actuator, as `investigate` does, by experiments that it chooses, has the '
        'excitation run and records itself. While it records it hears `actuator/state` and '
        '`record/marker`, and its status tells what it has taken.',
        tables.DISCOVERY,
        subscribes=(topics.LOOP_STATUS,),
        publishes=('~/status', '/diagnostics'),
        actions=('discover', 'investigate'),
    ),
    NodeSheet(
        'dashboard',
        'Serves the live page: see [dashboard.md](dashboard.md). It hears the topics of every '
        'actuator that somebody looks at, through nodes `dashboard_recorder` beside it, and is a '
        'client of the parameters and actions of the others.',
        tables.DASHBOARD,
        publishes=('/diagnostics',),
        words=dashboard.configure,
    ),
    NodeSheet(
        'recorder',
        'Writes topics into a rosbag2 bag that is readable at every instant, even after a kill. '
        'Its status tells what it has taken, so that an excitation or a player can wait for it.',
        tables.RECORDER,
        subscribes=(topics.STATE, topics.REFERENCE, topics.MARKER),
        publishes=('~/status', '/diagnostics'),
    ),
    NodeSheet(
        'player',
        'Plays a bag, on time or in lock-step with its listeners. It publishes the topics of the '
        'bag, too. Recorders that are there get every sample: it waits for them.',
        tables.PLAYER,
        subscribes=('/diagnostics',),
        publishes=('/diagnostics',),
    ),
)

SHEETS = {sheet.executable: sheet for sheet in _ALL}
