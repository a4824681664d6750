"""One block with feedthrough, solved for its input sample by sample."""

from __future__ import annotations

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Block
from piezo_hysteresis.models.linear_runs import run_path, step_of

# The share of the first slope below which a slope counts as none.
_LEAST_SLOPE = 0.1
_BRACKETS = 40


class BlockInverse:
    """Solves one block with feedthrough for its input, one sample at a time, by bracketing.

    Parameters
    ----------
    block : Block
        Its output at a sample must rise with its input at the same sample.
    values : ndarray
        Its packed parameters.
    dt : float
        Sampling interval [s].
    scale : float
        Small change of the input by which slopes are measured.
    """

    def __init__(self, block: Block, values: FloatArray, dt: float, scale: float) -> None:
        # SciPy takes long to import and few chains need it; at the first sample it is too late.
        from scipy.optimize import brentq

        self._root = brentq
        self.block = block
        self._values = values
        self._dt = dt
        self._scale = scale
        self._x, self._y = np.zeros(1), np.zeros(1)
        self.clamped = 0
        self.reset()
        self.first_slope = (self.trial(scale) - self.trial(-scale)) / (2.0 * scale)

    def reset(self) -> None:
        """Go back to rest."""
        self._state = self.block.initial_state(self._dt)
        self._scratch = self._state.copy()
        self._last = 0.0
        self.clamped = 0

    def take_over(self, other: BlockInverse) -> None:
        """Go on with the memory of `other`, a block of the same kind."""
        self._state[:] = other._state
        self._last = other._last
        self.clamped = other.clamped

    def trial(self, x: float) -> float:
        """Answer the output for the input `x` without remembering it."""
        self._scratch[:] = self._state
        self._x[0] = x
        self.block.kernel(self._x, self._y, self._scratch, self._values, self._dt, 0.0)
        return float(self._y[0])

    def commit(self, x: float) -> float:
        """Answer the output for the input `x` and remember it."""
        self._last = x
        self._x[0] = x
        self.block.kernel(self._x, self._y, self._state, self._values, self._dt, 0.0)
        return float(self._y[0])

    def shape(self, x: float) -> tuple[float, float]:
        """Answer first and second derivative of output over input at `x`."""
        step = self._scale
        above, here, below = self.trial(x + step), self.trial(x), self.trial(x - step)
        return (above - below) / (2.0 * step), (above - 2.0 * here + below) / step**2

    def solve(self, target: float) -> float:
        """Answer the input nearest to the last one whose output is `target`.

        Where the output does not reach it within what the least slope allows, that bound is
        answered and counted.
        """
        start = self._last
        missing = target - self.trial(start)
        if missing == 0.0:
            return start
        least = _LEAST_SLOPE * self.first_slope
        furthest = missing / least
        near, far = start, start + missing / self.first_slope
        for _ in range(_BRACKETS):
            over = (self.trial(far) - target) * missing
            if over == 0.0:
                return far
            if over > 0.0:
                return self._between(near, far, target)
            if abs(far - start) >= abs(furthest):
                break
            near = far
            far = start + 1.5 * (far - start)
            if abs(far - start) > abs(furthest):
                far = start + furthest
        self.clamped += 1
        return start + furthest

    def _between(self, near: float, far: float, target: float) -> float:
        return float(
            self._root(lambda x: self.trial(x) - target, near, far, xtol=1e-18, rtol=1e-14)
        )


class JoinedInverse(BlockInverse):
    """The same for a linear block behind a moving structure, whose input is joined by lines.

    Parameters
    ----------
    block, values, dt, scale
        As for `BlockInverse`.
    """

    def __init__(self, block: Block, values: FloatArray, dt: float, scale: float) -> None:
        assert block.system is not None
        self._step = step_of(block.system(values), dt)
        self._line, self._answer = np.zeros(3), np.zeros(3)
        super().__init__(block, values, dt, scale)

    def trial(self, x: float) -> float:
        """Answer the output for the input `x` without remembering it."""
        self._scratch[:] = self._state
        return self._along(x, self._scratch)

    def commit(self, x: float) -> float:
        """Answer the output for the input `x` and remember it."""
        answer = self._along(x, self._state)
        self._last = x
        return answer

    def _along(self, x: float, state: FloatArray) -> float:
        self._line[:] = self._last, 0.5 * (self._last + x), x
        run_path(self._line, self._answer, state, *self._step)
        return float(self._answer[2])
