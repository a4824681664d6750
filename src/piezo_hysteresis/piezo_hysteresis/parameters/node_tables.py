"""The parameter tables of the nodes; independent of ROS, for documentation and checks."""

from __future__ import annotations

import argparse

from piezo_hysteresis.common.parameter_table import ParameterSpec, ParameterTable
from piezo_hysteresis.parameters.links import (
    ATTENUATION,
    COUPLED,
    FEEDBACK,
    FEEDFORWARD,
    MODEL_FOLDER,
    RATE,
    VOLTAGE,
)
from piezo_hysteresis.waveforms import KINDS

__all__ = [
    'ATTENUATION',
    'COUPLED',
    'DASHBOARD',
    'EXCITATION',
    'FEEDBACK',
    'FEEDFORWARD',
    'GAP_MONITOR',
    'GCS_DRIVER',
    'IDENTIFICATION',
    'PLAYER',
    'RECORDER',
    'VOLTAGE',
]

# Of the page and the excitation; not the working directory, which may hold sources.
RESULTS = '~/piezo_hysteresis'

DASHBOARD = ParameterTable(
    (
        ParameterSpec(
            'actuators',
            [''],
            'Namespaces of the actuators; by default its own, or all that are found.',
            read_only=True,
        ),
        ParameterSpec(
            'folder',
            RESULTS,
            'Folder for recorded sweeps and discoveries; reports in it are served.',
            read_only=True,
        ),
        ParameterSpec(
            'port',
            5006,
            'Port of the page; 0 selects a free port.',
            low=0,
            high=65535,
            read_only=True,
        ),
        ParameterSpec(
            'address',
            '127.0.0.1',
            'Address to listen on; with another address, other '
            'machines can open the page and move the actuator.',
            read_only=True,
        ),
        ParameterSpec(
            'origins', [''], 'Additional HOST:PORT names of the page for browsers.', read_only=True
        ),
        ParameterSpec(
            'token',
            '',
            'Token that a browser must send once, as ?token=... in the address, '
            'at least 16 characters; empty requires none.',
            read_only=True,
        ),
        ParameterSpec(
            'refresh', 10.0, 'Refresh rate of the plots.', 'Hz', 1.0, 30.0, read_only=True
        ),
    )
)


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the words of the verb and of the executable ``dashboard``."""
    parser.add_argument('--namespace', help='namespace of the actuator (default: all)')
    parser.add_argument(
        '--folder', help='folder for sweeps, discoveries and reports (default: ~/piezo_hysteresis)'
    )
    parser.add_argument(
        '--port', type=int, help='port of the page, 0 for a free one (default: 5006)'
    )
    parser.add_argument(
        '--address',
        help='address to listen on (default: 127.0.0.1); any other gives other machines access',
    )


EXCITATION = ParameterTable(
    (
        RATE,
        ParameterSpec(
            'mode',
            'idle',
            'Published signal: a reference, an open-loop voltage, or nothing.',
            choices=('idle', 'reference', 'voltage'),
        ),
        ParameterSpec('actuator', '', 'Name written into the markers of recorded sweeps.'),
        ParameterSpec('waveform', 'sine', 'Shape of the signal.', choices=tuple(KINDS)),
        ParameterSpec(
            'waveform_options',
            '',
            'Further settings of the waveform as YAML: {seed: 3}; `ros2 param set` needs two '
            'pairs of quotes, "\'{seed: 3}\'".',
        ),
        ParameterSpec('frequency', 1.0, 'Fundamental frequency.', 'Hz', 0.0, 1e4),
        ParameterSpec('reference.amplitude', 5e-5, 'Amplitude of the reference.', 'm', 0.0, 0.01),
        ParameterSpec('reference.offset', 0.0, 'Mean of the reference.', 'm', -0.01, 0.01),
        ParameterSpec('voltage.amplitude', 1.0, 'Amplitude of the voltage.', 'V', 0.0, 500.0),
        ParameterSpec('voltage.offset', 0.0, 'Mean of the voltage.', 'V', -500.0, 500.0),
        ParameterSpec('ramp', 1.0, 'Smooth rise of the amplitude at the start.', 's', 0.0, 60.0),
        ParameterSpec(
            'slew',
            0.0,
            'Slew limit of sweeps and of mode voltage, also if commands are late; the limit of a '
            'running chain stands too; 0 adds none.',
            'V/s',
            0.0,
            1e12,
        ),
        ParameterSpec('duration', 0.0, 'Length of the experiment; 0 is unlimited.', 's', 0.0, 1e6),
        ParameterSpec(
            'wait_for', 0, 'Number of subscribers required before the first tick.', low=0, high=99
        ),
        ParameterSpec(
            'marker_listeners',
            0,
            'Minimum number of subscribers of record/marker before a sweep starts.',
            low=0,
            high=99,
        ),
        ParameterSpec('folder', RESULTS, 'Folder in which sweeps are recorded.', read_only=True),
        ParameterSpec('exit_when_done', False, 'End the process when the experiment ends.'),
        ParameterSpec(
            'deadline',
            10.0,
            'Time without a state of the actuator after which the experiment is aborted.',
            's',
            above=0.0,
            high=3600.0,
        ),
    )
)

IDENTIFICATION = ParameterTable(
    (
        RATE,
        ParameterSpec(
            'method',
            'rls',
            'rls is Fujii 2018 (8)-(12); rls_ud and pi_bank are well-posed: Bouc-Wen or a play '
            'bank.',
            choices=('rls', 'rls_ud', 'pi_bank'),
        ),
        ParameterSpec(
            'forgetting',
            0.0,
            'Forgetting factor; 1 weights all samples equally, 0 uses the default of the method.',
            '1',
            0.0,
            1.0,
        ),
        ParameterSpec(
            'publish_every', 500, 'Samples between two estimates.', '1', low=1, high=1000000
        ),
        ParameterSpec('only_records', True, 'Ignore samples between the records of a sweep.'),
        ParameterSpec(
            'per_frequency',
            False,
            'Keep one estimate for each drive, frequency and amplitude, that the markers of a '
            'sweep state; ~/save writes all of them.',
        ),
        MODEL_FOLDER,
        ParameterSpec(
            'variant',
            'V1',
            'rls: V1 is Fujii 2018 (3), V0 is Fujii 2018 (10), V2 is Tatebatake 2017 (10) as '
            'printed, basic is Tatebatake 2017 (18).',
            choices=('V0', 'V1', 'V2', 'basic'),
        ),
        ParameterSpec(
            'offset',
            False,
            'rls: an additional constant column, equivalent to A0 in steady state; identify '
            'has none and estimates the offset from free runs.',
        ),
        ParameterSpec(
            'harmonic',
            0,
            'rls: exogenous odd harmonic: 0, 3 or 5; with per_frequency, 0 takes that of the '
            'spectrum of each record, as identify does.',
            low=0,
            high=5,
        ),
        ParameterSpec(
            'frequency',
            0.0,
            'rls: fundamental frequency of the harmonic until the marker of a record states it.',
            'Hz',
            0.0,
            1e4,
        ),
        ParameterSpec(
            'p0', 1.0, 'rls: initial P as a multiple of the identity.', '1', above=0.0, high=1e12
        ),
        ParameterSpec(
            'start',
            [''],
            'rls: initial values NAME=VALUE in SI units; others are those of the papers.',
        ),
        ParameterSpec(
            'unit',
            'mm',
            'rls: unit of the recursion; relevant with P0 = I.',
            choices=('m', 'mm', 'um', 'nm'),
        ),
        ParameterSpec(
            'voltage_range',
            1.0,
            'rls_ud, pi_bank: largest absolute voltage.',
            'V',
            above=0.0,
            high=500.0,
        ),
        ParameterSpec(
            'displacement_range',
            1e-4,
            'rls_ud, pi_bank: displacement at voltage_range, to an order of magnitude.',
            'm',
            above=0.0,
            high=0.01,
        ),
        ParameterSpec(
            'natural_frequency',
            0.0,
            'rls_ud, pi_bank: frequency of the fixed mode; 0 omits it.',
            'Hz',
            0.0,
            1e5,
        ),
        ParameterSpec(
            'damping_ratio',
            0.02,
            'rls_ud, pi_bank: damping ratio of the fixed mode.',
            '1',
            above=0.0,
            high=10.0,
        ),
        ParameterSpec(
            'quiet',
            0.01,
            'rls_ud, pi_bank: rate of the voltage below which parameters are not updated, in '
            'ranges per s.',
            '1/s',
            0.0,
            100.0,
        ),
    )
)

RECORDER = ParameterTable(
    (
        ParameterSpec('out', '', 'Bag folder to create.', read_only=True),
        ParameterSpec(
            'topics',
            [''],
            'Topics to record; by default state, reference and markers.',
            read_only=True,
        ),
    )
)

PLAYER = ParameterTable(
    (
        ParameterSpec('bag', '', 'Bag folder, .mcap or .db3 file to play.', read_only=True),
        ParameterSpec('topics', [''], 'Topics to play; by default all.', read_only=True),
        ParameterSpec(
            'rate_factor',
            1.0,
            'Speed relative to the recording.',
            '1',
            above=0.0,
            high=1e6,
            read_only=True,
        ),
        ParameterSpec('loop', False, 'Restart at the end.', read_only=True),
        ParameterSpec(
            'lock_step',
            False,
            'Play at the rate at which subscribers process the samples.',
            read_only=True,
        ),
        ParameterSpec(
            'salvage', False, 'Play the readable part of a damaged bag.', read_only=True
        ),
        ParameterSpec('publish_clock', False, 'Publish log times on /clock.', read_only=True),
        ParameterSpec('wait', 10.0, 'Longest wait for a subscriber.', 's', above=0.0, high=3600.0),
    )
)

GAP_MONITOR = ParameterTable(
    (
        RATE,
        ParameterSpec('model_file', '', 'Model file to compare with.', read_only=True),
        MODEL_FOLDER,
        ParameterSpec('noise_floor', 0.0, 'Noise rms; 0 uses that of the model.', 'm', 0.0, 0.01),
        ParameterSpec('window', 1.0, 'Time window of the gap.', 's', 0.05, 600.0),
        ParameterSpec(
            'advise_from',
            0.01,
            'Gap relative to the motion above which the node warns and recommends a discovery.',
            '1',
            0.0,
            1.0,
        ),
    )
)

GCS_DRIVER = ParameterTable(
    (
        ParameterSpec(
            'controller',
            '',
            'Its address: gcs://HOST[:PORT], gcs:///dev/ttyUSB0 or nv200:///dev/ttyUSB0.',
            read_only=True,
        ),
        ParameterSpec('axis', '1', 'Of the controller.', read_only=True),
        ParameterSpec(
            'limits.low', 0.0, 'Lowest voltage; with limits.high 0 that of the controller.', 'V',
            -2000.0, 0.0, read_only=True,
        ),
        ParameterSpec(
            'limits.high', 0.0, 'Highest voltage; with limits.low 0 that of the controller.', 'V',
            0.0, 2000.0, read_only=True,
        ),
        ParameterSpec(
            'limits.slew', 0.0, 'Fastest change of the voltage; 0 is any.', 'V/s', 0.0, 1e12,
            read_only=True,
        ),
        ParameterSpec(
            'take_over', False,
            'Whether a sweep stops the wave or motion of another client; else it is refused.',
            read_only=True,
        ),
        ParameterSpec('actuator', '', 'Name of the actuator in the records.'),
        ParameterSpec('folder', RESULTS, 'Folder in which bags are written.', read_only=True),
        ParameterSpec(
            'monitor_rate', 10.0, 'How often actuator/state is published.', 'Hz', 0.1, 50.0,
            read_only=True,
        ),
        ParameterSpec(
            'timeout', 5.0, 'Longest time to wait for an answer.', 's', 0.05, 600.0,
            read_only=True,
        ),
    )
)  # fmt: skip
