"""Description of a residual that no known effect explains."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.discovery.data.dataset import Dataset
from piezo_hysteresis.identification.targets import Target
from piezo_hysteresis.numerics.harmonics import harmonics, non_harmonic_lines
from piezo_hysteresis.numerics.linalg import solve_least_squares


@dataclass(frozen=True)
class Place:
    """Rms residual of one harmonic in one record."""

    record: str  # name of the record
    frequency: float  # drive frequency [Hz]; 0 without a periodic drive
    harmonic: int  # harmonic order; 0 is the mean, -1 the remaining residual
    rms: float  # rms residual of this harmonic [m]


def places(data: Dataset, views: Sequence[Target], errors: Sequence[FloatArray]) -> list[Place]:
    """Return the rms residual by record and harmonic, largest first."""
    found = []
    for view, error in zip(views, errors, strict=True):
        found += _of_view(view, error, data.periods[view.name])
    return sorted(found, key=lambda place: -place.rms)


def _of_view(view: Target, error: FloatArray, period: int) -> list[Place]:
    frequency = view.frequency or (1.0 / (period * view.dt) if period else 0.0)
    if frequency <= 0.0 or error.size * view.dt * frequency < 1.0:
        level = float(error.mean())
        rest = float(np.std(error))
        return [
            Place(view.name, view.frequency, 0, abs(level)),
            Place(view.name, view.frequency, -1, rest),
        ]
    orders, phasors, left = harmonics(error, frequency, view.dt)
    sizes = np.abs(phasors) / np.sqrt(2.0)
    sizes[0] *= np.sqrt(2.0)
    rows = [
        Place(view.name, view.frequency, order, float(size))
        for order, size in zip(orders, sizes, strict=True)
    ]
    return [*rows, Place(view.name, view.frequency, -1, left)]


# Ratio to the median of the spectrum from which a line is reported: twice that of `tones`, which
# also requires several records to agree.
LINE = 60.0

# Exponent of a power law below which the dependence is negligible.
_LEVEL = 0.15
# Standard deviation of the log residual about a power law above which it is rejected. Chosen.
_SCATTER = 0.2


def describe(
    data: Dataset,  # [m]
    views: Sequence[Target],  # [m]
    errors: Sequence[FloatArray],  # [m]
    floor: float,  # [m]
    held_out: tuple[float, float],  # [m]
) -> str:
    """Return sentences on size, location, law and time scale of the residual."""
    sizes = np.array([float(np.sqrt(np.mean(e**2))) for e in errors])
    size, floors = held_out
    sentences = [f'The held-out residual is {size * 1e6:.3g} µm rms, {floors:.3g} noise floors.']
    worst = int(np.argmax(sizes))
    which = 'held-out' if any(views[0] is view for view in data.held_out) else 'fitted'
    if len(sizes) > 1:
        sentences.append(
            f'On {which} records it is largest in {views[worst].name} '
            f'({sizes[worst] * 1e6:.3g} µm) and smallest in '
            f'{views[int(np.argmin(sizes))].name} ({sizes.min() * 1e6:.3g} µm).'
        )
    sentences += _harmonics(data, views, errors, floor)
    sentences += _lines(data, views, errors)
    sentences += law_sentences(views, sizes, floor)
    sentences += _bursts(views, errors, floor)
    sentences += _trend(views, errors, floor)
    return ' '.join(sentences)


def _harmonics(
    data: Dataset, views: Sequence[Target], errors: Sequence[FloatArray], floor: float
) -> list[str]:
    power: dict[int, float] = {}
    for place in places(data, views, errors):
        power[place.harmonic] = power.get(place.harmonic, 0.0) + place.rms**2
    whole = sum(power.values())
    if whole <= 0.0:
        return []
    sentences = []
    odd = sum(v for k, v in power.items() if k > 0 and k % 2 == 1) / whole
    even = sum(v for k, v in power.items() if k > 0 and k % 2 == 0) / whole
    aside = power.get(-1, 0.0) / whole
    strongest = sorted((k for k in power if k > 0), key=lambda k: -power[k])[:3]
    if odd + even > 0.3:
        kind = 'odd' if odd > 3 * even else 'even' if even > 3 * odd else 'odd and even'
        sentences.append(
            f'{100 * (odd + even):.0f} % of its power is on {kind} harmonics of the drive, mainly '
            f'orders {", ".join(map(str, strongest))}.'
        )
    if aside > 0.3:
        sentences.append(f'{100 * aside:.0f} % of its power is on no harmonic of the drive.')
    if power.get(0, 0.0) / whole > 0.3:
        sentences.append(f'{100 * power[0] / whole:.0f} % of its power is a shift of the mean.')
    return sentences


def _lines(data: Dataset, views: Sequence[Target], errors: Sequence[FloatArray]) -> list[str]:
    found: list[float] = []
    for view, error in zip(views, errors, strict=True):
        if error.size < 1000:
            continue
        frequency, lines = non_harmonic_lines(error, view.dt, view.frequency)
        power = lines**2
        top = int(np.argmax(power))
        others = power[power > 0]
        if others.size and power[top] > LINE * float(np.median(others)):
            found.append(float(frequency[top]))
    if len(found) < max(2, len(views) // 4):
        return []
    middle = float(np.median(found))
    if np.median(np.abs(np.array(found) - middle)) < 0.02 * middle:
        return [
            f'{len(found)} records contain a tone near {middle:.4g} Hz that is not a harmonic.'
        ]
    return ['The records contain tones that are not harmonics, at different frequencies.']


def law_sentences(views: Sequence[Target], sizes: FloatArray, floor: float) -> list[str]:
    """Return sentences on how sizes by view [m] grow with the drive, above a floor [m]."""
    rows = [
        (v.frequency, float(np.max(np.abs(v.voltage))), float(s))
        for v, s in zip(views, sizes, strict=True)
        if v.frequency > 0 and s > 1.05 * floor
    ]
    if len(rows) < 3:
        return []
    clean = [(f, a, max(s**2 - floor**2, 1e-30) ** 0.5) for f, a, s in rows]
    table = np.array(clean)
    columns = [np.ones(len(table))]
    names = []
    for place, name in ((0, 'frequency'), (1, 'amplitude')):
        if np.ptp(np.log(table[:, place])) > 0.3:
            columns.append(np.log(table[:, place]))
            names.append(name)
    if not names:
        return []
    solved = solve_least_squares(np.column_stack(columns), np.log(table[:, 2]))
    if not solved.sound:
        return []
    logs = np.log(table[:, 2])
    scatter = float(np.std(logs - np.column_stack(columns) @ solved.values))
    if scatter > _SCATTER:
        return []
    pairs = zip(names, solved.values[1:], strict=True)
    return [growth(name, float(power)) for name, power in pairs]


def growth(name: str, power: float) -> str:
    """Return a sentence on the change of the residual with the frequency or the amplitude."""
    if abs(power) < _LEVEL:
        return f'It hardly depends on the {name}.'
    if power > 0:
        return f'It increases with the {name}, about with power {power:.1f}.'
    return f'It decreases with the {name}, about with power {power:.1f}.'


def _bursts(views: Sequence[Target], errors: Sequence[FloatArray], floor: float) -> list[str]:
    joined = np.concatenate([e**2 for e in errors])
    top = np.sort(joined)[-max(1, joined.size // 100) :]
    share = float(top.sum() / joined.sum())
    if share > 0.5:
        share_text = f'{100 * share:.0f} % of its power is in 1 % of the samples'
        return [f'{share_text}: bursts, jumps or drop-outs rather than a smooth effect.']
    return []


def _trend(views: Sequence[Target], errors: Sequence[FloatArray], floor: float) -> list[str]:
    changes = []
    for view, error in zip(views, errors, strict=True):
        count = error.size // 4
        if count * view.dt < 0.25:
            continue
        changes.append(float(error[-count:].mean() - error[:count].mean()))
    if changes and np.mean(np.abs(changes)) > 0.5 * floor:
        change = np.mean(np.abs(changes)) * 1e6
        return [f'Within a record its mean changes by {change:.3g} µm on average.']
    return []
