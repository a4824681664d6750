"""Oscillator with a hysteretic restoring force: force as input, displacement as output."""

from collections.abc import Mapping
from math import ceil, pi, sqrt

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import (
    Block,
    InnerMode,
    InterSample,
    InverseRole,
    Parameter,
    Slot,
)
from piezo_hysteresis.blocks.effect import Effect, Residual
from piezo_hysteresis.jit import inline_jit, jit, scratch
from piezo_hysteresis.numerics.linalg import solve_square

_PHASES = 20  # points between two samples at which the force is interpolated
_TAPS = 12  # past samples used by the interpolation
_BAND = 0.45  # share of the Nyquist frequency up to which it is accurate
_STRIDE = 0.15  # longest step in units of the fastest time constant


def _interpolator() -> FloatArray:
    """Return least-squares weights, shape (_TAPS, _PHASES + 1), newest sample first.

    Column i gives the value at i/_PHASES of the interval between the last two samples. Only past
    samples are used, so that single samples and a whole record give the same result; for a
    band-limited input the error is 1e-4 of the output at 0.4 of the Nyquist frequency.
    """
    frequencies = np.linspace(0.0, pi * _BAND, 400)
    basis = np.exp(-1j * np.outer(frequencies, np.arange(_TAPS)))
    normal = (basis.conj().T @ basis).real / frequencies.size + 1e-8 * np.eye(_TAPS)
    shifts = np.arange(_PHASES + 1) / _PHASES - 1.0
    target = np.exp(1j * np.outer(frequencies, shifts))
    weights = solve_square(normal, (basis.conj().T @ target).real / frequencies.size).values.T
    weights[-1] = np.eye(_TAPS)[0]
    weights[0] = np.eye(_TAPS)[1]
    return np.ascontiguousarray((weights / weights.sum(axis=1, keepdims=True)).T)


WEIGHTS = _interpolator()


@inline_jit
def interpolate(past: FloatArray, order: float, forces: FloatArray) -> None:
    """Fill `forces` (_PHASES + 1,) with the input between the last two samples of `past`."""
    if order == 0.0:
        for i in range(forces.size):
            forces[i] = past[1]
    elif order == 1.0:
        for i in range(_PHASES + 1):
            forces[i] = past[1] + (past[0] - past[1]) * i / _PHASES
    else:
        forces[:] = 0.0
        for j in range(_TAPS):
            weight = WEIGHTS[j]
            for i in range(_PHASES + 1):
                forces[i] += weight[i] * past[j]


@inline_jit
def rates(
    x: float, v: float, z: float, force: float, p: FloatArray, height: float
) -> tuple[float, float]:
    """Return (v', z') of ``m x'' + c x' + k x + z = F``; p[0] is 1/m here."""
    size = abs(z)
    if p[6] != 1.0 and height > 0.0:
        size *= max(size / height, 1e-9) ** (p[6] - 1.0)
    signed = size if z > 0.0 else -size
    dz = p[3] * v - p[4] * abs(v) * signed - p[5] * v * size
    return (force - p[1] * v - p[2] * x - z) * p[0], dz


@inline_jit
def advance(
    x: float,
    v: float,
    z: float,
    f: tuple[float, float, float],
    h: float,
    p: FloatArray,
    height: float,
) -> tuple[float, float, float]:
    """Return (x, v, z) after one Runge-Kutta step with forces at its start, middle and end."""
    a1, z1 = rates(x, v, z, f[0], p, height)
    v2 = v + 0.5 * h * a1
    a2, z2 = rates(x + 0.5 * h * v, v2, z + 0.5 * h * z1, f[1], p, height)
    v3 = v + 0.5 * h * a2
    a3, z3 = rates(x + 0.5 * h * v2, v3, z + 0.5 * h * z2, f[1], p, height)
    v4 = v + h * a3
    a4, z4 = rates(x + h * v3, v4, z + h * z3, f[2], p, height)
    return (
        x + h / 6.0 * (v + 2.0 * v2 + 2.0 * v3 + v4),
        v + h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4),
        z + h / 6.0 * (z1 + 2.0 * z2 + 2.0 * z3 + z4),
    )  # fmt: skip


@jit
def fastest(p: FloatArray) -> float:
    """Return the fastest rate of the oscillator [1/s]."""
    return float(sqrt((p[2] + abs(p[3])) / p[0]) + p[1] / p[0])


@jit
def kernel(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
) -> None:
    """Return the displacement at each sample; state is (x, v, z, last inputs, newest first)."""
    scale = abs(p[4]) + abs(p[5])
    height = abs(p[3]) / scale if scale > 0.0 else 0.0
    # number of steps between two interpolated forces for the structure
    finer = max(1, ceil(min(fastest(p) * dt / (_PHASES // 2 * _STRIDE), 10000.0)))
    h = dt / (_PHASES // 2 * finer)
    share = 1.0 / finer
    q = scratch(p.size)
    for i in range(p.size):
        q[i] = p[i]
    q[0] = 1.0 / p[0]
    forces = scratch(_PHASES + 1)
    position, velocity, z, past = state[0], state[1], state[2], state[3:]
    for k in range(x.size):
        for j in range(_TAPS - 1, 0, -1):
            past[j] = past[j - 1]
        past[0] = x[k]
        interpolate(past, p[7], forces)
        for i in range(0, _PHASES, 2):
            f0, f1, f2 = forces[i], forces[i + 1], forces[i + 2]
            # parabola through the three, so that finer steps have no corners
            slope, bend = f2 - f0, 2.0 * (f2 - 2.0 * f1 + f0)
            for part in range(finer):
                t0 = part * share
                t1, t2 = t0 + 0.5 * share, t0 + share
                between = (
                    f0 + t0 * (slope - bend * (1.0 - t0)),
                    f0 + t1 * (slope - bend * (1.0 - t1)),
                    f0 + t2 * (slope - bend * (1.0 - t2)),
                )
                position, velocity, z = advance(position, velocity, z, between, h, q, height)
        y[k] = position
    state[0] = position
    state[1] = velocity
    state[2] = z


@jit
def along(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float,
    points: int,
) -> None:  # fmt: skip
    """Return the displacement along a path of the force, three points per step."""
    scale = abs(p[4]) + abs(p[5])
    height = abs(p[3]) / scale if scale > 0.0 else 0.0
    steps = points // 3
    finer = max(1, ceil(min(fastest(p) * dt / (steps * _STRIDE), 10000.0)))
    share = 1.0 / finer
    h = dt / steps * share
    q = scratch(p.size)
    for i in range(p.size):
        q[i] = p[i]
    q[0] = 1.0 / p[0]
    position, velocity, z = state[0], state[1], state[2]
    for k in range(0, x.size, 3):
        f0, slope = x[k], x[k + 2] - x[k]
        bend = 2.0 * (x[k + 2] - 2.0 * x[k + 1] + x[k])
        y[k] = position
        for part in range(finer):
            t0 = part * share
            t1, t2 = t0 + 0.5 * share, t0 + share
            between = (
                f0 + t0 * (slope - bend * (1.0 - t0)),
                f0 + t1 * (slope - bend * (1.0 - t1)),
                f0 + t2 * (slope - bend * (1.0 - t2)),
            )
            before, speed = position, velocity
            position, velocity, z = advance(position, velocity, z, between, h, q, height)
            if 2 * part + 2 == finer:
                y[k + 1] = position
            elif 2 * part + 1 == finer:
                y[k + 1] = 0.5 * (before + position) + 0.125 * h * (speed - velocity)
        y[k + 2] = position
    state[0] = position
    state[1] = velocity
    state[2] = z


_ORDER = 'interpolation'


def place_of_order(block: Block) -> int | None:
    """Return the place of the order by which a block interpolates its input; None if it is held.

    The order is 0 for held, 1 for linear, 2 for band-limited between the samples.
    """
    names = [each.name for each in block.parameters]
    return names.index(_ORDER) if _ORDER in names else None


def check(values: Mapping[str, float]) -> str:
    """Return '' or the reason why the restoring force is invalid."""
    if values['stiffness'] + values['z_alpha'] <= 0.0:
        return 'stiffness + z_alpha must be positive, or it is unstable; increase either'
    stiffest = values['stiffness'] + abs(values['z_alpha'])
    if values['damping'] > 100.0 * sqrt(stiffest * values['mass']):
        return 'the damping is over 50 times critical; use a model without inertia'
    return ''


BLOCK = Block(
    name='bouc_wen_oscillator',
    role=InverseRole.OSCILLATOR,
    slot=Slot.STRUCTURE,
    parameters=(
        Parameter('mass', 'kg', 0.25, 1e-9, 1e5, 'Moving mass m.', 0.2, powers=(1, -1)),
        Parameter('damping', 'N*s/m', 1.2, 0.0, 1e9, 'Viscous damping c.', 1.0, powers=(1, -1)),
        Parameter(
            'stiffness', 'N/m', 7e3, 0.0, 1e12, 'Stiffness k without hysteresis.', 7e3,
            powers=(1, -1),
        ),
        Parameter(
            'z_alpha', 'N/m', 3e3, -1e12, 1e12, 'Growth of the hysteretic force z with x.', 5e3,
            powers=(1, -1),
        ),
        Parameter(
            'z_beta', '1/m', 3e3, 0.0, 1e9,
            'Decay of z with the length of the travel (beta gamma of the benchmark).', 5e3,
        ),
        Parameter(
            'z_gamma', '1/m', 0.0, -1e9, 1e9,
            'Decay of z with the travel (beta delta of the benchmark).', 5e3,
        ),
        Parameter('z_exponent', '1', 1.0, 0.5, 10.0, 'Exponent nu of the hysteresis.', 1.0),
        Parameter(
            _ORDER, '1', 2.0, 0.0, 2.0,
            'Force between samples: 0 held, 1 linear, 2 band-limited (content up to 0.45 of the '
            'Nyquist frequency).',
        ),
    ),
    kernel=kernel,
    state_size=3 + _TAPS,
    between=InterSample.INNER,
    unknown=(0, 1, 2),
    path_kernel=along,
    mode=InnerMode(fastest),
    description=(
        "m x'' + c x' + k x + z = F with z' = z_alpha x' - (z_beta |x'| z + z_gamma x' |z|) "
        '|z/z_s|^(z_exponent - 1), z_s = |z_alpha|/(|z_beta| + |z_gamma|).'
    ),
    source='Bouc-Wen benchmark of nonlinearbenchmark.org, restoring-force form',
    check=check,
)  # fmt: skip


def from_linear(values: Mapping[str, float]) -> dict[str, float]:
    """Convert a gain and a mode, ``A1 [m/N], natural_frequency, damping_ratio``."""
    stiffness = 1.0 / max(values['A1'], 1e-12)
    omega = 2.0 * pi * values['natural_frequency']
    mass = stiffness / omega**2
    return {
        'mass': mass,
        'damping': 2.0 * values['damping_ratio'] * omega * mass,
        'stiffness': stiffness,
    }


def guess(seen: Residual) -> list[dict[str, float]]:
    """Return start values with part of the stiffness yielding within the measured motion."""
    linear = from_linear(seen.values)
    reach = float(np.max(np.abs(seen.simulated + seen.residual)))
    if reach <= 0.0:
        return []
    return [
        {
            **linear,
            'stiffness': (1.0 - 0.7 * share) * linear['stiffness'],
            'z_alpha': share * linear['stiffness'],
            'z_beta': 1.0 / reach,
            'z_gamma': shape / reach,
        }
        for share in (0.3, 1.0)
        for shape in (-0.9, 0.0, 0.9)
    ]


EFFECTS = tuple(
    Effect(
        name='hysteresis',
        variant=variant,
        block=BLOCK,
        replaces=('mode', 'gain'),
        inexactness=0.07,  # one loop represents those of many domains
        convert=from_linear,
        holds={'z_exponent': 1.0, 'interpolation': interpolation},
        neutral={'z_alpha': 0.0},
        starts=(
            {'z_alpha': 2e3, 'z_beta': 5e3, 'z_gamma': 0.0},
            {'z_gamma': -5e3},
            {'z_gamma': 5e3},
        ),
        guess=guess,
        physics=(
            'The spring itself has memory: the restoring force lags behind the displacement, so '
            'resonance frequency and damping change with the amplitude.'
        ),
        experiment=(
            'Multisines at several levels: hysteresis of the force moves the resonance with the '
            'amplitude, hysteresis of the input does not.'
        ),
        mistaken_for=('stiffness', 'friction', 'resonance'),
    )
    for variant, interpolation in (('restoring_force', 2.0), ('restoring_force_held_input', 0.0))
)
