"""The parameter tables of the links of the voltage chain."""

from __future__ import annotations

from collections.abc import Mapping

from piezo_hysteresis.common.parameter_table import (
    ParameterSpec,
    ParameterTable,
    Value,
    range_refusal,
    rule_of,
    specs_of,
)
from piezo_hysteresis.compensation.coupled.matrix_settings import MatrixSettings
from piezo_hysteresis.compensation.feedback.feedback_link import (
    FEEDBACKS,
    FuzzyScales,
    HInfinityWeights,
    PidGains,
)
from piezo_hysteresis.compensation.harmonics.lines import AttenuationSettings
from piezo_hysteresis.compensation.link import INVERSES, Limits
from piezo_hysteresis.errors import CompensationError

RATE = ParameterSpec(
    'rate', 1000.0, 'Sampling rate of the loop.', 'Hz', low=1.0, high=1e5, read_only=True
)

# Ticks that the mean of the power takes at least.
SHORTEST_WINDOW = 11

MODEL_FOLDER = ParameterSpec(
    'model_folder',
    '',
    'Folder in which services read and write models; empty is the working folder.',
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
    ParameterSpec(
        'limits.low', Limits.low, 'Lowest output voltage.', 'V', -2000.0, 2000.0, from_model=True
    ),
    ParameterSpec(
        'limits.high',
        Limits.high,
        'Highest output voltage.',
        'V',
        -2000.0,
        2000.0,
        from_model=True,
    ),
    ParameterSpec(
        'limits.slew',
        Limits.slew,
        'Slew limit of the voltage.',
        'V/s',
        above=0.0,
        high=1e9,
        from_model=True,
    ),
    ParameterSpec(
        'energy_limit',
        0.0,
        'Limit of the mean power taken from the amplifier; 0 sets no limit.',
        'W',
        0.0,
        1e6,
    ),
    ParameterSpec(
        'capacitance',
        1e-6,
        'Capacitance of the actuator, for energy_limit; with an amplifier of gain G, G^2 '
        'times that.',
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
        'Actuator time without input until the voltage ramps to safe_voltage; 0 disables it.',
        's',
        0.0,
        3600.0,
    ),
    ParameterSpec(
        'safe_voltage',
        0.0,
        'Voltage without input, within the limits.',
        'V',
        -2000.0,
        2000.0,
        from_model=True,
    ),
    ParameterSpec(
        'safe_ramp',
        1.0,
        'Slew of the ramp to safe_voltage.',
        'V/s',
        above=0.0,
        high=1e9,
        from_model=True,
    ),
    ParameterSpec(
        'transition',
        0.2,
        'Duration of the transition after a change of model, law or lifecycle state.',
        's',
        0.0,
        60.0,
    ),
    ParameterSpec('autostart', True, 'Configure and activate at start.', read_only=True),
)

PLANT = (
    ParameterSpec(
        'model_file', '', 'Model file for the plant, used if plant.gain is 0.', read_only=True
    ),
    MODEL_FOLDER,
    ParameterSpec(
        'plant.gain',
        0.0,
        'Quasi-static displacement per volt, negative for an inverted sensor; 0 uses the '
        'plant of the model, or without a model estimates it, starting at 1e-4 m/V.',
        'm/V',
        -1.0,
        1.0,
    ),
    ParameterSpec(
        'plant.natural_frequency',
        0.0,
        'Natural frequency, 0 for none; requires plant.gain.',
        'Hz',
        0.0,
        1e5,
    ),
    ParameterSpec('plant.damping_ratio', 0.02, 'Damping ratio.', '1', above=0.0, high=10.0),
    ParameterSpec(
        'sensor_check',
        True,
        'Correct the voltage only once the displacement is seen to follow it with the sign of '
        'the plant, or once the voltage has not moved for 2 s.',
    ),
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
            'Duration of the smooth start of the reference; applies to models loaded afterwards.',
            's',
            0.0,
            60.0,
        ),
        ParameterSpec(
            'law',
            'auto',
            'Inverse of the model: the best available (auto), the law of a paper, the exact '
            'inverse of one Bouc-Wen block, the numeric inverse of any chain, or a gain.',
            choices=INVERSES,
        ),
        ParameterSpec(
            'follow_estimate',
            False,
            'Use each converged model/estimate on reception; one of a drive for its frequency.',
        ),
    ),
    rules=(_range_rule, _window_rule),
)

# The last link of an axis where there are several.
VOLTAGE = ParameterTable(LINK, rules=(_range_rule, _window_rule))

COUPLED = ParameterTable(
    (
        RATE,
        ParameterSpec(
            'model_file',
            '',
            'Model of several axes, whose number the loop has; empty is a loop of one axis.',
            read_only=True,
        ),
        ParameterSpec('enabled', True, 'Attenuate periodic errors; false is feedforward alone.'),
        *specs_of(MatrixSettings),
        ParameterSpec(
            'sensor_check',
            True,
            'Attenuate only once the displacement of every axis is seen to follow its voltage '
            'with the sign of the model, or once the voltage has not moved for 2 s.',
        ),
    ),
    rules=(rule_of(MatrixSettings, CompensationError),),
)

ATTENUATION = ParameterTable(
    (
        *LINK,
        ParameterSpec('enabled', True, 'Correct the voltage; false forwards it unchanged.'),
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
            'Control law on the tracking error; none forwards the voltage.',
            choices=FEEDBACKS,
        ),
        *specs_of(PidGains, 'pid.'),
        ParameterSpec(
            'fuzzy.tables',
            '',
            'YAML file with the 7 x 7 rules of fuzzy_pid; empty uses config/fuzzy/symmetric.yaml.',
            read_only=True,
        ),
        *specs_of(FuzzyScales, 'fuzzy.'),
        *specs_of(HInfinityWeights, 'h_infinity.'),
        ParameterSpec(
            'plant.numerator',
            [0.0],
            'Numerator of the transfer function from V to m, highest power of s first, for '
            'h_infinity; [0.0] uses the three parameters below.',
        ),
        ParameterSpec('plant.denominator', [0.0], 'Denominator of the transfer function.'),
        *PLANT,
    ),
    rules=(_range_rule, _window_rule, _plant_rule),
)
