"""Banks of play operators with equally spaced thresholds."""

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
