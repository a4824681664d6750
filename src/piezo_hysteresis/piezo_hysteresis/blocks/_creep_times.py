"""Time constants of the creep elements."""

from math import sqrt

from piezo_hysteresis.jit import jit

ELEMENTS = 14  # Kelvin-Voigt elements of the logarithmic law
PER_DECADE = 2
# Time constants of the spectrum [s]: one per decade, so that their shares form any creep curve.
SPECTRUM = (0.01, 0.1, 1.0, 10.0)
_FIRST = 1.7811  # exp(Euler's constant): the bank then follows log10(1 + t/onset)


@jit
def over_onset(i: int) -> float:
    """Return the time constant of element `i` of the logarithmic law over its onset."""
    spacing: float = 10.0 ** (1.0 / PER_DECADE)
    return float(_FIRST * sqrt(spacing) * spacing**i)
