"""Numbers for display: micrometres instead of metres, significant digits only."""

from __future__ import annotations

import math

MICRO = 1e6

_SHOWN = {
    'm': ('µm', MICRO),
    'm/V': ('µm/V', MICRO),
    'm/V^2': ('µm/V²', MICRO),
    'm/s': ('µm/s', MICRO),
    'V/m': ('V/µm', 1 / MICRO),
    '1/m': ('1/µm', 1 / MICRO),
    '1/m^2': ('1/µm²', 1 / MICRO**2),
    '1': ('', 1.0),
}


def shown(unit: str) -> tuple[str, float]:
    """Return the display unit of an SI unit, and the conversion factor."""
    return _SHOWN.get(unit, (unit, 1.0))


def clock(seconds: float) -> str:
    """Return a duration [s] as text: ``40 s``, ``3 min 05 s``, ``2 h 10 min``."""
    whole = round(seconds)
    if whole < 60:
        return f'{whole} s'
    if whole < 3600:
        return f'{whole // 60} min {whole % 60:02d} s'
    return f'{whole // 3600} h {whole % 3600 // 60:02d} min'


def time_left(fraction: float, spent: float) -> str:
    """Return the remaining time at the present rate, as ``, about 40 s left``."""
    return f', about {clock(spent * (1.0 - fraction) / fraction)} left'


def micrometres(metres: float | None) -> str:
    """Return a length [m] in micrometres with three significant digits, or a dash."""
    if metres is None or not math.isfinite(metres):
        return '–'
    return f'{MICRO * metres:.3g}'


def with_deviation(value: float, std: float | None) -> tuple[str, str]:
    """Return a number with the digits that its standard deviation permits, and the deviation."""
    if std is None or math.isnan(std):
        return f'{value:.5g}', 'held'
    if math.isinf(std):
        return f'{value:.2g}', 'not determined'
    if std <= 0.0:
        return f'{value:.6g}', f'{std:.1g}'
    size = math.floor(math.log10(abs(value))) if value else -99
    known = size - math.floor(math.log10(std)) + 2
    return f'{value:.{min(max(known, 1), 9)}g}', f'{std:.2g}'
