"""The parameter tables of the nodes; knows no ROS, so that documents and checks can read them."""

from __future__ import annotations

from piezo_hysteresis.common.table import ParameterSpec, ParameterTable
from piezo_hysteresis.parameters.dashboard import DASHBOARD, RESULTS
from piezo_hysteresis.parameters.links import (
    ATTENUATION,
    FEEDBACK,
    FEEDFORWARD,
    MODEL_FOLDER,
    RATE,
)
from piezo_hysteresis.waveforms import KINDS

__all__ = [
    'ATTENUATION',
    'DASHBOARD',
    'DISCOVERY',
    'EXCITATION',
    'FEEDBACK',
    'FEEDFORWARD',
    'GAP_MONITOR',
    'IDENTIFICATION',
    'PLAYER',
    'RECORDER',
]

EXCITATION = ParameterTable(
    (
        RATE,
        ParameterSpec(
            'mode',
            'idle',
            'What is published: a reference, an open-loop voltage, or nothing.',
            choices=('idle', 'reference', 'voltage'),
        ),
        ParameterSpec('actuator', '', 'Name written into the markers of recorded sweeps.'),
        ParameterSpec('waveform', 'sine', 'Shape.', choices=tuple(KINDS)),
        ParameterSpec(
            'waveform_options',
            '',
            'Further settings of the waveform, as YAML: {seed: 3}; `ros2 param set` wants them in '
            'two pairs of quotes, "\'{seed: 3}\'".',
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
            'Fastest change of the voltage by sweeps and mode voltage, also where commands come '
            'late; 0 is any.',
            'V/s',
            0.0,
            1e12,
        ),
        ParameterSpec('duration', 0.0, 'Length of the experiment; 0 has no end.', 's', 0.0, 1e6),
        ParameterSpec(
            'wait_for', 0, 'Subscribers that must be there before the first tick.', low=0, high=99
        ),
        ParameterSpec(
            'marker_listeners',
            0,
            'Subscribers of record/marker that must be there before a sweep begins, at least.',
            low=0,
            high=99,
        ),
        ParameterSpec('exit_when_done', False, 'End the process when the experiment ends.'),
        ParameterSpec(
            'deadline',
            10.0,
            'Silence of the actuator after which the experiment is given up.',
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
            "Forgetting factor; 1 forgets nothing, 0 takes the method's own.",
            '1',
            0.0,
            1.0,
        ),
        ParameterSpec(
            'publish_every', 500, 'Samples between two estimates.', '1', low=1, high=1000000
        ),
        ParameterSpec('only_records', True, 'Leave out what lies between the records of a sweep.'),
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
            'rls: a constant column beside A0, which in steady state does the same; identify has '
            'none and takes the offset from free runs afterwards.',
        ),
        ParameterSpec('harmonic', 0, 'rls: exogenous odd harmonic: 0, 3 or 5.', low=0, high=5),
        ParameterSpec(
            'frequency',
            0.0,
            'rls: fundamental, for the harmonic, until the marker of a record tells its own.',
            'Hz',
            0.0,
            1e4,
        ),
        ParameterSpec(
            'p0', 1.0, 'rls: P starts as this times the identity.', '1', above=0.0, high=1e12
        ),
        ParameterSpec(
            'start', [''], "rls: start values NAME=VALUE in SI units; the papers' for the others."
        ),
        ParameterSpec(
            'unit',
            'mm',
            'rls: unit the recursion works in; with P0 = I it matters.',
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
            'rls_ud, pi_bank: displacement that belongs to it, to an order of magnitude.',
            'm',
            above=0.0,
            high=0.01,
        ),
        ParameterSpec(
            'natural_frequency',
            0.0,
            'rls_ud, pi_bank: the frozen mode; 0 leaves it out.',
            'Hz',
            0.0,
            1e5,
        ),
        ParameterSpec(
            'damping_ratio',
            0.02,
            'rls_ud, pi_bank: damping ratio of the frozen mode.',
            '1',
            above=0.0,
            high=10.0,
        ),
        ParameterSpec(
            'quiet',
            0.01,
            'rls_ud, pi_bank: speed of the voltage below which nothing is learnt, ranges per s.',
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
            'Topics to record; state, reference and markers where none are given.',
            read_only=True,
        ),
    )
)

PLAYER = ParameterTable(
    (
        ParameterSpec('bag', '', 'Bag folder, .mcap or .db3 file to play.', read_only=True),
        ParameterSpec('topics', [''], 'Topics to play; all where none are given.', read_only=True),
        ParameterSpec(
            'rate_factor',
            1.0,
            'Speed against the recording.',
            '1',
            above=0.0,
            high=1e6,
            read_only=True,
        ),
        ParameterSpec('loop', False, 'Begin again at the end.', read_only=True),
        ParameterSpec(
            'lock_step', False, 'Go as fast as the listeners take the samples.', read_only=True
        ),
        ParameterSpec('salvage', False, 'Play what is readable of a damaged bag.', read_only=True),
        ParameterSpec('publish_clock', False, 'Publish log times on /clock.', read_only=True),
        ParameterSpec('wait', 10.0, 'Longest wait for a listener.', 's', above=0.0, high=3600.0),
    )
)

GAP_MONITOR = ParameterTable(
    (
        RATE,
        ParameterSpec('model_file', '', 'Model file to compare with.', read_only=True),
        MODEL_FOLDER,
        ParameterSpec('noise_floor', 0.0, 'Noise rms; 0 takes that of the model.', 'm', 0.0, 0.01),
        ParameterSpec('window', 1.0, 'Time over which the gap is taken.', 's', 0.05, 600.0),
        ParameterSpec(
            'advise_from',
            0.01,
            'Gap as a part of the motion from which on it warns and advises a discovery.',
            '1',
            0.0,
            1.0,
        ),
    )
)

DISCOVERY = ParameterTable(
    (
        ParameterSpec(
            'folder', RESULTS, 'Folder in which data, baselines and results lie.', read_only=True
        ),
        ParameterSpec(
            'model_file', '', 'Model in use, where an investigation is given none.', read_only=True
        ),
    )
)
