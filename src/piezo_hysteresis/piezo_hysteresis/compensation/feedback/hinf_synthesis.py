"""H-infinity output feedback by two Riccati equations and bisection on gamma.

Doyle, Glover, Khargonekar and Francis' central controller in the general form that allows cross
terms, for D11 = 0 and D22 = 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import linalg

from piezo_hysteresis.arrays import ComplexArray, FloatArray
from piezo_hysteresis.errors import CompensationError
from piezo_hysteresis.numerics.linalg import failing_as


@dataclass(frozen=True)
class StateSpace:
    """``x' = A x + B u, y = C x + D u``."""

    a: FloatArray
    b: FloatArray
    c: FloatArray
    d: FloatArray

    def gain(self, frequency: float) -> ComplexArray:
        """Return the complex gain matrix at `frequency` [Hz]."""
        s = 2j * np.pi * frequency
        resolved = np.linalg.solve(s * np.eye(len(self.a)) - self.a, self.b)
        return np.asarray(self.c @ resolved + self.d, dtype=np.complex128)


@dataclass(frozen=True)
class GeneralizedPlant:
    """What a controller is designed on: disturbances w, controls u, goals z, measurements y.

    ``x' = A x + B1 w + B2 u, z = C1 x + D12 u, y = C2 x + D21 w``; D12 of full column rank, D21
    of full row rank.
    """

    a: FloatArray
    b1: FloatArray
    b2: FloatArray
    c1: FloatArray
    c2: FloatArray
    d12: FloatArray
    d21: FloatArray


def ill_conditioned() -> CompensationError:
    """Return the error for a badly scaled design."""
    return CompensationError('the H-infinity problem is too ill-conditioned; scale its weights')


def _riccati(a: FloatArray, r: FloatArray, q: FloatArray) -> FloatArray | None:
    """Return the stabilising X of ``A'X + XA + XRX + Q = 0``, or None if there is none."""
    n = len(a)
    hamiltonian = np.block([[a, r], [-q, -a.T]])
    scale = max(float(np.linalg.norm(hamiltonian)), 1.0)
    eigenvalues = np.linalg.eigvals(hamiltonian)
    if np.min(np.abs(eigenvalues.real)) < 1e-12 * scale:
        return None
    _, basis, stable = linalg.schur(hamiltonian, output='real', sort='lhp')
    if stable != n:
        return None
    top, bottom = basis[:n, :n], basis[n:, :n]
    if np.linalg.cond(top) > 1e14:
        return None
    solution = np.linalg.solve(top.T, bottom.T).T
    return 0.5 * (solution + solution.T)


def _normalise(plant: GeneralizedPlant) -> tuple[GeneralizedPlant, FloatArray, FloatArray]:
    """Scale u and y so that D12'D12 = I and D21 D21' = I; return the scalings."""
    singular = CompensationError(
        'the H-infinity problem is singular: weigh every control and let every measurement be '
        'disturbed'
    )
    with failing_as(singular):
        u_scale = np.linalg.inv(np.linalg.cholesky(plant.d12.T @ plant.d12)).T
        y_scale = np.linalg.inv(np.linalg.cholesky(plant.d21 @ plant.d21.T))
    scaled = GeneralizedPlant(
        plant.a,
        plant.b1,
        plant.b2 @ u_scale,
        plant.c1,
        y_scale @ plant.c2,
        plant.d12 @ u_scale,
        y_scale @ plant.d21,
    )
    return scaled, u_scale, y_scale


def _central(plant: GeneralizedPlant, gamma: float) -> StateSpace | None:
    """Return the central controller of the normalised plant, or None if `gamma` is too small."""
    p = plant
    n = len(p.a)
    squared = gamma**-2
    ax = p.a - p.b2 @ p.d12.T @ p.c1
    qx = p.c1.T @ (np.eye(len(p.d12)) - p.d12 @ p.d12.T) @ p.c1
    x = _riccati(ax, squared * p.b1 @ p.b1.T - p.b2 @ p.b2.T, qx)
    ay = p.a - p.b1 @ p.d21.T @ p.c2
    qy = p.b1 @ (np.eye(p.d21.shape[1]) - p.d21.T @ p.d21) @ p.b1.T
    y = _riccati(ay.T, squared * p.c1.T @ p.c1 - p.c2.T @ p.c2, qy)
    if x is None or y is None:
        return None
    small = -1e-8 * max(1.0, float(np.abs(x).max()))
    if np.linalg.eigvalsh(x).min() < small:
        return None
    if np.linalg.eigvalsh(y).min() < -1e-8 * max(1.0, float(np.abs(y).max())):
        return None
    if np.abs(np.linalg.eigvals(x @ y)).max() >= gamma**2:
        return None
    f1 = squared * p.b1.T @ x
    f2 = -(p.b2.T @ x + p.d12.T @ p.c1)
    l2 = -(y @ p.c2.T + p.b1 @ p.d21.T)
    zl = np.asarray(np.linalg.solve(np.eye(n) - squared * y @ x, l2), dtype=np.float64)
    a = p.a + p.b1 @ f1 + p.b2 @ f2 + zl @ (p.c2 + p.d21 @ f1)
    return StateSpace(a, -zl, f2, np.zeros((f2.shape[0], zl.shape[1])))


def hinf_synthesis(
    plant: GeneralizedPlant, *, tolerance: float = 1e-3, margin: float = 1.02, highest: float = 1e6
) -> tuple[StateSpace, float]:
    """Design the controller ``u = K y`` that makes the gain from w to z as small as possible."""
    scaled, u_scale, y_scale = _normalise(plant)
    low, high = 0.0, 1.0
    while _central(scaled, high) is None:
        low, high = high, 2.0 * high
        if high > highest:
            raise CompensationError(
                f'there is no H-infinity controller up to gamma = {highest:g}; weaken the weights'
            )
    while high - low > tolerance * high:
        middle = 0.5 * (low + high)
        if _central(scaled, middle) is None:
            low = middle
        else:
            high = middle
    gamma = margin * high
    controller = _central(scaled, gamma)
    if controller is None:
        raise ill_conditioned()
    return (
        StateSpace(controller.a, controller.b @ y_scale, u_scale @ controller.c, controller.d),
        gamma,
    )
