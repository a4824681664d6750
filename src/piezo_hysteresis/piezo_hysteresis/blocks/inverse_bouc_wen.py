"""Bouc-Wen hysteresis from displacement to voltage, solved for the displacement.

Xiao 2014 identifies the inverse directly: the voltage is a Bouc-Wen function of the displacement.
That law is the compensator; solved for the displacement at every sample it is also a model.
"""

from collections.abc import Mapping

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks._bouc_wen import exact_step
from piezo_hysteresis.blocks.base import Block, InterSample, InverseRole, Parameter, Slot
from piezo_hysteresis.jit import inline_jit, jit

KNOTS = 10  # slopes for which Xiao 2014 identifies parameters


@inline_jit
def steepness(h: float, side: float, a: float, a0: float, beta: float, gamma: float) -> float:
    """Return dh/dx while x moves in the direction `side`."""
    return a + side * a0 - beta * side * h - gamma * abs(h)


@inline_jit
def solve_step(
    needed: float, h: float, gain: float, a: float, a0: float, beta: float, gamma: float
) -> float:
    """Return the move d of x for which ``gain x - h`` grows by `needed`.

    Newton's method on the exact step, limited to a bracket. The slope of ``gain x - h`` must be
    positive; otherwise the end of the bracket is returned after a number of doublings.
    """
    if needed == 0.0:
        return 0.0
    side = 1.0 if needed > 0.0 else -1.0
    slope = gain - steepness(h, side, a, a0, beta, gamma)
    d = needed / slope if slope > 0.0 else needed / gain
    low, high = 0.0, d
    for _ in range(60):
        if side * (gain * high - (exact_step(h, high, a, a0, beta, gamma) - h) - needed) >= 0.0:
            break
        low = high
        high *= 2.0
    for _ in range(60):
        moved = exact_step(h, d, a, a0, beta, gamma)
        error = gain * d - (moved - h) - needed
        if side * error > 0.0:
            high = d
        else:
            low = d
        slope = gain - steepness(moved, side, a, a0, beta, gamma)
        new = d - error / slope if slope > 0.0 else 0.5 * (low + high)
        if side * (new - low) < 0.0 or side * (high - new) < 0.0:
            new = 0.5 * (low + high)
        if abs(new - d) <= 1e-8 * abs(d):
            return new  # quadratic convergence: the remaining error is below rounding
        d = new
    return d


@jit
def kernel(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
) -> None:
    """Return the displacement; state is (displacement [m], h [V])."""
    gain, a, beta, gamma = p[0], p[1], p[2], p[3]
    position, h = state[0], state[1]
    for k in range(x.size):
        d = solve_step(x[k] - (gain * position - h), h, gain, a, 0.0, beta, gamma)
        h = exact_step(h, d, a, 0.0, beta, gamma)
        position += d
        y[k] = position
    state[0] = position
    state[1] = h


@inline_jit
def at_place(p: FloatArray, first: int, place: float) -> float:
    """Return a parameter of the selector, linear between its knots."""
    i = min(int(place), KNOTS - 2)
    return float(p[first + i] + (place - i) * (p[first + i + 1] - p[first + i]))


@inline_jit
def selected_step(d: float, h: float, p: FloatArray, dt: float) -> tuple[float, float]:
    """Return the increase of the voltage for a move `d` within `dt`, and h after it."""
    place = min(max(abs(d) / dt / p[0] * KNOTS - 1.0, 0.0), KNOTS - 1.0)
    a = at_place(p, 1 + KNOTS, place)
    beta = at_place(p, 1 + 2 * KNOTS, place)
    gamma = at_place(p, 1 + 3 * KNOTS, place)
    moved = exact_step(h, d, a, 0.0, beta, gamma)
    rise: float = at_place(p, 1, place) * d - (moved - h)
    return rise, moved


@inline_jit
def solve_selected(needed: float, h: float, p: FloatArray, dt: float) -> float:
    """Return the smallest move d that increases the voltage by `needed`, by the row of its slope.

    It is searched from knot to knot, and between two knots by the regula falsi (Illinois).
    """
    if needed == 0.0:
        return 0.0
    side = 1.0 if needed > 0.0 else -1.0
    apart = side * p[0] / KNOTS * dt
    low, below = 0.0, -abs(needed)
    d = apart
    for i in range(2, 60):
        above = side * selected_step(d, h, p, dt)[0] - abs(needed)
        if above >= 0.0:
            break
        low, below = d, above
        d = i * apart if i <= KNOTS else 2.0 * d
    high, before = d, 0.0
    for _ in range(60):
        if not above > below:
            break
        d = low - below * (high - low) / (above - below)
        error = side * selected_step(d, h, p, dt)[0] - abs(needed)
        if abs(error) <= 1e-12 * abs(needed) or abs(high - low) <= 1e-12 * abs(high):
            break
        if error > 0.0:
            high, above = d, error
            below *= 0.5 if before > 0.0 else 1.0
        else:
            low, below = d, error
            above *= 0.5 if before < 0.0 else 1.0
        before = error
    return float(d)


@jit
def selector_along(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float,
    points: int,
) -> None:  # fmt: skip
    """Return the displacement; state is (displacement [m], h [V], voltage of the law [V]).

    A move uses the row of its own slope, as in the compensator. With the row of the previous move,
    a free run is chaotic where the table changes faster than the slope. Voltage and h are kept
    when the parameters change.
    """
    position, h, voltage = state[0], state[1], state[2]
    part = dt / points
    for k in range(x.size):
        d = solve_selected(x[k] - voltage, h, p, part)
        rise, h = selected_step(d, h, p, part)
        voltage += rise
        position += d
        y[k] = position
    state[0] = position
    state[1] = h
    state[2] = voltage


def monotone(gain: float, a: float, beta: float, gamma: float) -> str:
    """Return '' or the reason why the voltage does not increase with the displacement."""
    if a == 0.0:
        return ''
    if beta + gamma <= 0.0:
        return 'inverse_beta + inverse_gamma must be positive, or h grows without bound'
    # h grows fastest from zero or from its saturation on the other side
    if a > 0.0 and a * max(1.0, 2.0 * beta / (beta + gamma)) >= gain:
        return (
            f'inverse_A = {a:.4g} makes the voltage fall while the displacement rises; keep it '
            'below inverse_gain and inverse_gain (beta + gamma)/(2 beta)'
        )
    return ''


def check(values: Mapping[str, float]) -> str:
    """Return '' or the reason why the law cannot be solved for the displacement."""
    return monotone(
        values['inverse_gain'],
        values['inverse_A'],
        values['inverse_beta'],
        values['inverse_gamma'],
    )


def selector_check(values: Mapping[str, float]) -> str:
    """Return '' or the reason why the law cannot be solved at one of the knots."""
    for i in range(1, KNOTS + 1):
        reason = monotone(
            values[f'inverse_gain_at{i}'],
            values[f'inverse_A_at{i}'],
            values[f'inverse_beta_at{i}'],
            values[f'inverse_gamma_at{i}'],
        )
        if reason:
            return f'at knot {i}, {reason}'
    return ''


PARAMETERS = (
    Parameter('inverse_gain', 'V/m', 7e3, 1e-3, 1e12, 'Voltage per displacement without h.', 7e3),
    Parameter('inverse_A', 'V/m', -2e3, -1e12, 1e12, 'Growth of h with the displacement.', 2e3),
    Parameter(
        'inverse_beta', '1/m', 1e4, 0.0, 1e10, 'Decay of h with the length of the path.', 1e4
    ),
    Parameter('inverse_gamma', '1/m', 0.0, -1e10, 1e10, 'Decay of h with the displacement.', 1e4),
)


def _knots() -> tuple[Parameter, ...]:
    return tuple(
        Parameter(
            f'{q.name}_at{i}', q.unit, q.default, q.low, q.high,
            f'{q.description[:-1]}, at {i / KNOTS:g} of selector_slope.', q.scale,
        )
        for q in PARAMETERS
        for i in range(1, KNOTS + 1)
    )  # fmt: skip


BLOCKS = (
    Block(
        name='inverse_bouc_wen',
        role=InverseRole.SELECTOR,
        slot=Slot.HYSTERESIS,
        parameters=PARAMETERS,
        kernel=kernel,
        state_size=2,
        between=InterSample.PATH,
        unknown=(1,),
        description=(
            'u = inverse_gain y - h, dh = inverse_A dy - inverse_beta |dy| h - inverse_gamma dy '
            '|h|, solved for y.'
        ),
        source='Xiao 2014, inverse Bouc-Wen',
        check=check,
    ),
    Block(
        name='inverse_selector',
        role=InverseRole.SELECTOR,
        slot=Slot.HYSTERESIS,
        parameters=(
            Parameter(
                'selector_slope',
                'm/s',
                0.05,
                1e-12,
                1e3,
                'Slope of the displacement at the last of ten equally spaced knots.',
                0.05,
                follows_range=True,
            ),
            *_knots(),
        ),
        state_size=3,
        between=InterSample.PATH,
        unknown=(1,),
        path_kernel=selector_along,
        description='Inverse Bouc-Wen whose parameters follow the slope of the displacement.',
        source='Xiao 2014 (selector between ten triangle fits)',
        check=selector_check,
    ),
)

SINGLE, SELECTOR = BLOCKS
