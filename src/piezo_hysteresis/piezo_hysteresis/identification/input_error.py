"""Error of a recorded input: noise, steps, hold and hum of the voltage column.

Models take the input as exact. A voltage that was recorded by a monitor or a scope has an error of
its own, and a model answers it as if the actuator had felt it: a resonance, a saturation, a memory
that is not there. Where the drive is periodic or smooth, the error is separated and removed.

The witness is the displacement: what it follows was no error but drive.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import exp, gcd, hypot, inf, isfinite, pi, sqrt
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from piezo_hysteresis.arrays import FloatArray, IntArray
from piezo_hysteresis.identification.local_fit import local_fit
from piezo_hysteresis.identification.noise import RUNNING_MEDIAN, differences_noise
from piezo_hysteresis.identification.outliers import step_of
from piezo_hysteresis.identification.periods import mean_changes
from piezo_hysteresis.numerics.linalg import solve_least_squares
from piezo_hysteresis.records.record import InputUncertainty

# Share of the range of the input below which an error is negligible, and that of a command.
NEGLIGIBLE, _SMOOTH = 2e-5, 1e-6
_PATH = 0.01  # ranges that noise may move a hysteresis in a whole record
_EQUAL = 1e-9  # share of the range by which slopes of a ramp differ by rounding
_LEVELS = 8  # levels from which their distance is the step of a converter
# Share of the changes of a held signal that are a whole number of holds apart, and longest hold.
_HELD, _LONGEST_HOLD = 0.95, 64
# Deviations from which a line of the spectrum is drive, and share of the error that its
# projection on the displacement must not exceed.
_LINE = 5.0
_FOLLOWED = 0.3
_ORDER = 8  # of the differences in that test
# Mean square of the change from period to period over the power: of a drive, and with its error.
_REPEATS, _ALIKE = 1e-4, 0.05
_ROUNDED = 1.0 / 3.0  # largest line of the rounding of a sine, in steps
_JUMP = 6.0  # deviations
_TURNS = 4  # Gauss-Newton steps of the period
_USEFUL = 0.8  # share of the noise beyond which removing it is not worth its own error
SLOW = 0.95  # correlation of neighbouring samples of the error that remains
_FEWEST, _ENOUGH = 200, 200_000  # samples for an estimate
_EVERYWHERE = 0.2  # least ratio of the median size of an error to its rms
ON_GRID = 0.02  # share of a step by which readings may differ from whole steps
_CHANCE = 1.1  # uncertainty of an estimated mean square
_FAR = 9.0  # median sizes beyond which a difference belongs to a jump
# Share of the range of a jump, and changes on either side that it exceeds.
_LARGE, _NEAR = 0.01, 16
# Samples of a segment of a spectrum, of the shortest one, fewest segments, their power over the
# median without a jump, quantile of the lines, and share of the noise that its spectrum has there.
_SEGMENT, _SHORTEST, _FEWEST_SEGMENTS, _CALM, _LOWEST, _WHITE = 256, 64, 16, 4.0, 0.05, 0.5
# Density over that of noise where an input is mainly noise, probability of a coherence by chance,
# and share of such lines with a coherence from which an input is drive.
_MAINLY, _SELDOM, _BANDS = 2.0, 1e-3, 0.2
_LAGS = 12  # samples by which the displacement may follow the input in that test
_CHOSEN = 1.4  # error of a local fit over that of its windows: they are chosen by the noise
_DETAIL = 4.0  # deviations from which a local fit finds what the harmonics lack
_BLOCK = 16_384  # samples of a partial sum
_HARMONICS = 60  # largest number of fitted harmonics of a drive
# Largest frequency of a drive over the rate of its readings, share of the displacement that is
# faster from which the drive was, too, and from which the readings show another drive.
_BELOW_HALF, _FASTER, _ALIASED = 0.49, 0.2, 0.99
_BETTER = 0.9  # ratio of what two inputs leave of a displacement, from which one is its drive
# Mains frequencies [Hz], their highest multiple, and how much they stand out of their neighbours.
_MAINS, _MULTIPLES, _STANDS_OUT = (50.0, 60.0), 5, 6.0
# Relative deviation of the mains frequency, and of the clock that recorded it.
_ON_TIME = 0.005
# Share of the gain of the drive from which the displacement follows a line, which a mode passes
# up to three times its frequency, and size of the lines of a drive over the largest.
_PASSED, _STRONG = 0.1, 0.1


@dataclass(frozen=True)
class InputError:
    """Error of a recorded input and the input without it."""

    voltage: FloatArray  # input without the error [V or N], shape (n,)
    rms: float  # error of one recorded sample [V or N]
    left: InputUncertainty  # error of `voltage`
    step: float = 0.0  # step of the converter [V or N]; 0 if it is negligible
    hold: int = 1  # samples for which a reading is held; 1 without a hold
    hum: tuple[tuple[float, float], ...] = ()  # [Hz] [V or N]
    skipped: bool = False  # the input did between two held readings what they do not show

    def words(self, unit: str) -> str:
        """Return size and kind of the error."""
        reach = float(np.ptp(self.voltage))
        share = f' ({100.0 * self.rms / reach:.2g} % of its range)' if reach > 0.0 else ''
        parts = [f'{self.rms:.2g} {unit} rms{share}']
        parts += [f'in steps of {self.step:.3g} {unit}'] if self.step else []
        parts += [f'each reading held for {self.hold} samples'] if self.hold > 1 else []
        parts += [f'hum of {size:.2g} {unit} at {f:.4g} Hz' for f, size in self.hum[:2]]
        return ', '.join(parts)


def input_error(u: FloatArray, y: FloatArray, dt: float) -> InputError | None:
    """Return the error of a recorded input, None for a commanded one."""
    # u [V or N] (n,); y [m] (n,); dt [s]
    reach, stroke = float(np.ptp(u)), float(np.ptp(y))
    if u.size < _FEWEST or not reach > 0.0 or not stroke > 0.0:
        return None
    part = u[:_ENOUGH]
    least = _SMOOTH * reach
    if not _step(part, reach) and not _noise(part, least) > least and _hold(part)[0] == 1:
        return None  # a command
    if _ramps(part):
        return None
    hold, first = _hold(u)
    places = np.arange(first, u.size, hold)
    held, moved = u[places], y[places]
    step = _step(held, reach)
    hum, lines = _hum(held, moved, dt * hold, reach)
    plain = held - lines
    noise = max(_noise(plain, least), step / sqrt(12.0), least)
    # a hysteresis adds up all changes, also at rest
    least_noise = max(2.0 * _SMOOTH, min(NEGLIGIBLE, _PATH / held.size)) * reach
    if not (noise > least_noise or hum or hold > 1) or _followed(y, u, stroke / reach):
        return None
    if not hum and hold == 1 and _coherent(y, plain, noise):
        return None
    if noise > least_noise or hold > 1:
        found = _without_noise(plain, noise, step, places, u.size)
    else:
        found = plain, InputUncertainty(0.0), False
    if found is None:  # the drive is as fast as the noise: it stays, and counts as uncertainty
        kept = u - (0.0 if hold > 1 else lines)
        return InputError(kept, noise, InputUncertainty(noise), step, hold, hum)
    clean, left, skipped = found
    error = u - clean
    rms = float(np.sqrt(np.mean(error**2)))
    if hold > 1:
        fast = _fast_share(y, hold)
        if fast < _ALIASED and _left_by(y, u) < _BETTER * _left_by(y, clean):
            return None  # the steps were the drive
        skipped = skipped or (float(np.ptp(clean)) > 0.0 and fast > _FASTER)
        return InputError(clean, rms, left, step, hold, hum, skipped)
    # an error is everywhere and as large as expected, corners of a drive are not
    everywhere = float(np.median(np.abs(error))) > _EVERYWHERE * rms
    if not (everywhere and rms > max(least_noise, 0.5 * noise)):
        return None
    return InputError(clean, rms, left, step, hold, hum)


def _step(u: FloatArray, reach: float) -> float:
    """Return the step of the converter of a signal, 0 if it is negligible or there is none."""
    step = step_of(u, fewest=_LEVELS)
    if not step > sqrt(12.0) * NEGLIGIBLE * reach:
        return 0.0
    place = (u - u.min()) / step
    return step if float(np.max(np.abs(place - np.rint(place)))) < ON_GRID else 0.0


def _ramps(u: FloatArray) -> bool:
    """Return whether a signal consists of exact ramps, as a commanded triangle does."""
    slopes = np.diff(u)
    bends = np.abs(np.diff(slopes)) > _EQUAL * float(np.ptp(u))
    return float(np.mean(slopes != 0.0)) > 0.5 and float(np.mean(bends)) < 1.0 - _HELD


def _noise(u: FloatArray, least: float) -> float:
    """Return the rms of noise by its differences, if above `least` at most that by the others."""
    rms = differences_noise(u).rms
    if not rms > least:
        return rms if isfinite(rms) else 0.0
    # a multisine up to half the sampling rate changes as fast as noise, but repeats, or is lines
    least_density = _everywhere_in(u)
    white = rms if least_density > _WHITE * rms else least_density
    return min(rms, _period(u)[1], _between_lines(u), white) if isfinite(rms) else 0.0


def _between_lines(u: FloatArray) -> float:
    """Return the rms of white noise with the median of the spectrum of a signal."""
    window = np.blackman(u.size)
    power = np.abs(np.fft.rfft(window * (u - u.mean()))) ** 2
    return sqrt(float(np.median(power)) / (RUNNING_MEDIAN * float(window @ window)))


def _everywhere_in(u: FloatArray) -> float:
    """Return the rms of white noise that is nowhere in the spectrum above that of a signal.

    The fast part of a chirp or of filtered noise is strong in some bands and weak in others.
    """
    found = _segments(u)
    if found is None:
        return inf
    power = np.mean(np.abs(found[0]) ** 2, axis=0) / found[1]
    return sqrt(float(np.quantile(power, _LOWEST)))


def _segments(*signals: FloatArray) -> tuple[Any, ...] | None:
    """Return spectra of overlapping segments, shape (k, bins), for each signal, and a divisor.

    The divisor, shape (bins,), makes the squares those of white noise per sample: signals are
    differenced twice, against slow motion. Segments in which the first signal jumps are left out.
    None for fewer than `_FEWEST_SEGMENTS`.
    """
    from scipy.signal.windows import blackmanharris  # half a second, and commands need none

    twice = [np.diff(each, 2) for each in signals]
    length = _SEGMENT
    while length > _SHORTEST and 2 * twice[0].size < _FEWEST_SEGMENTS * length:
        length //= 2
    window = blackmanharris(length)  # hardly leaks from the lines of a drive
    parts = [sliding_window_view(each, length)[:: length // 2] for each in twice]
    power = np.mean(parts[0] ** 2, axis=1)
    calm = power <= _CALM * float(np.median(power))
    if int(calm.sum()) < _FEWEST_SEGMENTS:
        return None
    spectra = [np.fft.rfft(window * part[calm], axis=1)[:, 4:-1] for part in parts]
    turn = 2.0 * np.pi * np.arange(length // 2 + 1)[4:-1] / length
    return *spectra, float(window @ window) * (2.0 - 2.0 * np.cos(turn)) ** 2


def _coherent(y: FloatArray, u: FloatArray, noise: float) -> bool:
    """Return whether the displacement follows what would be `noise` of the input, so: drive.

    A mode passes little above its frequency, so that a coherence there counts, however small.
    """
    found = _segments(u, y)
    if found is None:
        return False
    seen, moved, divisor = found
    power, answer = (np.mean(np.abs(each) ** 2, axis=0) for each in (seen, moved))
    both = np.abs(np.mean(np.conj(seen) * moved, axis=0)) ** 2
    of_noise = power < _MAINLY * noise**2 * divisor
    chance = 1.0 - _SELDOM ** (2.0 / len(seen))  # neighbouring segments share samples
    follows = both > chance * power * answer
    return bool(np.mean(of_noise) > 0.0 and np.mean(follows[of_noise]) > _BANDS)


def _hold(u: FloatArray) -> tuple[int, int]:
    """Return for how many samples every reading is held, and the first sample of a reading."""
    places = np.flatnonzero(np.diff(u)) + 1
    if places.size < _FEWEST // 8 or places.size > 0.6 * u.size:
        return 1, 0
    gaps = np.diff(places)
    for hold in range(min(_LONGEST_HOLD, int(np.median(gaps))), 1, -1):
        phase = np.bincount(places % hold, minlength=hold)
        first = int(np.argmax(phase))
        if phase[first] >= _HELD * places.size and places.size > 0.5 * u.size / hold:
            return hold, first
    return 1, 0


def _hum(
    u: FloatArray, y: FloatArray, dt: float, reach: float
) -> tuple[tuple[tuple[float, float], ...], FloatArray]:
    """Return the mains lines of an input that the displacement does not follow, and their sum."""
    n = u.size
    window = np.hanning(n)
    window /= window.sum()

    def spectrum(x: FloatArray) -> FloatArray:
        return np.asarray(2.0 * np.fft.rfft(window * (x - x.mean())))

    size, answer = np.abs(spectrum(u)), np.abs(spectrum(y))
    strong = np.flatnonzero(size > _STRONG * float(size.max()))
    gain = float(np.median(answer[strong] / size[strong]))
    smooth = _without_jumps(u, reach)  # a step has as much of every line as much hum
    size = np.abs(spectrum(smooth))
    found, total = [], np.zeros(n)
    period, _ = _period(u)
    base = n / period if period else 0.0  # bins between harmonics of the drive
    for mains in _MAINS:
        for multiple in range(1, _MULTIPLES + 1):
            place = mains * multiple * n * dt
            k = round(place)
            if k < 12 or k + 40 >= size.size:
                continue
            k += int(np.argmax(size[k - 2 : k + 3])) - 2
            beside = np.r_[size[max(k - 40, 1) : k - 4], size[k + 5 : k + 40]]
            floor = 2.0 * float(np.median(beside))
            if base and abs(k / base - round(k / base)) * base < 2.5:
                order = round(k / base)
                others = [round(base * (order + d)) for d in (-2, -1, 1, 2) if order + d > 1]
                floor = max([floor, *(float(size[j]) for j in others if j < size.size)])
            if size[k] < _STANDS_OUT * floor or size[k] < 2.0 * NEGLIGIBLE * reach:
                continue
            usual = float(np.median(answer[k - 40 : k + 40]))
            if answer[k] > max(_PASSED * gain * size[k], _STANDS_OUT * usual):
                continue
            frequency = _tuned(smooth, k / (n * dt), dt)
            off, width = abs(frequency - mains * multiple), 0.5 / (n * dt)
            if off > max(_ON_TIME * mains * multiple, width):
                continue
            turn = 2.0 * np.pi * frequency * dt * np.arange(n)
            wave = np.exp(-1j * turn) * window
            phasor = 2.0 * complex(np.sum(wave * (smooth - smooth.mean())))
            total += np.real(phasor * np.exp(1j * turn))
            found.append((float(frequency), abs(phasor)))
    return tuple(found), total


def _without_jumps(u: FloatArray, reach: float) -> FloatArray:
    """Return a signal without its single large changes."""
    from scipy.ndimage import median_filter  # commands need none of these

    change = np.diff(u)
    jumps = np.abs(change) > _LARGE * reach
    if not np.any(jumps):
        return u
    jumps &= np.abs(change) > _FAR * median_filter(np.abs(change), 2 * _NEAR + 1)
    return np.asarray(u - np.concatenate([[0.0], np.cumsum(np.where(jumps, change, 0.0))]))


def _tuned(u: FloatArray, frequency: float, dt: float) -> float:
    """Return the frequency near a line of the spectrum at which a signal is largest [Hz]."""
    from scipy.optimize import minimize_scalar

    windowed = (u - u.mean()) * np.hanning(u.size)
    turn = -2j * np.pi * dt * np.arange(u.size)
    width = 1.0 / (u.size * dt)
    return float(
        minimize_scalar(
            lambda f: -float(np.abs(windowed @ np.exp(f * turn))),
            bounds=(frequency - width, frequency + width), method='bounded',
            options={'xatol': 1e-4 * width},
        ).x
    )  # fmt: skip


def _without_noise(
    u: FloatArray, noise: float, step: float, places: IntArray, count: int
) -> tuple[FloatArray, InputUncertainty, bool] | None:
    """Return readings `u` at `places`, without `noise` [V or N], at all samples, and the rest.

    The last value is whether they show too little of what happened between them: every second
    reading does not determine the others.
    """
    from scipy.interpolate import CubicSpline, PchipInterpolator

    base, period, orders, term, rounding = _periodic_part(u, noise, step, places, count)
    detail, spread = local_fit(u - base[places], noise)
    share = 1.0
    if orders:  # what the harmonics lack, such as the corners of a triangle
        more = np.abs(detail) > _DETAIL * spread
        detail, share = np.where(more, detail, 0.0), float(np.mean(more))
    error = u - base[places] - detail
    missed = max(float(np.mean(error**2)) - _CHANCE * noise**2, 0.0)
    terms = 1 + 2 * len(orders) + bool(orders)  # the period was fitted, too
    variance = terms * (term**2 + rounding**2)
    skipped, fill = False, CubicSpline
    if places.size < count:
        rest = u - base[places]
        between = rest[1:-1:2] - CubicSpline(places[::2], rest[::2])(places[1:-1:2])
        # half as many readings have twice the error
        variance += max(float(np.mean(between**2)) - 2.0 * noise**2, 0.0) / 2.0
        skipped = float(np.max(np.abs(between))) > _JUMP * sqrt(2.0) * noise
        fill = PchipInterpolator if skipped else CubicSpline  # the former never exceeds readings
    rms = sqrt(variance + share * (_CHOSEN * spread) ** 2 + missed)
    if rms > _USEFUL * noise and places.size == count:
        return None
    left = InputUncertainty(rms, SLOW, period, orders, term, sqrt(terms) * rounding)
    if places.size == count:
        return base + detail, left, skipped
    inside = np.clip(np.arange(count), places[0], places[-1])
    return base + fill(places, detail)(inside), left, skipped


def _fast_share(y: FloatArray, hold: int) -> float:
    """Return the share of a displacement that is faster than readings so far apart can show."""
    power = np.abs(np.fft.rfft(np.hanning(y.size) * (y - y.mean()))) ** 2
    return sqrt(float(np.sum(power[y.size // (2 * hold) :])) / max(float(np.sum(power)), 1e-300))


def _left_by(y: FloatArray, u: FloatArray) -> float:
    """Return the median size of what a linear recursion with an input leaves of a displacement.

    When a single step came is not known of a held input, so that it must not decide.
    """
    past = [y[1:-1], y[:-2], u[2:], u[1:-1], u[:-2], np.ones(y.size - 2)]
    rows = np.array([each / max(float(np.max(np.abs(each))), 1e-300) for each in past])
    shares = solve_least_squares(rows @ rows.T, rows @ y[2:], 1e-13).values
    return float(np.median(np.abs(y[2:] - shares @ rows)))


def _period(u: FloatArray) -> tuple[float, float]:
    """Return about the period of a signal with noise in samples, and the noise by its periods.

    The period is 0 and the noise infinite if it does not repeat.
    """
    change, power = mean_changes(u - u.mean()), float(np.var(u))
    differs = np.flatnonzero(change > power)
    if not differs.size:
        return 0.0, inf
    least = float(change[differs[0] :].min())
    if least > _ALIKE * power:
        return 0.0, inf
    limit = _CHANCE * least + _REPEATS * power
    alike = np.flatnonzero(change[differs[0] :] < limit) + differs[0]
    if not alike.size:
        return 0.0, inf
    apart = np.flatnonzero(np.diff(alike) > 1)
    end = int(alike[apart[0]] if apart.size else alike[-1])
    place = int(alike[0] + np.argmin(change[alike[0] : end + 1]))
    return float(place + 1), sqrt(max(float(change[place]), 0.0) / 2.0)


def _periodic_part(
    u: FloatArray, noise: float, step: float, places: IntArray, count: int
) -> tuple[FloatArray, float, tuple[int, ...], float, float]:
    """Return the harmonics of a drive that exceed its noise, period, orders and errors of each.

    The errors are that by noise and that by rounding.
    """
    nothing, hold = (np.zeros(count), 0.0, (), 0.0, 0.0), count / places.size
    period, by_periods = _period(u)
    period *= hold
    noise = min(noise, hypot(by_periods, step / sqrt(12.0)))
    if not period or count < 2.0 * period:
        return nothing
    # the error of a converter repeats with the drive: it crosses so many levels in a period
    crossed = min(period / hold, 2.0 * float(np.ptp(u)) / step) if step else 1.0
    rounding = step**2 / 12.0 / crossed if step else 0.0
    white = max(noise**2 - step**2 / 12.0, 0.0)
    part = slice(0, _ENOUGH)
    limit = _LINE * sqrt(2.0 * (white / u[part].size + rounding))
    if step:  # a drive makes lines of its rounding, which noise before the converter blurs
        limit = max(limit, _ROUNDED * step * exp(-2.0 * pi**2 * white / step**2))
    while True:
        orders = range(1, min(int(_BELOW_HALF * period / hold), _HARMONICS) + 1)
        period, shares = _fitted(u[part], places[part], period, orders)
        sizes = np.hypot(shares[1::2], shares[2::2])
        kept = [n for n, size in zip(orders, sizes, strict=True) if size > limit]
        if not kept:
            return nothing
        if (shared := gcd(*kept)) == 1:
            break
        period /= shared  # it was a whole number of periods
    period, shares = _fitted(u, places, period, kept)
    # an amplitude that changes, or a start-up, is no periodic drive
    error = u - _sum_of_waves(places, period, kept, shares)
    if float(np.median(np.abs(np.convolve(error, np.ones(16) / 16.0, mode='valid')))) > noise:
        return nothing
    whole = _sum_of_waves(np.arange(count), period, kept, shares)
    return whole, period, tuple(kept), sqrt(white / u.size), sqrt(rounding)


def _fitted(
    u: FloatArray, places: IntArray, period: float, orders: Sequence[int]
) -> tuple[float, FloatArray]:
    """Return the period and the shares of the waves that fit a signal best."""
    shares: FloatArray = np.zeros(1 + 2 * len(orders))
    for turn in range(_TURNS + 1):
        grams, target = np.zeros((shares.size + 1,) * 2), np.zeros(shares.size + 1)
        for first in range(0, u.size, _BLOCK):
            angle = _angles(places[first : first + _BLOCK], period)
            basis, slopes = _waves(angle, orders)
            full = np.vstack([basis, -(shares @ slopes) * angle / period])
            grams += full @ full.T
            target += full @ u[first : first + _BLOCK]
        last = shares.size + (0 < turn < _TURNS)  # the period moves once the shares are known
        found = solve_least_squares(grams[:last, :last], target[:last]).values
        shares = np.asarray(found[: shares.size], dtype=np.float64)
        if last > shares.size:
            period += float(found[-1])
    return period, shares


def _sum_of_waves(
    places: IntArray, period: float, orders: Sequence[int], shares: FloatArray
) -> FloatArray:
    angle = _angles(places, period)
    total = np.full(angle.size, shares[0])
    for k, n in enumerate(orders):
        total += shares[2 * k + 1] * np.cos(n * angle) + shares[2 * k + 2] * np.sin(n * angle)
    return total


def _angles(places: IntArray, period: float) -> FloatArray:
    return np.asarray(2.0 * np.pi / period * places, dtype=np.float64)


def _waves(turn: FloatArray, orders: Sequence[int]) -> tuple[FloatArray, FloatArray]:
    """Return a constant, cosine and sine of each order, and their derivatives by the angle."""
    rows, slopes = [np.ones(turn.size)], [np.zeros(turn.size)]
    for n in orders:
        cosine, sine = np.cos(n * turn), np.sin(n * turn)
        rows += [cosine, sine]
        slopes += [-n * sine, n * cosine]
    return np.array(rows), np.array(slopes)


def _followed(y: FloatArray, u: FloatArray, gain: float) -> bool:
    """Return whether the displacement follows the fast part of an input, so that it was drive.

    Differences of high order remove slow motion; those of the displacement are regressed on those
    of the input at several lags.
    """
    moved, tried = np.diff(y, _ORDER), np.diff(u, _ORDER)
    size = np.abs(tried)
    jumps = size > _FAR * float(np.median(size))
    rows = np.array([tried[_LAGS - k : tried.size - k] for k in range(_LAGS)])
    answer = moved[_LAGS:]
    calm = ~np.any([jumps[_LAGS - k : jumps.size - k] for k in range(_LAGS)], axis=0)
    # a jump of the drive is no noise
    if np.median(size) > NEGLIGIBLE * float(np.ptp(u)) and float(np.mean(calm)) > 0.25:
        rows, answer = rows[:, calm], answer[calm]
    grams = rows @ rows.T
    shares = solve_least_squares(grams, rows @ answer, 1e-8).values
    explained = float(shares @ grams @ shares)
    rest = answer - shares @ rows
    chance = float(rest @ rest) / max(answer.size - _LAGS, 1)
    # neighbouring differences of white noise are alike: fewer are independent
    if explained < 8.0 * _LAGS * chance:
        return False
    return sqrt(explained / max(float(np.trace(grams)) / _LAGS, 1e-300)) > _FOLLOWED * gain
