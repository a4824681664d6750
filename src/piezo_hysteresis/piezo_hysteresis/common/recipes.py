"""Named models as data: the blocks of each, without the modules that simulate them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Recipe:
    """Composition of a named model."""

    blocks: tuple[str, ...]  # names of its blocks, in order
    description: str  # one sentence
    source: str  # paper and equation
    held: Mapping[str, float] = field(default_factory=dict)  # parameters that are not free


_SYMMETRIC = {'A0': 0.0}

RECIPES: dict[str, Recipe] = {
    'gain': Recipe(
        ('gain', 'offset'),
        'A gain and an offset: what a lag or a loop of a scan is measured against.',
        'Fujii 2018 (2) without h',
    ),
    'linear_mode': Recipe(
        ('gain', 'mode', 'offset'),
        'No hysteresis: a gain, one mode and an offset.',
        'Zhou 2021 (3) without h',
    ),
    'classical': Recipe(
        ('bouc_wen_exact', 'offset'),
        'Bouc-Wen hysteresis centred on the origin, exact step.',
        'Tatebatake 2017 (18), Xiao 2014 (1)',
        _SYMMETRIC,
    ),
    'classical_power': Recipe(
        ('bouc_wen_power', 'offset'),
        'The classical model with the exponent n, exact in the limit of small steps.',
        'Zhou 2021 (1)',
        _SYMMETRIC,
    ),
    'modified': Recipe(
        ('bouc_wen_exact', 'offset'),
        'Bouc-Wen hysteresis off centre (A0 free), exact step.',
        'Fujii 2018 (1), (2); Tatebatake 2017 (3)',
    ),
    'extended': Recipe(
        ('bouc_wen', 'autoregressive', 'offset'),
        'Off-centre Bouc-Wen hysteresis by Euler step and an autoregression, as printed.',
        'Fujii 2018 (3), Tatebatake 2017 (7)',
    ),
    'extended_free': Recipe(
        ('bouc_wen', 'autoregressive_free', 'offset'),
        'The same with a free autoregression of second order, as its regressor is printed.',
        'Fujii 2018 (10)',
    ),
    'enhanced3': Recipe(
        ('bouc_wen', 'autoregressive', 'offset', 'exogenous3'),
        'The extended model and a third harmonic by the printed recursion.',
        'Fujii 2018 (6)',
    ),
    'enhanced5': Recipe(
        ('bouc_wen', 'autoregressive', 'offset', 'exogenous5'),
        'The extended model and a fifth harmonic by the printed recursion.',
        'Fujii 2018 (7)',
    ),
    'enhanced3_sine': Recipe(
        ('bouc_wen', 'autoregressive', 'offset', 'harmonic3'),
        'The extended model and a third harmonic with the two parameters that data determine.',
        'Fujii 2018 (6) without c3, c4',
    ),
    'enhanced5_sine': Recipe(
        ('bouc_wen', 'autoregressive', 'offset', 'harmonic5'),
        'The extended model and a fifth harmonic with the two parameters that data determine.',
        'Fujii 2018 (7) without c5, c6',
    ),
    'bouc_wen_mode': Recipe(
        ('bouc_wen_exact', 'mode', 'offset'),
        'Bouc-Wen hysteresis by exact step and one mode: fits 1 to 50 Hz with one set.',
        'Zhou 2021 (1)-(3)',
        _SYMMETRIC,
    ),
    'second_order': Recipe(
        ('bouc_wen_exact', 'mass_spring', 'offset'),
        'The same in mass, damping and stiffness; the stiffness is held.',
        'Zhou 2021 (1)-(3), (5)',
        {**_SYMMETRIC, 'stiffness': 8.0e5},
    ),
    'second_order_power': Recipe(
        ('bouc_wen_power', 'mass_spring', 'offset'),
        'The second-order model with the exponent n.',
        'Zhou 2021 (1), (3), (5)',
        {**_SYMMETRIC, 'stiffness': 8.0e5},
    ),
    'inverse': Recipe(
        ('inverse_bouc_wen', 'offset'),
        'The voltage as a Bouc-Wen function of the displacement, solved for the displacement.',
        'Xiao 2014, inverse Bouc-Wen',
    ),
    'inverse_selector': Recipe(
        ('inverse_selector', 'offset'),
        'The inverse whose parameters follow the slope of the displacement, ten knots.',
        'Xiao 2014, rate-dependent selector',
        {'selector_slope': 0.05},
    ),
    'rate_dependent': Recipe(
        ('bouc_wen_modified', 'offset'),
        'Bouc-Wen hysteresis with a bias term and a factor that depends on the rate.',
        'Fang 2019 (9), in our reading',
    ),
    'prandtl_ishlinskii': Recipe(
        ('prandtl_ishlinskii', 'offset'),
        'A bank of nine play operators.',
        'reference model',
        {'pi_range': 1.0},
    ),
    'prandtl_ishlinskii_fine': Recipe(
        ('prandtl_ishlinskii_fine', 'offset'),
        'A bank of twenty play operators, the smallest of them very small.',
        'reference model',
        {'fine_pi_range': 1.0},
    ),
    'preisach': Recipe(
        ('preisach', 'offset'),
        'Preisach plane of 36 cells.',
        'reference model',
        {'preisach_range': 1.0},
    ),
    'bouc_wen_oscillator': Recipe(
        ('bouc_wen_oscillator', 'offset'),
        'Force in, displacement out; the hysteresis sits in the restoring force.',
        'Bouc-Wen benchmark of nonlinearbenchmark.org',
        {'z_exponent': 1.0, 'interpolation': 2.0},
    ),
    'classical_euler': Recipe(
        ('bouc_wen', 'offset'),
        'The classical model by the printed Euler step.',
        'Tatebatake 2017 (18), Xiao 2014 (1)',
        _SYMMETRIC,
    ),
    'modified_euler': Recipe(
        ('bouc_wen', 'offset'),
        'The modified model by the printed Euler step.',
        'Fujii 2018 (2), (3)',
    ),
}

NAMES: tuple[str, ...] = tuple(RECIPES)
