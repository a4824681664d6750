"""Derived numbers of the kernels from parameters and switches."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from piezo_sim.layout import DERIVED_TYPE, EFFECTS, PARAMETER_TYPE
from piezo_sim.parts import bouc_wen, chain, play, slow, structure
from piezo_sim.simulation_errors import PlantError

Record = npt.NDArray[Any]

_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(8)


def effective(values: Mapping[str, float], effects: Mapping[str, bool]) -> dict[str, float]:
    """Return `values` with the parameters of every inactive effect at their neutral values."""
    result = dict(values)
    for effect in EFFECTS:
        if not effects[effect.name]:
            result.update(effect.neutral)
    return result


def pack(values: Mapping[str, float]) -> Record:
    """Return `values` as the parameter record of the kernels, shape (1,)."""
    packed = np.zeros(1, PARAMETER_TYPE)
    for name, value in values.items():
        group, quantity = name.split('.')
        packed[group][quantity] = value
    return packed


def check(v: Mapping[str, float], effects: Mapping[str, bool]) -> None:
    """Reject combinations of parameters that are physically impossible."""
    if effects['bouc_wen'] and abs(v['bouc_wen.gamma']) > v['bouc_wen.beta']:
        raise PlantError(
            'bouc_wen.gamma must lie within -beta .. beta: outside the loop is run through '
            f'backwards and makes energy, got beta {v["bouc_wen.beta"]:g} and gamma '
            f'{v["bouc_wen.gamma"]:g} 1/V'
        )
    if effects['bouc_wen'] and v['bouc_wen.beta'] + v['bouc_wen.gamma'] <= 0.0:
        raise PlantError('bouc_wen.beta + gamma must be positive, or the hysteresis never ends')
    if v['restoring.share'] > 0.0 and abs(v['restoring.gamma']) > v['restoring.beta']:
        raise PlantError(
            'restoring.gamma must lie within -beta .. beta, or the spring makes energy'
        )
    reach = max(-v['amplifier.range_low'], v['amplifier.range_high'])
    density = 1.0 - abs(v['preisach.asymmetry']) * reach - v['preisach.curvature'] * reach**2
    if effects['preisach'] and density <= 0.0:
        raise PlantError(
            'the Preisach density becomes negative inside the range of the amplifier '
            f'({reach:g} V); lower preisach.asymmetry or preisach.curvature'
        )
    others = sum(v[f'mode_{i}.share'] for i in (2, 3, 4))
    if others >= 1.0:
        raise PlantError(
            f'the modes 2 to 4 take {others:g} of the static displacement and leave nothing to '
            'the first; lower their shares'
        )


def propagators(omega: float, zeta: float, steps: npt.NDArray[np.float64]) -> Record:
    """Return exp(A h) of one mode for every step h [s], row-major, shape (steps, 4)."""
    # At critical damping both forms have the same limit; the lower bound keeps it finite.
    root = omega * max(math.sqrt(abs(1.0 - zeta * zeta)), 1e-8)
    if zeta > 1.0:
        # cosh and sinh overflow while their factor underflows: compute the product directly.
        slow_, fast = omega * omega / (zeta * omega + root), zeta * omega + root
        cosine = 0.5 * (np.exp(-slow_ * steps) + np.exp(-fast * steps))
        sine = -np.expm1(-2.0 * root * steps) * np.exp(-slow_ * steps) / (2.0 * root)
    else:
        decay = np.exp(-zeta * omega * steps)
        cosine, sine = decay * np.cos(root * steps), decay * np.sin(root * steps) / root
    return np.stack(
        [cosine + zeta * omega * sine, sine, -(omega**2) * sine, cosine - zeta * omega * sine],
        axis=-1,
    )


def filter_weights(bandwidth: float, steps: npt.NDArray[np.float64]) -> Record:
    """Return decay and weights of start, middle and end of a low-pass, shape (steps, 4)."""
    theta = 0.5 * (_POINTS + 1.0)
    rows = []
    for h in steps:
        a = 2.0 * math.pi * bandwidth * h
        kernel = 0.5 * _WEIGHTS * a * np.exp(-a * (1.0 - theta))
        rows.append(
            [
                math.exp(-a),
                kernel @ ((1.0 - theta) * (1.0 - 2.0 * theta)),
                kernel @ (4.0 * theta * (1.0 - theta)),
                kernel @ (theta * (2.0 * theta - 1.0)),
            ]
        )
    return np.array(rows)


def _level(dt: float, longest: float) -> int:
    """Return the coarsest level with a step of at most `longest` [s]."""
    if longest >= dt:
        return 0
    return min(chain.LEVELS, math.ceil(math.log2(dt / longest)))


def derive(
    v: Mapping[str, float], effects: Mapping[str, bool], dt: float, refine: int = 0
) -> Record:
    """Return all derived numbers of the effective parameters `v`, shape (1,).

    `refine` is the number of times that every step is halved.
    """
    record = np.zeros(1, DERIVED_TYPE)
    d = record[0]
    d['step'] = dt / 2.0 ** np.arange(chain.LEVELS + 2)
    d['bouc_wen_stride'] = bouc_wen.STRIDE / 2.0**refine
    _derive_hysteresis(d, v, effects)
    fastest = _derive_modes(d, v)
    memory = v['friction.coulomb'] > 0.0 or v['restoring.share'] > 0.0
    d['memory'] = memory
    # A hysteretic restoring force accumulates integration errors.
    stride = 0.02 if v['restoring.share'] > 0.0 else 0.05 if memory else 0.1
    d['stride'] = stride / 2.0**refine
    d['creep_gain'][: slow.KELVIN_VOIGT] = [v[f'creep.gain_{j}'] for j in (1, 2, 3)]
    d['creep_gain'][slow.KELVIN_VOIGT :] = v['log_creep.gain'] / 2.0
    times = [v[f'creep.time_{j}'] for j in (1, 2, 3)]
    times += [v['log_creep.start'] * 10.0 ** (j / 2.0) for j in range(slow.DECADES)]
    d['creep_share'] = -np.expm1(-dt / np.array(times))
    d['creeping'] = bool(np.any(d['creep_gain'] != 0.0))
    longest = math.inf
    if v['sensor.bandwidth'] > 0.0:
        d['filter'] = filter_weights(v['sensor.bandwidth'], d['step'][:-1])
        longest = 0.25 / (2.0 * math.pi * v['sensor.bandwidth'])
        longest = min(longest, 0.1 / fastest if fastest else math.inf)
    if d['nonlinear'] and v['structure.pump_depth'] > 0.0:
        longest = min(longest, 0.05 / v['structure.pump_frequency'])
    d['level_still'] = min(chain.LEVELS, _level(dt, longest) + refine)
    longest = min(longest, 0.25 / fastest if fastest else math.inf)
    if v['amplifier.lag_time_constant'] > 0.0:
        longest = min(longest, 0.25 * v['amplifier.lag_time_constant'])
    d['level_moving'] = min(chain.LEVELS, _level(dt, longest) + refine)
    d['level_corner'] = min(chain.LEVELS, d['level_moving'] + 4)
    return record


def _derive_hysteresis(d: Any, v: Mapping[str, float], effects: Mapping[str, bool]) -> None:
    for law in ('bouc_wen', 'play', 'preisach'):
        d[f'use_{law}'] = effects[law]
    bank = [
        (v[f'play.radius_{j:02}'], v[f'play.weight_{j:02}'])
        for j in range(1, play.OPERATORS + 1)
        if v[f'play.weight_{j:02}'] > 0.0
    ]
    d['play_count'] = len(bank)
    d['play_slope'] = sum(weight for _, weight in bank)
    for j, (radius, weight) in enumerate(bank):
        d['play_radius'][j], d['play_weight'][j] = radius, weight


def _derive_modes(d: Any, v: Mapping[str, float]) -> float:
    """Fill in the modes and return the largest angular frequency [rad/s], 0 for none."""
    q = {name.removeprefix('structure.'): value for name, value in v.items()}
    stiffness = q['stiffness'] + q['load_stiffness']
    compliance = q['stiffness'] / stiffness
    others = sum(v[f'mode_{i}.share'] for i in (2, 3, 4))
    modes = [(0.0, 0.0, (1.0 - others))]
    if q['natural_frequency'] > 0.0:
        omega = 2.0 * math.pi * q['natural_frequency']
        mass = q['stiffness'] / omega**2
        loaded = math.sqrt(stiffness / (mass + q['load_mass']))
        damping = q['damping_ratio'] * math.sqrt(
            q['stiffness'] * mass / (stiffness * (mass + q['load_mass']))
        )
        modes = [(loaded, damping, 1.0 - others)]
    modes += [
        (
            2.0 * math.pi * v[f'mode_{i}.frequency'],
            v[f'mode_{i}.damping_ratio'],
            v[f'mode_{i}.share'],
        )
        for i in (2, 3, 4)
    ]
    for i, (omega, zeta, share) in enumerate(modes):
        d['omega'][i], d['share'][i] = omega, share * compliance
        d['active'][i] = omega > 0.0 and share != 0.0
        if omega > 0.0:
            d['zeta'] = d['zeta'] if i else zeta
            d['propagator'][i] = propagators(omega, zeta, d['step'])
    d['static_share'] = 0.0 if modes[0][0] > 0.0 else modes[0][2] * compliance
    d['dynamic'] = bool(np.any(d['active']))
    d['nonlinear'] = bool(d['active'][0]) and any(v[name] != 0.0 for name in structure.FORCES)
    return max((float(d['omega'][i]) for i in range(structure.MODES) if d['active'][i]), default=0)
