"""003's H-infinity feedback: mixed sensitivity on its G(s), discretised, as a link."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import linalg, signal

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.compensation.base import Limits
from piezo_hysteresis.compensation.feedback import FeedbackLink
from piezo_hysteresis.compensation.hinf_synthesis import (
    GeneralizedPlant,
    StateSpace,
    hinf_synthesis,
)
from piezo_hysteresis.errors import CompensationError

# 003 (4); its DC gain reads as mm per volt at the actuator.
XIAO_NUMERATOR = (1135e-3, 35770e-3)
XIAO_DENOMINATOR = (1.0, 3960.0, 5.046e6, 1.452e8)


@dataclass(frozen=True)
class HInfinityWeights:
    """What the closed loop shall achieve; 003 gives no weights.

    Attributes
    ----------
    bandwidth : float
        Frequency up to which errors are fought [Hz].
    steady_error : float
        Share of a constant disturbance that may remain.
    control : float
        Weight of the voltage relative to that of the error.
    delay_ticks : float
        Samples between an error and the middle of the hold that answers it; part of the plant
        that the controller is designed on.
    """

    bandwidth: float
    steady_error: float = 1e-3
    control: float = 0.05
    delay_ticks: float = 1.5

    def __post_init__(self) -> None:
        for name in ('bandwidth', 'steady_error', 'control'):
            if not getattr(self, name) > 0:
                raise CompensationError(f'the H-infinity weight {name} must be positive')
        if self.delay_ticks < 0:
            raise CompensationError('delay_ticks must be 0 or more')


def transfer_function(numerator: Sequence[float], denominator: Sequence[float]) -> StateSpace:
    """Return ``numerator(s) / denominator(s)`` in state space (companion form).

    Parameters
    ----------
    numerator, denominator : sequence of float
        Coefficients, highest power first; m/V and s.
    """
    a, b, c, d = signal.tf2ss(np.asarray(numerator), np.asarray(denominator))
    return _balanced(StateSpace(a, b, c, d))


def mixed_sensitivity(plant: StateSpace, weights: HInfinityWeights) -> GeneralizedPlant:
    """Build the problem ``|| W S; control K S || < gamma`` on a plant scaled to unit DC gain.

    ``W = omega / (s + steady_error omega)``, with omega of the bandwidth. The error enters the
    controller divided by the DC gain, i.e. in volts.

    Parameters
    ----------
    plant : StateSpace
        One input [V], one output [V, scaled], strictly proper.
    weights : HInfinityWeights
        What is wanted.
    """
    n = len(plant.a)
    omega = 2.0 * np.pi * weights.bandwidth
    a = np.zeros((n + 1, n + 1))
    a[:n, :n] = plant.a
    a[n, :n] = -plant.c[0]
    a[n, n] = -weights.steady_error * omega
    b1 = np.zeros((n + 1, 1))
    b1[n] = 1.0
    b2 = np.vstack([plant.b, [[0.0]]])
    c1 = np.zeros((2, n + 1))
    c1[0, n] = omega
    c2 = np.hstack([-plant.c, [[0.0]]])
    d12 = np.array([[0.0], [weights.control]])
    return GeneralizedPlant(a, b1, b2, c1, c2, d12, np.eye(1))


def design(plant: StateSpace, weights: HInfinityWeights, dt: float) -> tuple[StateSpace, float]:
    """Design a discrete controller from the error [m] to the voltage [V].

    Parameters
    ----------
    plant : StateSpace
        Strictly proper and stable, from [V] to [m].
    weights : HInfinityWeights
        What is wanted.
    dt : float
        Sampling interval at which the controller will run [s].

    Returns
    -------
    controller : StateSpace
        Discrete, by the bilinear rule.
    gamma : float
        Bound on the weighted gains of the continuous loop.

    Raises
    ------
    CompensationError
        If the plant is not stable or not strictly proper, or there is no controller.
    """
    if np.abs(plant.d).max() > 0:
        raise CompensationError('the H-infinity design needs a strictly proper plant')
    if np.linalg.eigvals(plant.a).real.max() >= 0:
        raise CompensationError('the H-infinity design needs a stable plant')
    steady = float(plant.gain(0.0).real[0, 0])
    if steady == 0.0:
        raise CompensationError('the plant has no gain at rest, so it cannot be controlled there')
    scaled = StateSpace(plant.a, plant.b, plant.c / steady, plant.d)
    delayed = _in_series(scaled, _pade(weights.delay_ticks * dt))
    controller, gamma = hinf_synthesis(mixed_sensitivity(_balanced(delayed), weights))
    a, b, c, d, _ = signal.cont2discrete(
        (controller.a, controller.b / steady, controller.c, controller.d), dt, method='bilinear'
    )
    return StateSpace(a, b, c, d), gamma


class HInfinity(FeedbackLink):
    """A discrete linear controller on the error as a link of the chain, 003 figure 13.

    Parameters
    ----------
    controller : StateSpace
        Discrete, from the error d - y [m] to the voltage [V]; see `design`.
    dt : float
        Sampling interval [s].
    limits, resonance
        As in `FeedbackLink`. While the voltage is cut off the state is not driven further into
        the limit.
    """

    def __init__(
        self,
        controller: StateSpace,
        dt: float,
        *,
        limits: Limits | None = None,
        resonance: float = 0.0,
    ) -> None:
        super().__init__(dt, limits, resonance)
        self._controller = controller
        self._state: FloatArray = np.zeros(len(controller.a))
        self._previous: FloatArray = self._state

    def reset(self) -> None:
        """Forget everything but the controller."""
        super().reset()
        self._state = np.zeros_like(self._state)
        self._previous = self._state

    def _law(self, error: float) -> float:
        k = self._controller
        share = float(k.c[0] @ self._state + k.d[0, 0] * error)
        self._previous = self._state
        self._state = k.a @ self._state + k.b[:, 0] * error
        return share

    def _hold(self) -> float:
        return float(self._controller.c[0] @ self._state)

    def _cut(self, excess: float) -> None:
        if excess == 0.0:
            return
        c = self._controller.c[0]
        # Only a step that pushes further beyond the limit is undone.
        if float(c @ (self._state - self._previous)) * excess < 0.0:
            self._state = self._previous


def _pade(delay: float) -> StateSpace:
    """Return the second-order Padé form of a delay [s]."""
    if delay == 0.0:
        return StateSpace(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), np.eye(1))
    t = delay
    a, b, c, d = signal.tf2ss([t * t, -6.0 * t, 12.0], [t * t, 6.0 * t, 12.0])
    return StateSpace(a, b, c, d)


def _in_series(first: StateSpace, second: StateSpace) -> StateSpace:
    a = np.block(
        [
            [first.a, np.zeros((len(first.a), len(second.a)))],
            [second.b @ first.c, second.a],
        ]
    )
    b = np.vstack([first.b, second.b @ first.d])
    c = np.hstack([second.d @ first.c, second.c])
    return StateSpace(a, b, c, second.d @ first.d)


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
