"""The noise of each record, measured without a model: its rms and its colour.

Each period is subtracted from the previous one, which removes the periodic part. The noise is the
running median of the spectrum of the rest, so that a tone, a drift or a few bursts, which a better
model may explain, do not count as noise. The noise of an aperiodic record is estimated from
differences of high order, which suppress smooth motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import comb, hypot, isfinite, nan, sqrt

import numpy as np

from piezo_hysteresis.arrays import BoolArray, FloatArray
from piezo_hysteresis.identification.outliers import (
    CounterStep,
    counter_steps,
    interpolated,
    outliers,
    step_of,
    without_steps,
)
from piezo_hysteresis.identification.periods import (
    PERIODIC,
    cached_per_record,
    like_lags,
    mean_changes,
    period_of,
    periodic_from,
)
from piezo_hysteresis.numerics.qr import inner
from piezo_hysteresis.records import Record

# Interpolation taps on either side, and the parameter of their window.
_HALF, _SHAPE = 24, 7.0
# Relative power of the difference at a whole number of samples up to which a drive may be periodic
# with a fractional period, while a tenth of the record is not.
_NEAR = 0.25
# Largest number of fractional lags that are tested.
_TRIED = 12
# Smallest number of periods of a section, including the first.
_PERIODS = 2.0
# Search range of the period in samples and as a share of a lag, and its tolerance.
_BESIDE, _MOVED, _EXACT = 0.75, 0.02, {'xatol': 1e-7}
# Samples, and share of a period, over which an interpolated corner is not a break.
_CORNER, _CORNER_SHARE = 21, 0.12


@dataclass(frozen=True)
class Repeat:
    """The section of a record in which the drive is periodic."""

    period: float  # period in samples, possibly fractional
    first: int  # first sample of the section
    last: int  # the sample after its last


@cached_per_record
def repeat_of(record: Record) -> Repeat | None:
    """Return the longest section with a periodic drive, None if there is none."""
    u = record.voltage
    spread = float(np.std(u))
    if u.size < 4 * _HALF or spread <= 1e-15 * float(np.max(np.abs(u))):
        return None
    for lag in like_lags(mean_changes(u), spread**2, 2.0 * _NEAR)[:_TRIED]:
        period = _refined(u, lag)
        found = _longest(u, period, spread)
        if found is not None:
            return found
    return None


def less_the_period_before(signal: FloatArray, period: float) -> FloatArray:
    """Return ``signal(k) - signal(k - period)`` where both are available, shape (m,)."""
    taps, lag = _taps(period)
    before = np.convolve(signal, taps, mode='valid')
    # before[i] is the signal at i + _HALF - (period - lag)
    first = lag + _HALF
    count = min(before.size, signal.size - first)
    return np.asarray(signal[first : first + count] - before[:count], dtype=np.float64)


def gain_of_difference(window: FloatArray, period: float) -> FloatArray:  # window (n,)
    """Return the mean square of every line of a windowed difference, for white noise of rms 1."""
    taps, lag = _taps(period)
    placed = np.zeros(window.size)
    np.add.at(placed, (lag - _HALF + np.arange(taps.size)) % window.size, taps)
    before = np.fft.rfft(placed)
    shared = inner(window[lag:], window[:-lag]) if lag < window.size else 0.0
    alike = shared / inner(window, window)
    return np.asarray(1.0 + np.abs(before) ** 2 - 2.0 * alike * before.real)


def _taps(period: float) -> tuple[FloatArray, int]:
    lag = round(period)
    place = np.arange(-_HALF, _HALF + 1) - (period - lag)
    taps = np.sinc(place) * np.kaiser(2 * _HALF + 1, _SHAPE)
    return np.asarray(taps / taps.sum()), lag


def _refined(u: FloatArray, lag: int) -> float:
    """Return the fractional period near a whole lag that fits the longest part of the drive."""

    def change(period: float) -> float:
        return float(np.median(np.abs(less_the_period_before(u, period))))

    from scipy.optimize import minimize_scalar  # imports more than all the rest together

    def best(width: float) -> float:
        bounds = (lag - width, lag + width)
        return float(minimize_scalar(change, bounds=bounds, method='bounded', options=_EXACT).x)

    # a jump shifts the minimum by which the lag was found
    return min((best(width) for width in (_BESIDE, _BESIDE + _MOVED * lag)), key=change)


def _longest(u: FloatArray, period: float, spread: float) -> Repeat | None:
    from scipy.ndimage import median_filter

    change = np.abs(less_the_period_before(u, period))
    width = max(3, min(_CORNER, int(_CORNER_SHARE * period)) | 1)
    broken = median_filter(change, width, mode='nearest') > 6.0 * PERIODIC * spread
    edges = np.flatnonzero(np.concatenate([[True], broken, [True]]))
    longest = int(np.argmax(np.diff(edges)))
    begin, end = int(edges[longest]), int(edges[longest + 1]) - 1
    # change[i] compares sample i + lag + _HALF with the value one period earlier
    first, last = begin, end + round(period) + _HALF
    return Repeat(period, first, last) if last - first >= _PERIODS * period else None


# Lines of a running median, and that of a windowed spectrum of white noise over its mean: half of
# its lines are independent.
WIDTH = 101
RUNNING_MEDIAN = 0.704
# Iterations of the median over a spectrum levelled by its current colour, until it converges.
_PASSES = 3
# Records whose noise differs by less than this from the majority are treated as equal.
AGREE = 0.02
# Standard deviation of an rms from one line of a spectrum by its median: 1 / (2 ln 2).
SPREAD = 0.72
# Orders of the differences for an aperiodic record, number and shortest length of their windows.
_ORDERS = (4, 6, 8)
_WINDOWS = 40
_SHORTEST_WINDOW = 64
# Noise with a larger correlation between samples is treated as motion.
_SLOWEST = 0.99
# Range after the start of a record, over the whole range, below which it begins with a jump, and
# below which that is the step that it was made for.
_JUMP, _STEP = 0.8, 0.25
# Number of terms of a series that falls with the square of its index.
_TERMS = 400
# Standard deviations of the confidence interval.
SURE = 3.0
# Samples of differences with the information of one spectral line: 300 draws of white noise of
# 500 to 40 000 samples scatter by 11 to 1.1 %, as 0.72 / sqrt(lines) does with a tenth of them.
_SAMPLES_A_LINE = 10
_LOWER_HALF = 1.24  # bias of the lower half of windows of n samples, times sqrt(n)
# Number of levels from which their smallest distance is the step of a converter and not of a drive
# with few levels.
_LEVELS = 8
# Ratio of a step to the noise below which it adds less than 1e-7 of its mean square.
_NEGLIGIBLE_STEP = 1e-3
_MAD = 1.4826  # Share of a reading that is rounding.
_ROUNDING = 1e-12
# of a normal distribution: standard deviation over the median absolute deviation


@dataclass(frozen=True)
class Noise:
    """Noise estimated from one record."""

    rms: float  # rms of the noise [m]; NaN if it cannot be estimated
    lines: int  # number of independent spectral lines
    colour: float = float('nan')  # correlation of one sample with the next
    order: int = 0  # order of the differences from which `rms` was estimated for white noise
    rounding: float = 0.0  # relative uncertainty of its mean square
    hidden: bool = False  # whether the differences are below a step of the converter

    @property
    def excess_deviation(self) -> float:
        """Standard deviation of the mean square, as a share of it."""
        return hypot(2.0 * SPREAD / sqrt(self.lines), self.rounding / SURE)

    @property
    def memory(self) -> float:
        """Correlation of a sample with the next one, 0 if `colour` is unknown."""
        return _memory(self.colour) if isfinite(self.colour) else 0.0


def _memory(colour: float) -> float:
    return min(max(colour, 0.0), _SLOWEST)


def density(memory: float, cosine: FloatArray) -> FloatArray:
    """Return the spectrum relative to white noise of equal rms.

    The noise is a first-order autoregression with the coefficient `memory`; `cosine` is that of
    the angle per sample.
    """
    return np.asarray((1.0 - memory**2) / (1.0 + memory**2 - 2.0 * memory * cosine))


def independent(samples: int, memory: float) -> float:
    """Return the equivalent number of independent samples for the mean square of noise."""
    return samples * (1.0 - memory**2) / (1.0 + memory**2)


UNKNOWN_NOISE = Noise(float('nan'), 0)


@cached_per_record
def noise_of(record: Record) -> Noise:
    """Return the noise of one record after its warm-up, robust to spikes and drop-outs.

    It is at least the quantisation noise of the converter, which is invisible in a record that
    repeats exactly or moves by less than a step.
    """
    largest = np.max(np.abs(record.displacement))
    if stroke_of(record) <= _ROUNDING * float(largest):  # a constant reading shows no noise
        return UNKNOWN_NOISE
    seen, repeats = _seen_noise(record)
    step = step_of(
        measured_without_outliers(record),
        same=0.0,
        fewest=_LEVELS,
        negligible=_NEGLIGIBLE_STEP * seen.rms,
    )
    if not seen.lines or not max(seen.rms, step) > 0.0:
        return UNKNOWN_NOISE
    with_repeated = _with_repeated_rounding(seen.rms, step)
    least = with_repeated if repeats else max(seen.rms**2, step**2 / 12.0)
    mean = 0.5 * (least + with_repeated)
    order = seen.order if seen.rms**2 >= step**2 / 12.0 else 0
    hidden = seen.order > 0 and seen.rms < step
    excess_deviation = (with_repeated - mean) / mean
    return replace(seen, rms=sqrt(mean), order=order, rounding=excess_deviation, hidden=hidden)


def _with_repeated_rounding(seen: float, step: float) -> float:
    """Return the mean square [m^2] of noise and rounding, from the non-periodic part `seen`.

    By the characteristic function of the noise, after Widrow 1956: if x repeats, its mean
    rounding error repeats too, ``sum_k step/(pi k) exp(-2 (pi k std/step)^2) sin(2 pi k x/step)``,
    and `seen` contains only the remaining part.
    """
    from scipy.optimize import brentq

    if seen <= 0.0 or step <= 0.0:
        return seen**2 + step**2 / 12.0
    k = np.arange(1, _TERMS)

    def unseen(std: float) -> float:
        return float(np.sum(np.exp(-((2.0 * np.pi * k * std / step) ** 2)) / k**2)) * share

    share = step**2 / (2.0 * np.pi**2)

    def missed(std: float) -> float:
        # differences first: either step or noise may dominate the other
        return (std**2 - seen**2) + (step**2 / 12.0 - unseen(std))

    if missed(0.0) >= 0.0:
        return step**2 / 12.0
    std = brentq(missed, 0.0, seen) if missed(seen) > 0.0 else seen
    return float(std) ** 2 + step**2 / 12.0


@cached_per_record
def bad_samples(record: Record) -> BoolArray:
    """Return which samples of a record are spikes, drop-outs or out of range, see `outliers`."""
    period = period_of(record)
    first = periodic_from(record.voltage, period) if period else 0
    steps = steps_of(record)
    if not steps:
        known = _of_single_samples(record)
        return outliers(record.voltage, record.displacement, period, first, known)
    whole = without_steps(record.displacement, steps)
    return outliers(record.voltage, whole, period, first)


@cached_per_record
def steps_of(record: Record) -> list[CounterStep]:
    """Return the steps of the counter in a record, see `counter_steps`."""
    y = interpolated(record.displacement, _of_single_samples(record))
    return counter_steps(record.voltage, y, period_of(record))


@cached_per_record
def _of_single_samples(record: Record) -> BoolArray:
    """Return the outliers by their neighbours alone; both passes over a record begin with them."""
    return outliers(record.voltage, record.displacement, 0)


def measured_without_outliers(record: Record) -> FloatArray:
    """Return the displacement of a record with its bad samples interpolated, shape (n,) [m]."""
    return interpolated(record.displacement, bad_samples(record), period_of(record))


@cached_per_record
def stroke_of(record: Record) -> float:
    """Return the range of the displacement without bad samples [m]."""
    return float(np.ptp(measured_without_outliers(record)))


def reach_of(measured: FloatArray) -> float:
    """Return the range of a displacement, without a jump at its start [m].

    What breaks loose in the first hundredth of a record would set the scale of everything that is
    relative to it.
    """
    whole = float(np.ptp(measured))
    later = float(np.ptp(measured[measured.size // 100 :]))
    return later if _STEP * whole < later < _JUMP * whole else whole


def _seen_noise(record: Record) -> tuple[Noise, bool]:
    """Return the noise by its non-periodic part, and whether periodic errors are excluded."""
    period = period_of(record)
    measured = measured_without_outliers(record)
    if float(np.ptp(record.voltage)) == 0.0:
        return robust_noise(measured[record.warm_up_samples :]), True
    steady = _steady(record, measured, period) if period else measured[:0]
    if period and steady.size >= 2 * period:
        return robust_noise(steady[period:] - steady[:-period], period), True
    repeat = repeat_of(record)
    first = 0 if repeat is None else max(repeat.first, record.warm_up_samples)
    if repeat is not None and repeat.last - first >= max(_PERIODS * repeat.period, 4 * _HALF):
        if repeat.last - first >= 4 * repeat.period:  # a transient is over after a period
            first += round(repeat.period)
        left = less_the_period_before(measured[first : repeat.last], repeat.period)
        if left.size >= 4 * WIDTH:  # without a spectrum, creep would count as noise
            return robust_noise(left, repeat.period), False
    return differences_noise(measured[record.warm_up_samples :]), False


def noises_of(records: Sequence[Record]) -> list[Noise]:
    """Return the noise of every record; estimates that agree within their uncertainty are pooled.

    Where the estimates of most records agree within their uncertainty, the pooled value is more
    precise. It is not used if these estimates scatter by more than chance: the noise then
    depends on the record. If not all agree, a record without an estimate gets that of the
    records with the most similar drive.
    """
    found = _of_one_colour(records)
    alike, middle = consensus(found)
    agreeing = [_agrees(noise, middle) for noise in found]
    if any(n.lines and not agrees for n, agrees in zip(found, agreeing, strict=True)):
        found = _like_their_drives(records, found)
    pairs = list(zip(found, agreeing, strict=True))
    together = _scatter_by_chance([noise for noise, agrees in pairs if agrees], alike.rms)
    shared = [alike if not n.lines or (together and agrees) else n for n, agrees in pairs]
    # the hidden noise is at least as large as its estimate
    both = zip(map(noise_of, records), shared, strict=True)
    found = [own if own.hidden and own.rms > noise.rms else noise for own, noise in both]
    return [_with_input(each, record) for each, record in zip(found, records, strict=True)]


def _with_input(noise: Noise, record: Record) -> Noise:
    """Return the expected residual: the noise, and the response to the error of the input."""
    swing, error = float(np.ptp(record.voltage)), record.input_uncertainty
    if error is None or not noise.lines or swing == 0.0:
        return noise
    moved = stroke_of(record) / swing * error.rms
    rms = hypot(noise.rms, moved)
    colour = (noise.memory * noise.rms**2 + error.colour * moved**2) / rms**2
    return replace(noise, rms=rms, colour=colour)


def _of_one_colour(records: Sequence[Record]) -> list[Noise]:
    """Return the noise of every record; an unknown colour is taken from the others.

    All are assumed to come from one sensor. Differences pass high frequencies only and
    underestimate slow noise; noise below the quantisation step is better estimated by others.
    """
    found = [noise_of(record) for record in records]
    if not all(noise.hidden for noise in found if noise.lines):
        found = [UNKNOWN_NOISE if noise.hidden else noise for noise in found]
    known = pooled(found)
    if not isfinite(known.colour):
        return found
    return [_coloured(noise, known) if noise.order else noise for noise in found]


def _coloured(noise: Noise, known: Noise) -> Noise:
    """Return noise estimated as white, corrected for the colour of the `known` noise."""
    order = noise.order
    taps = np.array([(-1) ** k * comb(order, k) for k in range(order + 1)], dtype=np.float64)
    follows = known.memory ** np.abs(np.arange(-order, order + 1))
    share = float(np.convolve(taps, taps[::-1]) @ follows) / comb(2 * order, order)
    return replace(noise, rms=noise.rms / sqrt(share), colour=known.colour)


def consensus(found: Sequence[Noise]) -> tuple[Noise, float]:
    """Return the noise on which most records agree, and the rms about which they do [m]."""
    known = [noise for noise in found if noise.lines]
    if not known:
        return UNKNOWN_NOISE, float('nan')
    rms = np.array([noise.rms for noise in known])
    lines = np.array([noise.lines for noise in known])
    order = np.argsort(rms)
    share = np.cumsum(lines[order]) / np.sum(lines)
    middle = float(rms[order][np.searchsorted(share, 0.5)])
    return pooled([noise for noise in known if _agrees(noise, middle)]), middle


def _agrees(noise: Noise, rms: float) -> bool:
    if not noise.lines:
        return False
    return abs(noise.rms - rms) <= rms * (AGREE + 3.0 * SPREAD / sqrt(noise.lines))


def _scatter_by_chance(found: Sequence[Noise], rms: float) -> bool:
    """Return whether values scatter about `rms` within their uncertainty, by chi-square."""
    doubts = [hypot(AGREE, SPREAD / sqrt(noise.lines)) for noise in found]
    pairs = zip(found, doubts, strict=True)
    squares = sum(
        ((noise.rms / rms - 1.0) / excess_deviation) ** 2 for noise, excess_deviation in pairs
    )
    freedom = max(len(found) - 1, 1)
    return squares <= freedom + SURE * sqrt(2.0 * freedom)


def _like_their_drives(records: Sequence[Record], found: Sequence[Noise]) -> list[Noise]:
    """Return the noise of every record; an unknown value is that of the most similar voltages."""
    ranges = np.array([float(np.ptp(record.voltage)) for record in records])
    known = [k for k, noise in enumerate(found) if noise.lines]
    nearest = [float(np.min(np.abs(ranges[known] - each))) for each in ranges]
    like = [
        pooled([found[k] for k in known if abs(ranges[k] - each) <= AGREE * each + least])
        for each, least in zip(ranges, nearest, strict=True)
    ]
    return [noise if noise.lines else other for noise, other in zip(found, like, strict=True)]


def floor_of(records: Sequence[Record]) -> Noise:
    """Return the noise on which most records agree, the noise floor of the reports."""
    return consensus(_of_one_colour(records))[0]


def pooled(found: Sequence[Noise]) -> Noise:
    """Return the noise of several records together, weighted by their information."""
    known = [noise for noise in found if noise.lines]
    if not known:
        return UNKNOWN_NOISE
    lines = np.array([noise.lines for noise in known])
    square = float(np.average([noise.rms**2 for noise in known], weights=lines))
    colours = [noise.colour for noise in known if np.isfinite(noise.colour)]
    colour = float(np.mean(colours)) if colours else float('nan')
    rounding = float(np.average([noise.rounding for noise in known], weights=lines))
    return Noise(sqrt(square), int(lines.sum()), colour, rounding=rounding)


def _steady(record: Record, measured: FloatArray, period: int) -> FloatArray:
    """Return the part of the displacement in which the input repeats and transients are over."""
    first = max(periodic_from(record.voltage, period), record.warm_up_samples)
    if len(record) - first >= 4 * period:  # a transient is over after a period
        first += period
    return measured[first:]


def robust_noise(signal: FloatArray, period: float = 0.0) -> Noise:  # signal [m] (n,)
    """Return the noise in `signal`, robust to lines and to slow changes."""
    if signal.size < 4 * WIDTH:
        if signal.size <= 8:
            return UNKNOWN_NOISE
        # Too short for a running median; half the median of squares is robust enough.
        mean_square = np.median(signal**2) / 0.4549 / (2.0 if period else 1.0)
        return Noise(float(np.sqrt(mean_square)), signal.size // 4)
    # without a window, a tone between two lines would leak into all of them
    window = np.hanning(signal.size)
    from scipy.ndimage import median_filter

    power = np.abs(np.fft.rfft(window * (signal - signal.mean()))) ** 2 / np.sum(window**2)
    gain = gain_of_difference(window, period) if period else np.ones(power.size)
    # no estimate at frequencies that the difference cancels
    kept = np.flatnonzero(gain > 0.3)[2:]
    seen, cosine = power[kept] / gain[kept], np.cos(2.0 * np.pi * kept / signal.size)
    # a running median is biased if the spectrum falls within its width, so it is levelled first
    memory, colour = nan, 0.0
    for _ in range(_PASSES):
        if memory == (memory := _memory(colour)):
            break
        shape = density(memory, cosine)
        smooth = shape * median_filter(seen / shape, WIDTH, mode='reflect') / RUNNING_MEDIAN
        colour = inner(smooth, cosine) / max(float(smooth.sum()), 1e-300)
    alike = float(smooth.mean()) ** 2 / max(float(np.mean(smooth**2)), 1e-300)
    return Noise(float(np.sqrt(np.mean(smooth))), int(alike * kept.size / 2), colour)


def differences_noise(measured: FloatArray) -> Noise:
    """Return the noise of a record that does not repeat, as if it were white.

    Differences of high order pass white noise with a known gain and suppress smooth motion. The
    median over a window is robust to jumps and corners; of the windows the quieter half is used,
    in which the drive is slow. The smallest estimate over the orders is taken.
    """
    length = max(measured.size // _WINDOWS, _SHORTEST_WINDOW)
    count = measured.size // length
    if count < 2:
        return UNKNOWN_NOISE
    found = []
    for order in _ORDERS:
        change = np.diff(measured, order)[: count * length - order]
        sizes = [
            float(np.median(np.abs(change[k * length : (k + 1) * length]))) for k in range(count)
        ]
        quiet = np.sort(sizes)[: max(count // 2, 1)]
        found.append((_MAD * float(np.median(quiet)) / sqrt(comb(2 * order, order)), order))
    rms, order = min(found)
    lines = max(measured.size // _SAMPLES_A_LINE, 1)
    return Noise(rms / (1.0 - _LOWER_HALF / sqrt(length)), lines, order=order)
