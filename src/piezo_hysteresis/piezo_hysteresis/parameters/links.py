"""The parameter tables of the links of the voltage chain."""

from __future__ import annotations

from collections.abc import Mapping

from piezo_hysteresis.common.ranges import range_refusal
from piezo_hysteresis.common.settings import rule_of, specs_of
from piezo_hysteresis.common.table import ParameterSpec, ParameterTable, Value
from piezo_hysteresis.compensation.base import INVERSES
from piezo_hysteresis.compensation.feedback.settings import FuzzyScales, HInfinityWeights, PidGains
from piezo_hysteresis.compensation.harmonics.settings import AttenuationSettings
from piezo_hysteresis.errors import CompensationError

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
    reason = range_refusal(_number(values, 'limits.low'), _number(values, 'limits.high'))
    return reason and f'{reason} (limits.low and limits.high in one atomic call)'


def _plant_rule(values: Mapping[str, Value]) -> str:
    if _number(values, 'plant.natural_frequency') == 0.0 or _number(values, 'plant.gain') != 0.0:
        return ''
    return 'plant.natural_frequency belongs to plant.gain; set that first'


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
    ParameterSpec(
        'model_file',
        '',
        'Model file that the plant is taken from, where plant.gain is 0.',
        read_only=True,
    ),
    MODEL_FOLDER,
    ParameterSpec(
        'plant.gain',
        0.0,
        'Quasi-static displacement per volt, negative where the sensor counts the other way; 0 '
        'takes the plant from the model, and without one finds it out from 1e-4 m/V.',
        'm/V',
        -1.0,
        1.0,
    ),
    ParameterSpec(
        'plant.natural_frequency',
        0.0,
        'Natural frequency; 0 for none; belongs to plant.gain.',
        'Hz',
        0.0,
        1e5,
    ),
    ParameterSpec('plant.damping_ratio', 0.02, 'Damping ratio.', '1', above=0.0, high=10.0),
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
            'gain', 1e-4, 'Displacement per volt used without a model.', 'm/V', above=0.0
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
        *specs_of(AttenuationSettings),
        *PLANT,
    ),
    rules=(
        _range_rule,
        _window_rule,
        _plant_rule,
        rule_of(AttenuationSettings, CompensationError),
    ),
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
        *specs_of(PidGains, 'pid.'),
        ParameterSpec(
            'fuzzy.tables',
            '',
            'YAML file with the 7 x 7 rules of fuzzy_pid, like config/fuzzy/symmetric.yaml; empty '
            'takes those.',
            read_only=True,
        ),
        *specs_of(FuzzyScales, 'fuzzy.'),
        *specs_of(HInfinityWeights, 'h_infinity.'),
        ParameterSpec(
            'plant.numerator',
            [0.0],
            'Transfer function from V to m, highest power of s first, for h_infinity; [0.0] takes '
            'the three numbers below.',
        ),
        ParameterSpec('plant.denominator', [0.0], 'Its denominator.'),
        *PLANT,
    ),
    rules=(_range_rule, _window_rule, _plant_rule),
)
