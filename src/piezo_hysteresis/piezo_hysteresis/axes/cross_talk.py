"""Cross-talk: which axis moves with the voltage of another one, and by how much."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import norm

from piezo_hysteresis.arrays import ComplexArray, FloatArray, IntArray
from piezo_hysteresis.axes.axes_record import AxesRecord
from piezo_hysteresis.axes.frequency_response import excited, response, spectra
from piezo_hysteresis.axes.modal_model import play_bank
from piezo_hysteresis.axes.mode_talk import ModeTalk, mode_talk
from piezo_hysteresis.common.wording import counted
from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.numerics.linalg import failing_as

# Names of the effect.
STATIC, THROUGH_MODE = 'cross_talk', 'cross_talk_through_mode'
# Next to a mode, static cross-talk is named from this part of that of the mode on: the response of
# the axis that drives it is known to a few percent at each frequency.
_NEXT_TO_MODE = 0.5
# What is static and what goes through a mode add up to the slow motion. Where both together are
# more than so many times that, they cancel each other: the axes share the mode, and the records
# do not distinguish the two.
_CANCELLED = 2.0
# Lines below this part of the first resonance are static.
_STATIC = 0.2
_FEWEST_LINES = 4
# Chance of any false pair in records without cross-talk.
FALSE_PAIRS = 1e-3
# Least part of the stroke that counts as cross-talk.
LEAST = 1e-3
# Half widths of the plays of the own voltage, in its largest value.
_WIDTHS = np.array([0.03, 0.08, 0.2, 0.4, 0.7])
_TURNS = 3  # of the weights
_NEAR = 5  # lines that share a weight
_SAME = 1e-3  # voltages are the same that differ by a smaller part


@dataclass(frozen=True)
class CrossTalk:
    """The cross-talk of one pair, static or through a mode."""

    voltage: int  # axis whose voltage acts, from 1 on
    displacement: int  # axis that moves, from 1 on
    # motion of the axis, as a part of that of the axis of the voltage; where that one is not
    # measured, of its own motion by the same voltage
    size: float
    std: float  # standard deviation of the size
    p_value: float  # chance of such a size in any pair of records without cross-talk
    measured: bool = True  # whether the displacement of the axis of the voltage is measured
    frequency: float = 0.0  # of the mode that it goes through [Hz]; 0 is static cross-talk
    damping: float = 0.0  # ratio of that mode

    @property
    def name(self) -> str:
        """Name of the effect."""
        return THROUGH_MODE if self.frequency > 0.0 else STATIC

    def __str__(self) -> str:
        of = f'the motion of axis {self.voltage}'
        if not self.measured:
            of = f'its own motion with the same voltage of axis {self.voltage}'
        size = f'{100.0 * self.size:{".2g" if abs(self.size) < 1.0 else ".0f"}}'
        if self.frequency > 0.0:
            of += (
                f' through a mode at {self.frequency:.4g} Hz, '
                f'{0.5 / self.damping:.2g} times as much at that frequency'
            )
        size = f'{size} ± {100.0 * self.std:.1g} %'
        return f'{self.name}: axis {self.displacement} moves {size} of {of}'


def cross_talk(records: Sequence[AxesRecord], below: float | None = None) -> list[CrossTalk]:
    """Return the pairs of axes with cross-talk, static or through a mode, the largest first.

    Records are periodic and drive the axes independently. Displacement j is that of the actuator
    with voltage j; other voltages may follow. Below a fifth of the first resonance, unless `below`
    [Hz] is stated, the response counts as static. A mode is sought where an axis repeats its
    voltage in records in which the others do not.
    """
    inputs, outputs = records[0].axes, records[0].outputs
    if inputs < max(outputs, 2):
        raise RecordError(
            'cross-talk is a matter of pairs, and the records have '
            f'{counted(inputs, "voltage")} and '
            f'{counted(outputs, "displacement")}: choose columns with --voltage and --displacement'
        )
    with failing_as(RecordError('the records do not determine the response of all axes')):
        if below is None:
            below = _STATIC * _resonance(records)
        measured = measured_pairs(records, below)
        modes = {
            pair: mode
            for pair, mode in _through_modes(records, outputs).items()
            if abs(mode.size) + abs(mode.static) < _CANCELLED * abs(measured[pair][0])
        }
    tests = outputs * (inputs - 1)
    pairs = [
        CrossTalk(
            i + 1,
            j + 1,
            size,
            std,
            min(1.0, 2.0 * tests * float(norm.sf(abs(size) / max(std, 1e-300)))),
            i < outputs,
        )
        for (j, i), (size, std) in measured.items()
    ]
    pairs = [_beyond_mode(each, modes) for each in pairs]
    found = [each for each in pairs if each.p_value < FALSE_PAIRS and abs(each.size) > LEAST]
    found += [
        CrossTalk(
            i + 1, j + 1, mode.size, mode.std, 0.0, frequency=mode.frequency, damping=mode.damping
        )
        for (j, i), mode in modes.items()
    ]
    return sorted(found, key=lambda pair: -abs(pair.size))


def _through_modes(records: Sequence[AxesRecord], outputs: int) -> dict[tuple[int, int], ModeTalk]:
    """Return the modes through which axes act on others, by (moved j, voltage i) from 0 on."""
    _, u, _ = spectra(records)
    found = {}
    for j in range(outputs):
        groups = _repeated(u[:, excited(u), j])
        for i in range(outputs):
            mode = mode_talk(records, (j, i), groups) if i != j and groups else None
            if mode is not None:
                found[j, i] = mode
    return found


def _beyond_mode(pair: CrossTalk, modes: dict[tuple[int, int], ModeTalk]) -> CrossTalk:
    """Return the static cross-talk of a pair without what goes through a mode."""
    mode = modes.get((pair.displacement - 1, pair.voltage - 1))
    if mode is None:
        return pair
    static = mode.static if abs(mode.static) > _NEXT_TO_MODE * abs(mode.size) else 0.0
    return replace(pair, size=static, std=mode.static_std)


def _resonance(records: Sequence[AxesRecord]) -> float:
    """Return the first frequency [Hz] at which a displacement is twice that of slow voltages."""
    found = response(records)
    first = float(found.frequency[-1])
    for j in range(found.matrix.shape[1]):
        size = np.abs(found.matrix[:, j, j])
        resonant = np.flatnonzero(size > 2.0 * np.median(size[: max(1, size.size // 50)]))
        if resonant.size:
            first = min(first, float(found.frequency[resonant[0]]))
    return first


def measured_pairs(
    records: Sequence[AxesRecord], below: float
) -> dict[tuple[int, int], tuple[float, float]]:
    """Return size and deviation of the cross-talk of each pair (moved j, voltage i), from 0 on.

    Records in which an axis repeats its voltage differ by the other voltages alone: whatever the
    own voltage makes, hysteresis included, is the same in them. Without such records it is fitted
    by what an actuator makes of it: plays, square, creep, lag, inertia.
    """
    frequency, u, y = spectra(records)
    lines = np.flatnonzero(excited(u) & (frequency <= below))
    if lines.size < _FEWEST_LINES:
        raise RecordError(
            f'{counted(lines.size, "line")} below {below:.3g} Hz cannot show static '
            'cross-talk; record longer periods'
        )
    x = frequency[lines] / below
    u, y = u[:, lines], y[:, lines]
    found = {}
    for j in range(y.shape[2]):
        others = [i for i in range(u.shape[2]) if i != j]
        a = np.concatenate([u[:, :, others], 1j * x[:, None] * u[:, :, others]], 2)
        groups = _repeated(u[:, :, j])
        if sum(len(those) - 1 for those in groups) >= len(others):
            kept = [(_apart(a[those]), _apart(y[those, :, j])) for those in groups]
            a, b = (np.concatenate([pair[k] for pair in kept]) for k in (0, 1))
            lost = 2 * len(groups) * lines.size
        else:
            bare = np.stack([u[:, :, j], *_makes(u[:, :, j], x)], 2)
            own = np.stack([_plays(each, lines) for each in _same_scale(records, j)])
            a, b, lost = np.concatenate([a, bare, own], 2), y[:, :, j], 0
        c, std = _weighted(a, b, lost)
        for place, i in enumerate(others):
            gain = _gain(u, y, i if i < y.shape[2] else j)
            found[j, i] = (float(c[place] / gain), float(std[place] / abs(gain)))
    return found


def _gain(u: ComplexArray, y: ComplexArray, of: int) -> float:
    """Return what axis `of` moves with its own voltage [m/V]."""
    power = float(np.sum(np.abs(u[:, :, of]) ** 2))
    moved = float(np.vdot(u[:, :, of], y[:, :, of]).real)
    if moved == 0.0 or power == 0.0:
        raise RecordError(
            f'axis {of + 1} does not move with its own voltage; leave it out with --voltage and '
            '--displacement, or drive it'
        )
    return moved / power


def _repeated(u: ComplexArray) -> list[list[int]]:
    """Return groups of records of the same voltage, of spectra (records, lines)."""
    groups: list[list[int]] = []
    for k, each in enumerate(u):
        near = [g for g in groups if np.linalg.norm(u[g[0]] - each) < _SAME * np.linalg.norm(each)]
        if near:
            near[0].append(k)
        else:
            groups.append([k])
    return [those for those in groups if len(those) > 1]


def _apart(x: ComplexArray) -> ComplexArray:
    """Return what records of a group have beyond their mean."""
    return np.asarray(x - x.mean(0))


def _makes(u: ComplexArray, x: FloatArray) -> list[ComplexArray]:
    """Return what lag, inertia and creep make of a voltage, each (records, lines)."""
    return [1j * u, 1j * x * u, x**2 * u, np.log(x) * u]


def _same_scale(records: Sequence[AxesRecord], j: int) -> list[FloatArray]:
    """Return the voltages of axis j about their mean, over the largest one of all records."""
    given = [each.mean_period().voltage[:, j] for each in records]
    given = [each - each.mean() for each in given]
    largest = float(np.abs(given).max())
    largest = largest if largest > 0.0 else 1.0
    return [each / largest for each in given]


def _plays(u: FloatArray, lines: IntArray) -> ComplexArray:
    """Return spectra of the plays and of the square of a voltage, (lines, features)."""
    bank = np.empty((u.size, _WIDTHS.size))
    play_bank(np.ascontiguousarray(u), _WIDTHS, bank, 2)
    return np.asarray(np.fft.rfft(np.column_stack([bank, u**2]), axis=0)[lines])


def _weighted(a: ComplexArray, y: ComplexArray, lost: int) -> tuple[FloatArray, FloatArray]:
    """Return real coefficients and their deviations; each line weighs by what it leaves."""
    # a (records, lines, features); y (records, lines); lost: equations that were used before
    scale = np.sqrt(np.mean(np.abs(a) ** 2, (0, 1))) + 1e-300
    a = a / scale
    weight = np.ones(y.shape[1])
    for _ in range(_TURNS):
        left, right = _real(a * weight[:, None]), _real(y * weight)
        c, _, rank, _ = np.linalg.lstsq(left, right, rcond=1e-9)
        power = np.mean(np.abs(y - a @ c) ** 2, 0)
        ones = np.ones(_NEAR)
        near = np.convolve(power, ones, 'same') / np.convolve(np.ones(power.size), ones, 'same')
        variance = float(np.sum((right - left @ c) ** 2)) / max(right.size - lost - int(rank), 1)
        covariance = variance * np.linalg.pinv(left.T @ left, 1e-12)
        weight = 1.0 / np.sqrt(near + 1e-6 * near.max() + 1e-300)
    return c / scale, np.sqrt(np.diag(covariance)) / scale


def _real(x: ComplexArray) -> FloatArray:
    """Return equations of complex numbers, (records, lines[, features]), as real ones."""
    rows = x.reshape(x.shape[0] * x.shape[1], *x.shape[2:])
    return np.concatenate([rows.real, rows.imag])
