"""Structure: one to four modes; the first with nonlinear restoring and friction forces.

Every mode answers ``x'' + 2 zeta omega x' + omega^2 x = share omega^2 w`` with the free
displacement w of the ceramic, Zhou 2021 (3) divided by its mass; the displacement is their sum.
The linear part is propagated exactly, the rest (changes of w within a step, nonlinear forces of
the first mode) by a Runge-Kutta scheme of order four in the frame that moves with the linear part
(integrating factor).
"""

from __future__ import annotations

import math
from typing import Any

from piezo_hysteresis.kernels.compile import inline_jit
from piezo_sim.plant_parameters import PlantEffect, PlantParameter

MODES = 4

PARAMETERS = (
    PlantParameter(
        'structure.natural_frequency', 'Hz', 200.0, 0.1, 1e5, 'First undamped frequency.'
    ),
    PlantParameter('structure.damping_ratio', '1', 0.03, 1e-5, 50.0, 'Damping of the first mode.'),
    PlantParameter('structure.stiffness', 'N/m', 1e6, 1e-3, 1e12, 'Stiffness of the actuator.'),
    PlantParameter('structure.load_mass', 'kg', 0.2, 0.0, 1e3, 'Mass mounted on the actuator.'),
    PlantParameter(
        'structure.load_stiffness', 'N/m', 2e5, 0.0, 1e12, 'Spring that the actuator bends.'
    ),
    PlantParameter(
        'structure.cubic', '1/m^2', 2e7, -1e16, 1e16, 'Stiffening with the square of the motion.'
    ),
    PlantParameter(
        'structure.quadratic_damping', '1/m', 200.0, 0.0, 1e6, 'Drag with the speed squared.'
    ),
    PlantParameter(
        'contact.stiffness',
        '1',
        0.3,
        0.0,
        1e3,
        'Force of the stop, one reach into it, over stiffness.',
    ),
    PlantParameter(
        'contact.position', 'm', 60e-6, -1.0, 1.0, 'Displacement at which it is touched.'
    ),
    PlantParameter('contact.reach', 'm', 10e-6, 1e-9, 1.0, 'Motion that the force is given for.'),
    PlantParameter(
        'structure.pump_depth', '1', 0.2, 0.0, 0.5, 'Periodic change of the stiffness.'
    ),
    PlantParameter('structure.pump_frequency', 'Hz', 31.0, 1e-3, 1e4, 'Frequency of that change.'),
    PlantParameter(
        'structure.pump_reach', 'm', 100e-6, 1e-9, 1.0, 'Motion beyond which it fades.'
    ),
    *(
        row
        for mode, frequency, damping, share in (
            ('2', 420.0, 0.02, 0.1),
            ('3', 760.0, 0.02, 0.05),
            ('4', 1130.0, 0.02, 0.03),
        )
        for row in (
            PlantParameter(
                f'mode_{mode}.frequency', 'Hz', frequency, 0.1, 1e5, 'Undamped frequency.'
            ),
            PlantParameter(f'mode_{mode}.damping_ratio', '1', damping, 1e-5, 50.0, 'Damping.'),
            PlantParameter(
                f'mode_{mode}.share', '1', share, -1.0, 1.0, 'Share of the static motion.'
            ),
        )
    ),
    PlantParameter('friction.coulomb', 'm', 0.6e-6, 0.0, 1e-2, 'Friction force over stiffness.'),
    PlantParameter('friction.stiction', '1', 1.3, 1.0, 3.0, 'Static over sliding friction.'),
    PlantParameter(
        'friction.stribeck_speed', 'm/s', 1e-3, 1e-9, 10.0, 'Speed at which sliding rules.'
    ),
    PlantParameter('friction.presliding', 'm', 3e-6, 1e-9, 1e-2, 'Motion before it slides.'),
    PlantParameter(
        'restoring.share', '1', 0.3, 0.0, 0.95, 'Hysteretic share of the restoring force.'
    ),
    PlantParameter('restoring.beta', '1/m', 8e3, 0.0, 1e9, 'Its Bouc-Wen beta.'),
    PlantParameter('restoring.gamma', '1/m', 2e3, -1e9, 1e9, 'Its Bouc-Wen gamma.'),
)

# Forces on the first mode; they have no influence if it is inactive.
FORCES = (
    'structure.cubic', 'structure.quadratic_damping', 'structure.pump_depth',
    'friction.coulomb', 'restoring.share', 'contact.stiffness',
)  # fmt: skip

EFFECTS = (
    PlantEffect(
        'resonance',
        'The first mode moves with its inertia; off, it follows at once.',
        {'structure.natural_frequency': 0.0},
    ),
    PlantEffect('second_mode', 'A second mode.', {'mode_2.share': 0.0}),
    PlantEffect('third_mode', 'A third mode.', {'mode_3.share': 0.0}),
    PlantEffect('fourth_mode', 'A fourth mode.', {'mode_4.share': 0.0}),
    PlantEffect(
        'stiffness', 'A stiffness that changes with the motion.', {'structure.cubic': 0.0}
    ),
    PlantEffect(
        'load',
        'A mass and a spring outside the actuator.',
        {'structure.load_mass': 0.0, 'structure.load_stiffness': 0.0},
    ),
    PlantEffect(
        'friction', 'Sliding friction with presliding and stiction.', {'friction.coulomb': 0.0}
    ),
    PlantEffect(
        'restoring_hysteresis',
        'Part of the restoring force is hysteretic (Bouc-Wen oscillator).',
        {'restoring.share': 0.0},
    ),
    PlantEffect(
        'amplitude_damping',
        'Damping that grows with the motion.',
        {'structure.quadratic_damping': 0.0},
        exotic=True,
    ),
    PlantEffect(
        'contact',
        'Beyond a position the mode touches a soft body: force with the square of the way in.',
        {'contact.stiffness': 0.0},
        exotic=True,
    ),
    PlantEffect(
        'parametric_excitation',
        'The stiffness is pumped periodically.',
        {'structure.pump_depth': 0.0},
        exotic=True,
    ),
)


@inline_jit
def rate_of_change(p: Any, d: Any, s: Any) -> float:
    """Return the largest rate [1/s] of the nonlinear forces in the present state."""
    x, speed, omega = s.x[0], abs(s.v[0]), d.omega[0]
    stiff = 1.0 + 3.0 * abs(p.structure.cubic) * x * x
    rate = 2.0 * p.structure.quadratic_damping * speed
    if p.contact.stiffness > 0.0 and x > p.contact.position - p.contact.reach:
        stiff += 2.0 * p.contact.stiffness * max(x - p.contact.position, 0.0) / p.contact.reach
        rate += 10.0 * speed / p.contact.reach  # the force curve has a corner at its onset
    if p.friction.coulomb > 0.0:
        stiff += p.friction.coulomb / p.friction.presliding
        rate += speed / p.friction.presliding
        rate += 10.0 * speed * math.exp(-speed / p.friction.stribeck_speed) / p.friction.presliding
    if p.restoring.share > 0.0:
        rate += speed * (p.restoring.beta + abs(p.restoring.gamma))
    return float(omega * math.sqrt(stiff) + rate)


@inline_jit
def _force(
    p: Any, omega2: float, x: float, v: float, bristle: float, yielding: float, time: float
) -> float:
    """Return the nonlinear acceleration [m/s^2] of the first mode."""
    q = p.structure
    total = -q.quadratic_damping * abs(v) * v
    stretch = q.cubic * x * x
    if stretch < 0.0:  # softening ends at a fifth of the stiffness, so that the mode stays bounded
        stretch = 0.8 * stretch / (0.8 - stretch)
    total -= omega2 * stretch * x
    if p.contact.stiffness > 0.0 and x > p.contact.position:
        into = (x - p.contact.position) / p.contact.reach
        total -= omega2 * p.contact.stiffness * p.contact.reach * into * into
    if q.pump_depth > 0.0:
        pump = q.pump_depth * math.cos(2.0 * math.pi * q.pump_frequency * time)
        total -= omega2 * pump * x / (1.0 + (x / q.pump_reach) ** 2)
    total -= omega2 * p.friction.coulomb * bristle
    return float(total - omega2 * p.restoring.share * (yielding - x))


@inline_jit
def reversal(p: Any, d: Any, s: Any, time: float) -> float:
    """Return the estimated time [s] until the first mode reverses; 0 if it does not.

    Friction and hysteretic restoring forces have a corner there.
    """
    v, omega = s.v[0], d.omega[0]
    a = omega * omega * (d.share[0] * s.drive - s.x[0]) - 2.0 * d.zeta * omega * v
    a += _force(p, omega * omega, s.x[0], v, s.bristle, s.yielding, time)
    return -v / a if v * a < 0.0 else 0.0


@inline_jit
def _bristle_rate(p: Any, v: float, bristle: float) -> float:
    f = p.friction
    if f.coulomb == 0.0:
        return 0.0
    level = 1.0 + (f.stiction - 1.0) * math.exp(-((v / f.stribeck_speed) ** 2))
    return float((v - abs(v) * bristle / level) / f.presliding)


@inline_jit
def _yield_rate(p: Any, v: float, yielding: float) -> float:
    r = p.restoring
    if r.share == 0.0:
        return v
    return float(v - r.beta * abs(v) * yielding - r.gamma * v * abs(yielding))


@inline_jit
def _first_mode(
    p: Any, d: Any, s: Any, level: int, w0: float, wh: float, w1: float, time: float
) -> None:
    """Advance the nonlinear first mode by one step of the given level."""
    h, omega2 = d.step[level], d.omega[0] * d.omega[0]
    full, half = d.propagator[0, level], d.propagator[0, level + 1]
    drive = omega2 * d.share[0]
    rest = d.share[0] * wh
    x, v, b, z = s.x[0] - rest, s.v[0], s.bristle, s.yielding
    a1 = _force(p, omega2, x + rest, v, b, z, time) + drive * (w0 - wh)
    b1, z1 = _bristle_rate(p, v, b), _yield_rate(p, v, z)
    xe, ve = half[0] * x + half[1] * v, half[2] * x + half[3] * v
    x2, v2 = xe + 0.5 * h * half[1] * a1, ve + 0.5 * h * half[3] * a1
    bb, zz = b + 0.5 * h * b1, z + 0.5 * h * z1
    a2 = _force(p, omega2, x2 + rest, v2, bb, zz, time + 0.5 * h)
    b2, z2 = _bristle_rate(p, v2, bb), _yield_rate(p, v2, zz)
    v3 = ve + 0.5 * h * a2
    bb, zz = b + 0.5 * h * b2, z + 0.5 * h * z2
    a3 = _force(p, omega2, xe + rest, v3, bb, zz, time + 0.5 * h)
    b3, z3 = _bristle_rate(p, v3, bb), _yield_rate(p, v3, zz)
    xf, vf = full[0] * x + full[1] * v, full[2] * x + full[3] * v
    x4, v4 = xf + h * half[1] * a3, vf + h * half[3] * a3
    bb, zz = b + h * b3, z + h * z3
    a4 = _force(p, omega2, x4 + rest, v4, bb, zz, time + h) + drive * (w1 - wh)
    b4, z4 = _bristle_rate(p, v4, bb), _yield_rate(p, v4, zz)
    s.x[0] = xf + h / 6.0 * (full[1] * a1 + 2.0 * half[1] * (a2 + a3)) + rest
    s.v[0] = vf + h / 6.0 * (full[3] * a1 + 2.0 * half[3] * (a2 + a3) + a4)
    s.bristle = min(max(b + h / 6.0 * (b1 + 2.0 * (b2 + b3) + b4), -3.0), 3.0)
    s.yielding = z + h / 6.0 * (z1 + 2.0 * (z2 + z3) + z4)


@inline_jit
def step(p: Any, d: Any, s: Any, level: int, w0: float, wh: float, w1: float, time: float) -> None:
    """Advance every mode by one step; the drive w [m] at its start, middle and end."""
    first = 0
    if d.nonlinear:
        _first_mode(p, d, s, level, w0, wh, w1, time)
        first = 1
    h = d.step[level] / 6.0
    for i in range(first, MODES):
        if not d.active[i]:
            continue
        rest = d.share[i] * wh
        full = d.propagator[i, level]
        drive = d.omega[i] * d.omega[i] * d.share[i] * h
        x, v = s.x[i] - rest, s.v[i]
        s.x[i] = full[0] * x + full[1] * v + rest + drive * full[1] * (w0 - wh)
        s.v[i] = full[2] * x + full[3] * v + drive * (full[3] * (w0 - wh) + w1 - wh)
