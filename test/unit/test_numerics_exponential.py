"""Matrix exponential in compiled loops against SciPy and closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from piezo_hysteresis.numerics.linalg import exponential, pace


@pytest.mark.parametrize('size', [1, 2, 5, 20])
@pytest.mark.parametrize('scale', [1e-6, 0.3, 20.0])
def test_random_matrices_agree_with_scipy(size: int, scale: float) -> None:
    matrix = scale * np.random.default_rng(size).standard_normal((size, size))
    expected = expm(matrix)
    np.testing.assert_allclose(exponential(matrix), expected, atol=1e-11 * np.abs(expected).max())


@pytest.mark.parametrize('turned', [1e-3, 0.4, 30.0, 6e3])
def test_a_mode_turns_and_decays(turned: float) -> None:
    """States whose units differ by the square of the frequency."""
    dt, zeta = 1e-3, 1e-3
    omega = turned / dt
    rate, swing = zeta * omega, omega * np.sqrt(1 - zeta**2)
    result = exponential(dt * np.array([[0.0, 1.0], [-(omega**2), -2 * rate]]))
    decay, angle = np.exp(-rate * dt), swing * dt
    first = decay * (np.cos(angle) + rate / swing * np.sin(angle))
    assert result[0, 0] == pytest.approx(first, abs=1e-15 + 1e-13 * turned * decay)
    second = decay * np.sin(angle) / swing
    assert result[0, 1] * omega == pytest.approx(
        second * omega, abs=1e-15 + 1e-13 * turned * decay
    )


def test_a_lag_that_is_over_at_once_leaves_nothing() -> None:
    result = exponential(np.array([[-1e7, 1e7], [0.0, 0.0]]))
    np.testing.assert_allclose(result, [[0.0, 1.0], [0.0, 1.0]], atol=1e-9)


@pytest.mark.parametrize('size', [1, 2, 5])
def test_the_pace_bounds_the_eigenvalues(size: int) -> None:
    matrix = np.random.default_rng(size).standard_normal((size, size))
    largest = np.abs(np.linalg.eigvals(matrix)).max()
    assert largest <= pace(matrix) * (1 + 1e-12)
    assert pace(np.array([[0.0, 1.0], [-1e6, -1.0]])) == pytest.approx(1e3, rel=0.5)


def test_nothing_is_nothing() -> None:
    assert exponential(np.zeros((0, 0))).shape == (0, 0)
    assert pace(np.zeros((0, 0))) == 0.0
