"""Xiao 2014's H-infinity feedback: mixed sensitivity on its G(s), discretised, as a link."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import linalg, signal

from piezo_hysteresis.arrays import ComplexArray, FloatArray
from piezo_hysteresis.compensation.feedback.feedback_link import (
    FeedbackLaw,
    FeedbackLink,
    HInfinityWeights,
    stepping,
)
from piezo_hysteresis.compensation.link import Limits
from piezo_hysteresis.errors import CompensationError
from piezo_hysteresis.jit import inline_jit, jit, scratch
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


@dataclass(frozen=True)
class HInfinityDesign:
    """A controller and its performance.

    Attributes
    ----------
    controller : StateSpace
        Discrete, from the error [m] to the voltage [V].
    gamma : float
        Bound on the weighted gains of the loop; up to 1 the weights are met.
    weights : HInfinityWeights
        The specified weights.
    """

    controller: StateSpace
    gamma: float
    weights: HInfinityWeights

    @property
    def poles(self) -> ComplexArray:
        """Poles of the controller in z, the largest first."""
        found = np.linalg.eigvals(self.controller.a)
        return np.asarray(found[np.argsort(-np.abs(found))], dtype=np.complex128)

    @property
    def met(self) -> bool:
        """Whether the loop satisfies the weights."""
        return self.gamma <= 1.0

    @property
    def stable(self) -> bool:
        """Whether the controller stays finite by itself, without a plant or while it is cut."""
        return bool(abs(self.poles[0]) < 1.0)

    def words(self) -> str:
        """Return gamma and poles in a sentence."""
        largest = ', '.join(f'{abs(pole):.6g}' for pole in self.poles[:3])
        met = 'weights met' if self.met else 'weights missed'
        return f'H-infinity: gamma {self.gamma:.3g} ({met}), largest controller poles {largest}'

    def require_usable(self) -> HInfinityDesign:
        """Return the design, or refuse one that violates the weights.

        Raises
        ------
        CompensationError
            If the weights are missed or the controller is unstable.
        """
        asked = self.weights
        if not self.met:
            raise CompensationError(
                f'no H-infinity controller reaches {asked.bandwidth:g} Hz with these weights: '
                f'gamma is {self.gamma:.3g} and should be 1 or less; lower the bandwidth, or '
                'raise peak or steady_error'
            )
        if not self.stable:
            raise CompensationError(
                f'the H-infinity controller would be unstable (a pole at '
                f'{abs(self.poles[0]):.4g}) and diverge if the sensor or the voltage is '
                'constant; raise control or lower the bandwidth'
            )
        return self


def transfer_function(numerator: Sequence[float], denominator: Sequence[float]) -> StateSpace:
    """Return ``numerator(s) / denominator(s)`` in companion form, Xiao 2014 (5).

    Parameters
    ----------
    numerator, denominator : sequence of float
        Coefficients, highest power first; m/V and s.
    """
    a, b, c, d = signal.tf2ss(np.asarray(numerator), np.asarray(denominator))
    return _balanced(StateSpace(a, b, c, d))


def mixed_sensitivity(plant: StateSpace, weights: HInfinityWeights, dt: float) -> GeneralizedPlant:
    """Build the problem ``|| W S; control K S || < gamma`` on a plant scaled to unit DC gain.

    ``W = (s / peak + omega) / (s + steady_error omega) / (1 + s dt / 2)`` with omega of the
    bandwidth: with gamma below 1 the `weights` are satisfied. A direct path of the plant is part
    of the weighted error but not of the measured one: it can be closed around the controller
    afterwards.

    Parameters
    ----------
    plant : StateSpace
        One input and one output, scaled to unit DC gain.
    weights : HInfinityWeights
        Specified weights.
    dt : float
        Sampling interval [s]; the weights end at the sampling rate.
    """
    omega = 2.0 * np.pi * weights.bandwidth
    pole = weights.steady_error * omega
    weight = transfer_function(
        [1.0 / weights.peak, omega], [0.5 * dt, 1.0 + 0.5 * dt * pole, pole]
    )
    n, m = len(plant.a), len(weight.a)
    a = np.block([[plant.a, np.zeros((n, m))], [-weight.b @ plant.c, weight.a]])
    return GeneralizedPlant(
        a=a,
        b1=np.vstack([np.zeros((n, 1)), weight.b]),
        b2=np.vstack([plant.b, -weight.b @ plant.d]),
        c1=np.vstack([np.hstack([np.zeros((1, n)), weight.c]), np.zeros((1, n + m))]),
        c2=np.hstack([-plant.c, np.zeros((1, m))]),
        d12=np.array([[0.0], [weights.control]]),
        d21=np.eye(1),
    )


def design(plant: StateSpace, weights: HInfinityWeights, dt: float) -> HInfinityDesign:
    """Design a discrete controller from the error [m] to the voltage [V].

    Parameters
    ----------
    plant : StateSpace
        Strictly proper and stable, from [V] to [m].
    weights : HInfinityWeights
        Specified weights.
    dt : float
        Sampling interval at which the controller will run [s].

    Returns
    -------
    HInfinityDesign
        Discrete by the bilinear rule; check it with `HInfinityDesign.require_usable`.

    Raises
    ------
    CompensationError
        If the plant is not stable or not strictly proper, the bandwidth lies beyond half the
        sampling rate, or there is no controller.
    """
    if weights.bandwidth >= 0.5 / dt:
        raise CompensationError(
            f'a bandwidth of {weights.bandwidth:g} Hz lies beyond half the sampling rate, '
            f'{0.5 / dt:g} Hz; lower it'
        )
    with failing_as(ill_conditioned()):
        return _design(plant, weights, dt)


def _design(plant: StateSpace, weights: HInfinityWeights, dt: float) -> HInfinityDesign:
    if np.abs(plant.d).max() > 0:
        raise CompensationError('the H-infinity design needs a strictly proper plant')
    if np.linalg.eigvals(plant.a).real.max() >= 0:
        raise CompensationError('the H-infinity design needs a stable plant')
    steady = float(plant.gain(0.0).real[0, 0])
    if steady == 0.0:
        raise CompensationError('the plant has no gain at rest, so it cannot be controlled there')
    sampled = _sampled(StateSpace(plant.a, plant.b, plant.c / steady, plant.d), dt, weights)
    frequency_plane = _balanced(_to_w_plane(sampled, dt))
    inner, gamma = hinf_synthesis(mixed_sensitivity(frequency_plane, weights, dt))
    # The design left the direct path of the plant out; it is closed around the controller here.
    path = frequency_plane.d
    controller = StateSpace(inner.a + inner.b @ path @ inner.c, inner.b / steady, inner.c, inner.d)
    a, b, c, d, _ = signal.cont2discrete(
        (controller.a, controller.b, controller.c, controller.d), dt, method='bilinear'
    )
    return HInfinityDesign(StateSpace(a, b, c, d), gamma, weights)


# The parameters begin with their number of states and the direct path; A row by row, B, C and the
# gain of the observer follow. The memory is the state.
_STATES, _DIRECT, _A = range(3)


@jit
def controlled(error: float, memory: FloatArray, p: FloatArray, dt: float) -> float:
    """Return the share of the voltage [V] and move the state on."""
    n = int(p[_STATES])
    entry = _A + n * n
    share, moved = hold(memory, p) + p[_DIRECT] * error, scratch(n)
    for i in range(n):
        total = p[entry + i] * error
        for j in range(n):
            total += p[_A + n * i + j] * memory[j]
        moved[i] = total
    for i in range(n):
        memory[i] = moved[i]
    return float(share)


@inline_jit
def hold(memory: FloatArray, p: FloatArray) -> float:
    """Return the share without a measurement: that of the state [V]."""
    n = int(p[_STATES])
    row, total = _A + n * n + n, 0.0
    for i in range(n):
        total += p[row + i] * memory[i]
    return total


@inline_jit
def cut(excess: float, memory: FloatArray, p: FloatArray, dt: float) -> None:
    """Anti-windup: let the state follow the limited voltage [V]."""
    n = int(p[_STATES])
    gain = _A + n * n + 2 * n
    if excess != 0.0:
        for i in range(n):
            memory[i] += p[gain + i] * excess


_COMPILED = stepping(FeedbackLaw(controlled, hold, cut))


class HInfinity(FeedbackLink):
    """A discrete linear controller on the error as a link of the chain, Xiao 2014 figure 13.

    Parameters
    ----------
    controller : StateSpace
        Discrete, from the error d - y [m] to the voltage [V]; see `design`.
    dt : float
        Sampling interval [s].
    limits : Limits, optional
        As in `FeedbackLink`; while the voltage is limited the state follows the limit.
    words : str
        Log text on activation.
    """

    def __init__(
        self, controller: StateSpace, dt: float, *, limits: Limits | None = None, words: str = ''
    ) -> None:
        k = controller
        packed = np.concatenate(
            [(len(k.a), k.d[0, 0]), k.a.ravel(), k.b[:, 0], k.c[0], _observer_gain(k)]
        )
        super().__init__(dt, limits, _COMPILED, packed, len(k.a))
        self.words = words


def _observer_gain(controller: StateSpace) -> FloatArray:
    """Return the gain with which the state follows the voltage that was really applied.

    The stationary Kalman gain for noise that enters like the error: the state then moves as if
    the error had been one that the limits allow.
    """
    k = controller
    noise = 1e-3 * (k.c @ k.b @ k.b.T @ k.c.T + k.d @ k.d.T)
    with failing_as(ill_conditioned()):
        covariance = linalg.solve_discrete_are(k.a.T, k.c.T, k.b @ k.b.T, noise)
    gain = k.a @ covariance @ k.c.T / (k.c @ covariance @ k.c.T + noise)
    return np.asarray(gain[:, 0], dtype=np.float64)


def _sampled(plant: StateSpace, dt: float, weights: HInfinityWeights) -> StateSpace:
    """Return the plant behind the hold, read `delay_ticks` samples late."""
    a, b, c, _, _ = signal.cont2discrete((plant.a, plant.b, plant.c, plant.d), dt)
    n, late = len(a), weights.delay_ticks
    whole = np.zeros((n + late, n + late))
    whole[:n, :n] = a
    outputs = np.vstack([c @ np.eye(n, n + late), np.eye(n + late)[n:]])
    whole[n:] = outputs[:late]
    entry = np.vstack([b, np.zeros((late, 1))])
    return StateSpace(whole, entry, outputs[late:], np.zeros((1, 1)))


def _to_w_plane(system: StateSpace, dt: float) -> StateSpace:
    """Return the continuous system of which `system` is the bilinear transform.

    Stability and the largest gain are the same in both, so a controller designed there and
    transformed back keeps its guarantees at any sampling rate.
    """
    inverse = np.linalg.inv(system.a + np.eye(len(system.a)))
    scale = 2.0 / np.sqrt(dt)
    return StateSpace(
        2.0 / dt * (system.a - np.eye(len(system.a))) @ inverse,
        scale * inverse @ system.b,
        scale * system.c @ inverse,
        system.d - system.c @ inverse @ system.b,
    )


def _balanced(system: StateSpace) -> StateSpace:
    """Scale the states so that the Riccati solvers see numbers of one size."""
    n = len(system.a)
    joint = np.zeros((n + 1, n + 1))
    joint[:n, :n] = system.a
    joint[:n, n:] = system.b
    joint[n:, :n] = system.c
    _, (scale, _) = linalg.matrix_balance(joint, permute=False, separate=True)
    t = scale[:n] / scale[n]
    return StateSpace(
        system.a * t[None, :] / t[:, None], system.b / t[:, None], system.c * t[None, :], system.d
    )
