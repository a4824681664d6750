"""The parameter tables of the nodes; knows no ROS, so that documents and checks can read them."""

from __future__ import annotations

from collections.abc import Mapping

from piezo_hysteresis.waveforms import KINDS
from piezo_ros_common.table import ParameterSpec, ParameterTable, Value

RATE = ParameterSpec(
    'rate', 1000.0, 'Sampling rate of the loop.', 'Hz', above=0.0, high=1e5, read_only=True
)


def _number(values: Mapping[str, Value], name: str) -> float:
    value = values[name]
    assert isinstance(value, int | float)
    return float(value)


def _range_rule(values: Mapping[str, Value]) -> str:
    if _number(values, 'limits.low') < _number(values, 'limits.high'):
        return ''
    return 'limits.low must stay below limits.high; set both in one atomic call'


LIMITS = (
    ParameterSpec('limits.low', -1.2, 'Lowest voltage passed on.', 'V', -500.0, 500.0),
    ParameterSpec('limits.high', 1.2, 'Highest voltage passed on.', 'V', -500.0, 500.0),
    ParameterSpec(
        'limits.slew', 2000.0, 'Fastest change of the voltage.', 'V/s', above=0.0, high=1e9
    ),
)

LINK = (
    RATE,
    *LIMITS,
    ParameterSpec('autostart', True, 'Configure and activate at start.', read_only=True),
)

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
            'waveform_options', '', 'Further settings of the waveform, as YAML: {seed: 3}.'
        ),
        ParameterSpec('frequency', 1.0, 'Fundamental frequency.', 'Hz', 0.0, 1e4),
        ParameterSpec('reference.amplitude', 5e-5, 'Amplitude of the reference.', 'm', 0.0, 0.01),
        ParameterSpec('reference.offset', 0.0, 'Mean of the reference.', 'm', -0.01, 0.01),
        ParameterSpec('voltage.amplitude', 1.0, 'Amplitude of the voltage.', 'V', 0.0, 500.0),
        ParameterSpec('voltage.offset', 0.0, 'Mean of the voltage.', 'V', -500.0, 500.0),
        ParameterSpec('ramp', 1.0, 'Smooth rise of the amplitude at the start.', 's', 0.0, 60.0),
        ParameterSpec('duration', 0.0, 'Length of the experiment; 0 has no end.', 's', 0.0, 1e6),
        ParameterSpec(
            'wait_for', 0, 'Subscribers that must be there before the first tick.', low=0, high=99
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

FEEDFORWARD = ParameterTable(
    (
        *LINK,
        ParameterSpec('model_file', '', 'Model file to invert; empty uses gain alone.'),
        ParameterSpec(
            'gain', 1.2857e-4, 'Displacement per volt used without a model.', 'm/V', above=0.0
        ),
        ParameterSpec('start', 0.5, 'Time over which the reference is eased in.', 's', 0.0, 60.0),
        ParameterSpec(
            'transition', 0.2, 'Time over which a change of the model goes over.', 's', 0.0, 60.0
        ),
        ParameterSpec('follow_estimate', False, 'Take every model/estimate as soon as it comes.'),
    ),
    rules=(_range_rule,),
)

ATTENUATION = ParameterTable(
    (
        *LINK,
        ParameterSpec('enabled', True, 'Correct the voltage; false passes it on.'),
        ParameterSpec(
            'method',
            'rls',
            'rls is 000 (18)-(21); afc is adaptive feedforward cancellation by complex gain.',
            choices=('rls', 'afc'),
        ),
        ParameterSpec('orders', [3], 'Harmonic orders to attenuate.', '1', 0, 99),
        ParameterSpec(
            'sign_rule',
            'computed',
            'Sign of the error: computed from the plant gain, as printed in 000 (22), (23), none.',
            choices=('computed', 'printed', 'none'),
        ),
        ParameterSpec(
            'gain', 16666.7, 'Volts per metre of tracking error (method rls).', 'V/m', above=0.0
        ),
        ParameterSpec(
            'plant.gain', 1.2e-4, 'Quasi-static displacement per volt.', 'm/V', above=0.0
        ),
        ParameterSpec(
            'plant.natural_frequency', 68.0, 'Natural frequency; 0 for none.', 'Hz', 0.0, 1e5
        ),
        ParameterSpec('plant.damping_ratio', 0.015, 'Damping ratio.', '1', above=0.0, high=10.0),
    ),
    rules=(_range_rule,),
)

MODEL_FOLDER = ParameterSpec(
    'model_folder',
    '',
    'Folder inside which services read and write models; empty is the working folder.',
    read_only=True,
)

IDENTIFICATION = ParameterTable(
    (
        RATE,
        ParameterSpec(
            'method',
            'rls',
            'rls is 000 (8)-(12); rls_ud and pi_bank are well-posed: Bouc-Wen or a play bank.',
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
            'rls: V1 is 000 (3), V0 is 000 (10), V2 is 001 (10) as printed.',
            choices=('V0', 'V1', 'V2'),
        ),
        ParameterSpec('offset', True, 'rls: estimate a constant offset too.'),
        ParameterSpec('harmonic', 0, 'rls: exogenous odd harmonic: 0, 3 or 5.', low=0, high=5),
        ParameterSpec('frequency', 0.0, 'rls: fundamental, for the harmonic.', 'Hz', 0.0, 1e4),
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
        ParameterSpec('model_file', '', 'Model file to compare with.'),
        ParameterSpec('noise_floor', 0.0, 'Noise rms; 0 takes that of the model.', 'm', 0.0, 0.01),
        ParameterSpec('window', 1.0, 'Time over which the gap is taken.', 's', 0.05, 600.0),
    )
)

DISCOVERY = ParameterTable(
    (
        ParameterSpec(
            'folder', '.', 'Folder in which data, baselines and results lie.', read_only=True
        ),
    )
)
