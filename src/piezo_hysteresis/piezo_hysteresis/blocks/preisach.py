"""Discretised Preisach hysteresis by its Everett function and the stored reversals."""

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Block, InterSample, Parameter, Slot
from piezo_hysteresis.jit import inline_jit, jit, scratch

LEVELS = 8  # cells along either axis of the Preisach plane
DEPTH = 64  # number of stored reversals
# state: input, output, direction, number of reversals, then reversal inputs and outputs
_HEAD = 4


@inline_jit
def everett(weights: FloatArray, table: FloatArray) -> None:
    """Fill the Everett function at the corners of the cells, shape (LEVELS+1, LEVELS+1).

    Entry (i, j) is the sum of the weights of all cells above level j and below level i.
    """
    for i in range(LEVELS + 1):
        for j in range(LEVELS + 1):
            table[i, j] = 0.0
    for i in range(LEVELS):
        for j in range(i, -1, -1):
            weight = weights[i * (i + 1) // 2 + j]
            inner = table[i, j + 1] if j < i else 0.0
            table[i + 1, j] = weight + table[i + 1, j + 1] + table[i, j] - inner


@inline_jit
def change(table: FloatArray, high: float, low: float) -> float:
    """Return the change of the output between `low` and `high`, both in cells from below.

    Bilinear within a cell, linear within the cells on the diagonal: continuous and, for positive
    weights, monotone.
    """
    if high <= low:
        return 0.0
    i = min(int(high), LEVELS - 1)
    j = min(int(low), LEVELS - 1)
    a = high - i
    b = low - j
    if i == j:
        return float(table[i + 1, i] * (a - b))
    low_edge = table[i, j] * (1.0 - b) + table[i, j + 1] * b
    high_edge = table[i + 1, j] * (1.0 - b) + table[i + 1, j + 1] * b
    return float(low_edge * (1.0 - a) + high_edge * a)


@inline_jit
def wipe_out(state: FloatArray, count: int, position: float, rising: bool) -> int:
    """Return how many reversals remain when the input has reached `position`.

    A reversal that is exceeded is wiped out together with the one after it.
    """
    while count >= 2:
        passed = state[_HEAD + 2 * (count - 2)]
        if (rising and position < passed) or (not rising and position > passed):
            break
        count -= 2
    return count


@inline_jit
def add_reversal(state: FloatArray, count: int, position: float, output: float) -> int:
    """Add a reversal; a full memory loses its smallest loop first."""
    if count == DEPTH:
        count -= 2
    state[_HEAD + 2 * count] = position
    state[_HEAD + 2 * count + 1] = output
    return count + 1


@jit
def kernel(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
) -> None:
    """Return the displacement from the demagnetised state.

    Positions are in cells from the middle. On the virgin curve (no stored reversal beyond the
    current extreme) the output is half the change between the mirrored inputs.
    """
    half = 0.5 * LEVELS
    table = scratch((LEVELS + 1, LEVELS + 1))
    everett(p[1:], table)
    position, output, rising, count = state[0], state[1], state[2] > 0.0, int(state[3])
    for k in range(x.size):
        new = min(max(x[k] / p[0] * half, -half), half)
        if new != position:
            up = new > position
            if up != rising or (count == 0 and state[2] == 0.0):
                if state[2] != 0.0:
                    count = add_reversal(state, count, position, output)
                rising = up
                state[2] = 1.0 if up else -1.0
            count = wipe_out(state, count, new, up)
            if count == 1 and abs(new) >= abs(state[_HEAD]):
                count = 0
            if count == 0:
                # along the virgin curve
                side = 1.0 if new > 0.0 else -1.0
                output = side * 0.5 * change(table, abs(new) + half, half - abs(new))
            else:
                last = state[_HEAD + 2 * (count - 1)]
                base = state[_HEAD + 2 * (count - 1) + 1]
                if up:
                    output = base + change(table, new + half, last + half)
                else:
                    output = base - change(table, last + half, new + half)
            position = new
        y[k] = output
    state[0] = position
    state[1] = output
    state[3] = count


def _weight(i: int, j: int) -> Parameter:
    return Parameter(
        f'mu_{i}_{j}',
        'm',
        2.5e-5 if i == j else 1.5e-6,
        -1.0,
        1.0,
        f'Weight of the relays that switch up in cell {i} and down in cell {j} of the range.',
        5e-6,
    )


BLOCK = Block(
    name='preisach',
    slot=Slot.HYSTERESIS,
    parameters=(
        Parameter(
            'preisach_range',
            'V',
            1.0,
            1e-9,
            1e5,
            'Input amplitude that the cells cover; beyond it the output is saturated.',
            1.0,
            follows_range=True,
        ),
        *(_weight(i, j) for i in range(LEVELS) for j in range(i + 1)),
    ),
    kernel=kernel,
    state_size=_HEAD + 2 * DEPTH,
    between=InterSample.PATH,
    description='Preisach hysteresis on a plane of 8 by 8 cells, from the demagnetised state.',
    source='reference model; classical Preisach operator by its Everett function',
)
