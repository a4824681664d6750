"""Banks of play operators with equally spaced thresholds."""

from typing import Any

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.jit import inline_jit, jit

COUNT = 9  # thresholds at 0.1 .. 0.9 of the range


@jit
def play(x: float, memory: float, half_width: float) -> float:
    """Return the output of a play of `half_width` whose last output was `memory`."""
    return max(x - half_width, min(x + half_width, memory))


@jit
def plays(
    x: FloatArray, rows: FloatArray, state: FloatArray, spacing: float, first: float
) -> None:
    """Fill `rows`, shape (len(state), n), with the output of each play of `bank`."""
    for j in range(state.size):
        memory, half_width, row = state[j], (j + first) * spacing, rows[j]
        for k in range(x.size):
            memory = play(x[k], memory, half_width)
            row[k] = memory
        state[j] = memory


@inline_jit
def bank(x: float, state: FloatArray, weights: FloatArray, spacing: float, first: float) -> float:
    """Return the weighted sum of plays at thresholds (first + j) spacing; state in place."""
    # play by play: independent of the sum, so that the loop is vectorised
    for j in range(weights.size):
        state[j] = play(x, state[j], (j + first) * spacing)
    total = 0.0
    for j in range(weights.size):
        total += weights[j] * state[j]
    return total


def bank_of(first: float, more: int, straight: int) -> dict[str, Any]:
    """Return kernel and regressors of a bank with thresholds from `first` parts of the range.

    The range has as many parts as there are plays, and `more`; with `straight` 1 the bank has a
    weight of the input itself.
    """
    begin = 1 + straight  # place of the first weight

    @jit
    def kernel(
        x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
    ) -> None:
        """Return ``w0 u + sum w_j play_j(u)``; state is the outputs of the plays [V]."""
        weights = p[begin:]
        spacing = p[0] / (weights.size + more)
        for k in range(x.size):
            total = bank(x[k], state, weights, spacing, first)
            y[k] = p[1] * x[k] + total if straight else total

    @jit
    def regressors(x: FloatArray, rows: FloatArray, state: FloatArray, p: FloatArray) -> None:
        """Fill `rows` with the input, if it has a weight, and the plays."""
        if straight:
            rows[0] = x
        plays(x, rows[straight:], state, p[0] / (state.size + more), first)

    return {'kernel': kernel, 'regressors': regressors}
