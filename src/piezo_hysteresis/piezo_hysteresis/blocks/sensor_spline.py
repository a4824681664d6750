"""Nonlinear sensor: cubic spline."""

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Block, InterSample, Parameter, Slot
from piezo_hysteresis.blocks.effect import Coverage, Effect
from piezo_hysteresis.jit import inline_jit, jit

# Knots as shares of the range: five pieces of equal length over the stroke.
_INNER, _OUTER = 0.2, 0.6


@inline_jit
def _beyond(x: float, knot: float) -> float:
    return x - knot if x > knot else 0.0


@inline_jit
def _at(v: float, p: FloatArray) -> tuple[float, float]:
    """Return the reading for a displacement `v` and its slope."""
    inner, outer = _INNER * p[0], _OUTER * p[0]
    high, far_high = _beyond(v, inner), _beyond(v, outer)
    low, far_low = _beyond(-v, inner), _beyond(-v, outer)
    bends = p[3] * high**3 + p[4] * low**3 + p[5] * far_high**3 + p[6] * far_low**3
    steeper = p[3] * high**2 - p[4] * low**2 + p[5] * far_high**2 - p[6] * far_low**2
    value = v + (p[1] + p[2] * v) * v * v + bends
    return value, 1.0 + (2.0 * p[1] + 3.0 * p[2] * v) * v + 3.0 * steeper


@jit
def kernel(
    x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, dt: float, frequency: float
) -> None:
    """Return the cubic of the middle piece with additional terms beyond the knots; no state."""
    for k in range(x.size):
        y[k] = _at(x[k], p)[0]


def _bend(name: str, where: str, scale: float) -> Parameter:
    what = f'Cubic that the error gains {where} spline_range.'
    return Parameter(name, '1/m^2', 0.0, -1e14, 1e14, what, scale)


BLOCK = Block(
    name='sensor_spline',
    slot=Slot.SENSOR,
    parameters=(
        Parameter(
            'spline_range',
            'm',
            130e-6,
            1e-12,
            1.0,
            'Displacement of which the knots are 0.2 and 0.6, to either side.',
            130e-6,
            follows_range=True,
        ),
        Parameter('spline_quadratic', '1/m', 0.0, -1e7, 1e7, 'Quadratic error at rest.', 100.0),
        Parameter('spline_cubic', '1/m^2', 0.0, -1e13, 1e13, 'Cubic error at rest.', 1e6),
        _bend('bend_high', 'above 0.2', 1e6),
        _bend('bend_low', 'below -0.2', 1e6),
        _bend('far_bend_high', 'above 0.6', 1e7),
        _bend('far_bend_low', 'below -0.6', 1e7),
    ),
    kernel=kernel,
    between=InterSample.INSTANT,
    description='Cubic spline of five pieces in the displacement, before the offset.',
    source='calibration table of the sensor, as a regression spline (Smith 1979)',
)

_BENDS = ('bend_high', 'bend_low', 'far_bend_high', 'far_bend_low')

EFFECTS = (
    Effect(
        name='sensor_nonlinearity',
        block=BLOCK,
        holds={'spline_range': 130e-6},
        neutral={'spline_quadratic': 0.0, 'spline_cubic': 0.0, **dict.fromkeys(_BENDS, 0.0)},
        starts=({'spline_quadratic': 50.0, 'spline_cubic': 0.0}, {'spline_quadratic': -50.0}),
        refines='sensor_nonlinearity',
        physics=(
            'The reading is a nonlinear function of the true displacement with local bends, '
            'as in a calibration table; a polynomial of third order describes only a part '
            'of it.'
        ),
        experiment=(
            'Calibrate against a second sensor at ten points of the stroke: the error is the same '
            'curve at every frequency and on both branches of the loop.'
        ),
        required_coverage=(Coverage.LADDER,),
        mistaken_for=('electrostriction', 'stiffness', 'asymmetry'),
    ),
)
