"""A mode whose drive does not jump at the ticks: what a lagging amplifier makes of one."""

from dataclasses import replace
from math import exp, expm1, pi

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks._second_order import hold
from piezo_hysteresis.blocks.amplifier_lag import EFFECTS as LAG_EFFECTS
from piezo_hysteresis.blocks.base import Block, Parameter, Slot
from piezo_hysteresis.blocks.mode import BLOCK as MODE
from piezo_hysteresis.jit import jit


@jit
def kernel(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
) -> None:
    """Answer the position to a drive of which `x` says where it is at the end of each sample.

    On its way there from the end of the sample before it is an exponential, to which a mode
    answers by a multiple of it and its own oscillation. State is (position [m], velocity [m/s],
    last x [m]).
    """
    omega = 2.0 * pi * p[0]
    a11, a12, a21, a22 = hold(omega, p[1], dt)
    rate, kept, gain, whole = 0.0, 0.0, 0.0, 1.0
    if p[2] > 1e-6 * dt:  # faster than that it is there at once, as far as numbers tell
        rate, kept, whole = -1.0 / p[2], exp(-dt / p[2]), -expm1(-dt / p[2])
        size = rate * rate + 2.0 * p[1] * omega * rate + omega * omega
        if abs(size) < 1e-9 * omega * omega:  # a real pole of the mode on that of the ease
            size = 1e-9 * omega * omega
        gain = omega * omega / size
    position, velocity, last = state[0], state[1], state[2]
    for k in range(x.size):
        y[k] = position
        gap = (last - x[k]) / whole
        last = x[k]
        goal, forced = x[k] - kept * gap, gain * gap
        swing, speed = position - goal - forced, velocity - rate * forced
        position = goal + kept * forced + a11 * swing + a12 * speed
        velocity = kept * rate * forced + a21 * swing + a22 * speed
    state[0] = position
    state[1] = velocity
    state[2] = last


BLOCK = Block(
    name='eased_mode',
    slot=Slot.STRUCTURE,
    parameters=(
        *MODE.parameters,
        Parameter(
            'ease_time',
            's',
            0.0,
            0.0,
            10.0,
            'Time constant with which the drive goes to its value at the end of a sample.',
            1e-3,
        ),
    ),
    kernel=kernel,
    state_size=3,
    description='One mode of unit DC gain, exact for a drive that approaches its values.',
    source='002 (3) behind the output resistance into the capacitance of the actuator',
)

_SAMPLED = next(e for e in LAG_EFFECTS if e.variant == 'amplifier_lag_sampled')

EFFECTS = (
    replace(
        _SAMPLED,
        variant='before_mode',
        also=('mode', BLOCK),
        neutral={'sampled_lag_time': 0.0, 'ease_time': 0.0},
        start={'sampled_lag_time': 5e-4, 'ease_time': 5e-4},
        alternatives=({'sampled_lag_time': 5e-3, 'ease_time': 5e-3},),
    ),
)
