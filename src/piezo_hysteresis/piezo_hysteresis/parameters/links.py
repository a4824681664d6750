"""The parameter tables of the links of the voltage chain; knows no ROS."""

from __future__ import annotations

from collections.abc import Mapping

from piezo_common.table import ParameterSpec, ParameterTable, Value
from piezo_hysteresis.compensation.base import INVERSES

RATE = ParameterSpec(
    'rate', 1000.0, 'Sampling rate of the loop.', 'Hz', low=1.0, high=1e5, read_only=True
)

# Ticks that the mean of the power takes at least.
SHORTEST_WINDOW = 11

MODEL_FOLDER = ParameterSpec(
    'model_folder',
    '',
    'Folder inside which services read and write models; empty is the working folder.',
    read_only=True,
)


def _number(values: Mapping[str, Value], name: str) -> float:
    value = values[name]
    assert isinstance(value, int | float)
    return float(value)


def _window_rule(values: Mapping[str, Value]) -> str:
    if _number(values, 'energy_window') * _number(values, 'rate') >= SHORTEST_WINDOW:
        return ''
    return f'energy_window must last {SHORTEST_WINDOW} ticks of the rate at least'


def _range_rule(values: Mapping[str, Value]) -> str:
    if _number(values, 'limits.low') < _number(values, 'limits.high'):
        return ''
    return 'limits.low must stay below limits.high; set both in one atomic call'


LINK = (
    RATE,
    ParameterSpec('limits.low', -1.2, 'Lowest voltage passed on.', 'V', -500.0, 500.0),
    ParameterSpec('limits.high', 1.2, 'Highest voltage passed on.', 'V', -500.0, 500.0),
    ParameterSpec(
        'limits.slew', 2000.0, 'Fastest change of the voltage.', 'V/s', above=0.0, high=1e9
    ),
    ParameterSpec(
        'energy_limit',
        0.0,
        'Mean power that the voltage may take from the amplifier; 0 sets no limit.',
        'W',
        0.0,
        1e6,
    ),
    ParameterSpec(
        'capacitance',
        1e-6,
        'Of the actuator, for energy_limit; behind an amplifier of gain G, G^2 times that.',
        'F',
        above=0.0,
        high=1e3,
    ),
    ParameterSpec(
        'energy_window', 1.0, 'Time constant of the mean power.', 's', above=0.0, high=3600.0
    ),
    ParameterSpec(
        'watchdog',
        0.05,
        'Time of the actuator without input until the voltage goes to safe_voltage; 0 never.',
        's',
        0.0,
        3600.0,
    ),
    ParameterSpec(
        'safe_voltage',
        0.0,
        'Where the voltage goes without input, within the limits.',
        'V',
        -500.0,
        500.0,
    ),
    ParameterSpec('safe_ramp', 1.0, 'How fast it goes there.', 'V/s', above=0.0, high=1e9),
    ParameterSpec(
        'transition',
        0.2,
        'Time over which a change of model, law or life cycle goes over.',
        's',
        0.0,
        60.0,
    ),
    ParameterSpec('autostart', True, 'Configure and activate at start.', read_only=True),
)

PLANT = (
    ParameterSpec('plant.gain', 1.2e-4, 'Quasi-static displacement per volt.', 'm/V', above=0.0),
    ParameterSpec(
        'plant.natural_frequency', 68.0, 'Natural frequency; 0 for none.', 'Hz', 0.0, 1e5
    ),
    ParameterSpec('plant.damping_ratio', 0.015, 'Damping ratio.', '1', above=0.0, high=10.0),
)

FEEDFORWARD = ParameterTable(
    (
        *LINK,
        ParameterSpec(
            'model_file',
            '',
            'Model file to invert from the start; empty uses gain alone.',
            read_only=True,
        ),
        MODEL_FOLDER,
        ParameterSpec(
            'gain', 1.2857e-4, 'Displacement per volt used without a model.', 'm/V', above=0.0
        ),
        ParameterSpec(
            'start',
            0.5,
            'Time over which the reference is eased in; for models loaded from then on.',
            's',
            0.0,
            60.0,
        ),
        ParameterSpec(
            'law',
            'auto',
            'How a model is inverted: the best way there is for it, the law of a paper, the exact '
            'inverse of one Bouc-Wen block, the numeric one of any chain, or a mere gain.',
            choices=INVERSES,
        ),
        ParameterSpec('follow_estimate', False, 'Take every model/estimate as soon as it comes.'),
    ),
    rules=(_range_rule, _window_rule),
)

ATTENUATION = ParameterTable(
    (
        *LINK,
        ParameterSpec('enabled', True, 'Correct the voltage; false passes it on.'),
        ParameterSpec(
            'method',
            'rls',
            'rls is 000 (18)-(21); afc is adaptive feedforward cancellation by complex gain; '
            'filtered_rls is RLS on the reference filtered by the plant gain.',
            choices=('rls', 'afc', 'filtered_rls'),
        ),
        ParameterSpec('orders', [3], 'Harmonic orders to attenuate; 0 is the mean.', '1', 0, 99),
        ParameterSpec(
            'resonance',
            0.0,
            'Natural frequency whose orders round(fn / f) are added; 0 adds none.',
            'Hz',
            0.0,
            1e5,
        ),
        ParameterSpec(
            'sign_rule',
            'computed',
            'rls: sign of the error: computed from the plant gain, printed as 000 (22), (23), '
            'none.',
            choices=('computed', 'printed', 'none'),
        ),
        ParameterSpec(
            'switch_frequency',
            66.0,
            'rls, printed: orders up to here use 000 (22), above it (23).',
            'Hz',
            0.0,
            1e5,
        ),
        ParameterSpec(
            'fit',
            'recursion',
            "rls: 000's recursion for the harmonic, or sines alone.",
            choices=('recursion', 'sines'),
        ),
        ParameterSpec('gain', 16666.7, 'rls: volts per metre of error.', 'V/m', above=0.0),
        ParameterSpec(
            'forgetting', 0.9995, 'rls, filtered_rls: forgetting factor.', '1', 0.9, 1.0
        ),
        ParameterSpec(
            'settle',
            0.3,
            'afc: wait after each step; two time constants of the mode.',
            's',
            above=0.0,
            high=60.0,
        ),
        ParameterSpec(
            'span', 0.25, 'afc: time that is evaluated, whole periods.', 's', above=0.0, high=60.0
        ),
        ParameterSpec(
            'step_size',
            0.9,
            'afc: share of the error that one step removes.',
            '1',
            above=0.0,
            high=1.0,
        ),
        ParameterSpec(
            'largest_step', 0.1, 'afc: bound on one step of an order.', 'V', above=0.0, high=500.0
        ),
        ParameterSpec(
            'largest_correction',
            0.5,
            'Bound on the correction amplitude of one order.',
            'V',
            above=0.0,
            high=500.0,
        ),
        *PLANT,
    ),
    rules=(_range_rule, _window_rule),
)

FEEDBACK = ParameterTable(
    (
        *LINK,
        ParameterSpec(
            'method',
            'none',
            'Law on the tracking error; none passes the voltage on.',
            choices=('none', 'pid', 'fuzzy_pid', 'h_infinity'),
        ),
        ParameterSpec('pid.proportional', 0.0, 'Proportional gain.', 'V/m', 0.0, 1e12),
        ParameterSpec('pid.integral', 3e4, 'Integral gain.', 'V/(m s)', 0.0, 1e12),
        ParameterSpec('pid.derivative', 0.0, 'Derivative gain.', 'V s/m', 0.0, 1e12),
        ParameterSpec(
            'pid.derivative_filter',
            2e-3,
            'Time constant of the low-pass on the derivative.',
            's',
            above=0.0,
            high=60.0,
        ),
        ParameterSpec(
            'pid.tracking_time',
            0.05,
            'Anti-windup: time in which the integral follows what was cut off.',
            's',
            above=0.0,
            high=1e6,
        ),
        ParameterSpec(
            'fuzzy.tables',
            '',
            'YAML file with the 7 x 7 rules of fuzzy_pid, like config/fuzzy/symmetric.yaml; empty '
            'takes those.',
            read_only=True,
        ),
        ParameterSpec('fuzzy.error_scale', 5e-6, 'Error that is big.', 'm', above=0.0, high=0.01),
        ParameterSpec(
            'fuzzy.rate_scale',
            1e-3,
            'Rate of the error that is big.',
            'm/s',
            above=0.0,
            high=100.0,
        ),
        ParameterSpec(
            'fuzzy.proportional_range',
            0.0,
            'Largest change of the proportional gain.',
            'V/m',
            0.0,
            1e12,
        ),
        ParameterSpec(
            'fuzzy.integral_range',
            1e4,
            'Largest change of the integral gain.',
            'V/(m s)',
            0.0,
            1e12,
        ),
        ParameterSpec(
            'h_infinity.bandwidth',
            2.0,
            'Frequency up to which errors are fought.',
            'Hz',
            above=0.0,
            high=1e4,
        ),
        ParameterSpec(
            'h_infinity.steady_error',
            1e-3,
            'Share of a constant disturbance that may remain.',
            '1',
            above=0.0,
            high=1.0,
        ),
        ParameterSpec(
            'h_infinity.peak',
            1.6,
            'Largest amplification of errors beyond the bandwidth.',
            '1',
            above=1.0,
            high=100.0,
        ),
        ParameterSpec(
            'h_infinity.control', 0.5, 'Weight of the voltage.', '1', above=0.0, high=1e6
        ),
        ParameterSpec(
            'h_infinity.delay_ticks',
            1,
            'Samples by which a measurement is late.',
            '1',
            low=0,
            high=20,
        ),
        ParameterSpec(
            'plant.numerator',
            [0.0],
            'Transfer function from V to m, highest power of s first, for h_infinity; [0.0] takes '
            'the three numbers below.',
        ),
        ParameterSpec('plant.denominator', [0.0], 'Its denominator.'),
        *PLANT,
    ),
    rules=(_range_rule, _window_rule),
)
