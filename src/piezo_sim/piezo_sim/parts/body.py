"""Body that couples several actuators: guide, common modes, and what their stress does.

The reading of an axis is a share of its own motion, shares of the motions of the other axes
(a guide that is not square), and the motion of modes that all actuators drive. Such a mode obeys
``q'' + 2 zeta omega q' + omega^2 q = omega^2 sum_i d_i w_i`` with the free strokes w_i of the
ceramics; it stretches actuator i by ``d_i q`` (virtual work). Within an interval the mean stroke
acts, for which the step is exact. Mechanical stress depolarises: the frequencies fall with the rms
voltage (slow domains), and the strain of a ceramic lags behind its elongation (Bouc-Wen).
"""

from __future__ import annotations

import math
from typing import Any

from piezo_hysteresis.kernels.compile import inline_jit, jit
from piezo_sim.parts import chain
from piezo_sim.plant_parameters import PlantEffect, PlantParameter

AXES, BODY_MODES = 3, 3
_AXES, _MODES = range(1, AXES + 1), range(1, BODY_MODES + 1)
_PAIRS = [(i, j) for i in _AXES for j in _AXES if i != j]

PARAMETERS = (
    PlantParameter('own.share', '1', 1.0, 0.0, 1.0, 'Part of its own motion that an axis reads.'),
    *(
        PlantParameter(
            f'cross_talk.share_{i}_to_{j}',
            '1',
            0.02,
            -1.0,
            1.0,
            f'Part of the motion of axis {i} that axis {j} reads.',
        )
        for i, j in _PAIRS
    ),
    *(
        row
        for k in _MODES
        for row in (
            PlantParameter(
                f'body_{k}.frequency', 'Hz', 300.0 * k, 0.1, 1e5, 'Undamped frequency.'
            ),
            PlantParameter(f'body_{k}.damping_ratio', '1', 0.01, 1e-5, 0.9, 'Damping.'),
            *(
                PlantParameter(
                    f'body_{k}.drive_{i}', '1', 0.1, -1.0, 1.0, f'Share of the stroke of axis {i}.'
                )
                for i in _AXES
            ),
            *(
                PlantParameter(
                    f'body_{k}.motion_{j}', '1', 0.1, -2.0, 2.0, f'Motion that axis {j} reads.'
                )
                for j in _AXES
            ),
        )
    ),
    PlantParameter(
        'softening.share', '1', 0.01, 0.0, 0.3, 'Fall of the frequencies at the reference voltage.'
    ),
    PlantParameter('softening.reference', 'V', 1.0, 1e-6, 1e4, 'Rms voltage it is given for.'),
    PlantParameter('softening.time_constant', 's', 0.1, 1e-3, 1e3, 'Of the rms voltage.'),
    PlantParameter(
        'ferroelasticity.share', '1', 0.05, 0.0, 0.5, 'Hysteretic share of the elongation.'
    ),
    PlantParameter('ferroelasticity.beta', '1/m', 3e4, 1e-3, 1e12, 'Its Bouc-Wen beta.'),
)  # fmt: skip

EFFECTS = (
    *(
        PlantEffect(
            f'cross_talk_{i}_to_{j}',
            f'Axis {j} reads a part of the motion of axis {i}.',
            {f'cross_talk.share_{i}_to_{j}': 0.0},
        )
        for i, j in _PAIRS
    ),
    *(
        PlantEffect(
            f'body_{k}',
            f'Common mode {k}, driven by all actuators.',
            {f'body_{k}.{what}_{j}': 0.0 for what in ('drive', 'motion') for j in _AXES},
        )
        for k in _MODES
    ),
    PlantEffect(
        'softening', 'Common modes fall with the rms voltage.', {'softening.share': 0.0}
    ),
    PlantEffect(
        'ferroelasticity',
        'The ceramics lag behind their elongation by common modes.',
        {'ferroelasticity.share': 0.0},
    ),
)  # fmt: skip


@inline_jit
def _oscillate(b: Any, k: int, force: float, omega: float, zeta: float, dt: float) -> None:
    """Advance mode k over `dt` [s] under a constant force, in metres of its static motion."""
    root = omega * math.sqrt(1.0 - zeta * zeta)
    decay = math.exp(-zeta * omega * dt)
    cosine, sine = decay * math.cos(root * dt), decay * math.sin(root * dt) / root
    x, v = b.q[k] - force, b.v[k]
    b.q[k] = force + (cosine + zeta * omega * sine) * x + sine * v
    b.v[k] = -omega * omega * sine * x + (cosine - zeta * omega * sine) * v


@inline_jit
def _own(d: Any, s: Any) -> float:
    """Return the displacement [m] of an axis without its neighbours."""
    return float(chain.displacement(d, s) - s.coupled)


@inline_jit
def couple(c: Any, b: Any, derived: Any, state: Any) -> None:
    """Set what each axis reads of the others and of the modes."""
    axes = state.size
    for j in range(axes):
        total = (c.own - 1.0) * _own(derived[j], state[j])
        for i in range(axes):
            if i != j:
                total += c.cross[i, j] * _own(derived[i], state[i])
        for k in range(BODY_MODES):
            total += c.motion[k, j] * b.q[k]
        state[j].coupled = total


@inline_jit
def advance(c: Any, b: Any, state: Any, dt: float) -> None:
    """Advance the modes over one interval of `dt` [s]."""
    axes = state.size
    soft = 1.0
    if c.softening > 0.0:
        square = 0.0
        for i in range(axes):
            square += state[i].voltage ** 2 / axes
        b.square += (square - b.square) * -math.expm1(-dt / c.softening_time)
        soft -= min(c.softening * math.sqrt(b.square) / c.softening_reference, 0.9)
    for k in range(BODY_MODES):
        force = 0.0
        for i in range(axes):
            stroke = state[i].drive_mean + state[i].slow
            if c.ferro > 0.0:
                stroke += c.ferro * (1.5 * b.gap[i] - 0.5 * b.gap_before[i])  # at mid-interval
            force += c.drive[k, i] * stroke
        _oscillate(b, k, force, soft * c.omega[k], c.zeta[k], dt)
    for i in range(axes):
        longer = 0.0
        for k in range(BODY_MODES):
            longer += c.drive[k, i] * b.q[k]
        step = longer - b.elongation[i]
        b.elongation[i] = longer
        if c.ferro > 0.0:  # exact for a straight path
            end = math.copysign(1.0 / c.ferro_beta, step)
            b.eta[i] = end + (b.eta[i] - end) * math.exp(-c.ferro_beta * abs(step))
            b.gap_before[i], b.gap[i] = b.gap[i], longer - b.eta[i]


@jit
def run(
    commands: Any, readings: Any, parameters: Any, derived: Any, state: Any, histories: Any,
    coupling: Any, body: Any, one: Any,
) -> None:  # fmt: skip
    """Measure all axes, then act on all, for every row of commands: the kernel of `AxesPlant`."""
    c, b = coupling[0], body[0]
    for n in range(commands.shape[0]):
        couple(c, b, derived, state)
        for i in range(state.size):
            one[0] = commands[n, i]
            chain.run(
                one[:1], one[1:], parameters[i : i + 1], derived[i : i + 1], state[i : i + 1],
                histories[i],
            )  # fmt: skip
            readings[n, i] = one[1]
        advance(c, b, state, derived[0].step[0])
