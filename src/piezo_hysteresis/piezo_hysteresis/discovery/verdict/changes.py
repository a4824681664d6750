"""Changes of a fixed baseline in words: each with its size and standard deviation."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from math import inf

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Slot
from piezo_hysteresis.common.wording import counted
from piezo_hysteresis.discovery.detection.statements import in_prefixes
from piezo_hysteresis.discovery.selection.candidate_fit import CandidateFit, nudged
from piezo_hysteresis.discovery.selection.policy import POLICY
from piezo_hysteresis.discovery.verdict.verdict import Number
from piezo_hysteresis.records import Record

# Changes and skipped steps that a sentence names; the others are counted.
LISTED = 3
# Change in standard deviations from which a parameter counts as changed.
CHANGED = POLICY.noise_deviations
# Relative change of the gain from which it is stated, and of the width of the loop. Chosen: a
# width has the weights of all plays, and a tenth of it is a hundredth of the stroke.
GAIN_CHANGED, WIDTH_CHANGED = 2e-3, 2e-2
# Relative change from which a parameter without a standard deviation counts as changed: a time
# limit leaves none. Chosen; it affects only this sentence.
MOVED = 0.05


def changes_of(
    numbers: Mapping[str, Number],
    start: CandidateFit,
    final: CandidateFit,
    records: Sequence[Record],
) -> tuple[str, ...]:
    """Return the changes of a baseline in words: parameters, most significant first, loop, gain.

    The parameters of the hysteresis are stated as the width of its loop and its gain; of the
    others, those are omitted that only follow the gain, and those without a standard deviation
    that hardly changed or ended at a bound.
    """
    loop = _Loop(numbers, start, final, records)
    gain, gain_std = loop.deviates(loop.gain)
    width, width_std = loop.deviates(loop.width)
    found = [
        f'{name} {_between(start.values[name], numbers[name])}'
        for name in _changed(numbers, start, 1.0 + gain, loop)
    ]
    if len(found) > LISTED:
        found[LISTED:] = [counted(len(found) - LISTED, 'further parameter')]
    if abs(width) >= max(WIDTH_CHANGED, CHANGED * width_std):
        found.append('loop width ' + _percent(width, width_std))
    if abs(gain) >= GAIN_CHANGED:
        found.append('gain ' + _percent(gain, gain_std))
    return tuple(found)


def _changed(
    numbers: Mapping[str, Number], start: CandidateFit, gain: float, loop: _Loop
) -> list[str]:
    """Return the names of the parameters outside the hysteresis that changed, clearest first.

    Behind those with a standard deviation are the others, by how much their change moves the
    response: a parameter that the records hardly show moves far without any.
    """
    shape = _shape_of(start)
    within = {
        q.name: q.name not in numbers or q.low < numbers[q.name].value < q.high
        for q in start.model.parameters
    }
    sure: dict[str, float] = {}
    unsure: dict[str, float] = {}
    for name, number in numbers.items():
        follows = number.unit.startswith('m')
        if name in shape:
            continue
        change = abs(number.value - start.values[name] * (gain if follows else 1.0))
        least = GAIN_CHANGED * abs(start.values[name]) if follows else 0.0
        if number.std and change > max(CHANGED * number.std, least):
            sure[name] = change / number.std
        elif number.std is None and not follows and within[name]:
            moved = change / max(abs(start.values[name]), 1e-300)
            if moved > MOVED:
                unsure[name] = loop.moves(name)
    return [
        *sorted(sure, key=lambda each: -sure[each]),
        *sorted(unsure, key=lambda each: -unsure[each]),
    ]


def _shape_of(start: CandidateFit) -> set[str]:
    """Return the names of the parameters of the hysteresis."""
    blocks = (each for each in start.model.blocks if each.slot is Slot.HYSTERESIS)
    return {q.name for block in blocks for q in block.parameters}


def _between(before: float, after: Number) -> str:
    """Return two values with their unit, and the standard deviation of the second."""
    spread = '' if not after.std else f' ± {_in(after.std, after.unit, 2)}'
    return f'{_in(before, after.unit)} to {_in(after.value, after.unit)}{spread}'


def _in(value: float, unit: str, digits: int = 4) -> str:
    return f'{value:.{digits}g}' if unit in ('', '1') else in_prefixes(value, unit)


def _percent(change: float, std: float) -> str:
    return f'{100.0 * change:+.2g}' + (f' ± {100.0 * std:.1g} %' if std > 0.0 else ' %')


class _Loop:
    """Response of the baseline to the slowest drive, before and after a change."""

    def __init__(
        self,
        numbers: Mapping[str, Number],
        start: CandidateFit,
        final: CandidateFit,
        records: Sequence[Record],
    ) -> None:
        driven = [each for each in records if np.ptp(each.voltage) > 0.0]
        self._driven = driven
        self._slow = min(driven, key=lambda each: each.info.frequency or np.inf, default=None)
        self._start, self._final, self._numbers = start, final, numbers
        shape = _shape_of(start)
        # frequencies and damping stay those of the baseline: a lag is no hysteresis
        self._names = [n for n, v in numbers.items() if v.unit.startswith('m') or n in shape]
        self._before = self._respond(start.values)

    def gain(self, other: Mapping[str, float]) -> float:
        """Return the gain over that of the baseline, with some `other` values."""
        return self._gain_of(self._respond(self._values(other)))

    def _gain_of(self, after: FloatArray) -> float:
        before = self._before
        if not before.size:
            return 1.0
        return float(before @ after) / max(float(before @ before), 1e-300)

    def moves(self, name: str) -> float:
        """Return how much the change of one parameter moves the response to all records [m]."""
        back = {**self._changed_values, name: self._start.values[name]}
        squares = [
            float(np.sum((after - self._run(each, back)) ** 2))
            for each, after in zip(self._driven, self._changed_runs, strict=True)
        ]
        return float(np.sqrt(sum(squares) / max(sum(map(len, self._driven)), 1)))

    @cached_property
    def _changed_values(self) -> dict[str, float]:
        return {**self._start.values, **{k: v.value for k, v in self._numbers.items()}}

    @cached_property
    def _changed_runs(self) -> list[FloatArray]:  # [m]
        return [self._run(each, self._changed_values) for each in self._driven]

    def width(self, other: Mapping[str, float]) -> float:
        """Return the width of the loop, relative to its gain, over that of the baseline."""
        if self._slow is None:
            return 1.0
        voltage = self._slow.voltage[self._slow.warm_up_samples :]
        after = self._respond(self._values(other))
        area, known = (float(np.trapezoid(y, voltage)) for y in (after, self._before))
        # a loop of a thousandth of the stroke has no width that could change
        least = 1e-3 * float(np.ptp(self._before) * np.ptp(voltage))
        return area / (self._gain_of(after) * known) if abs(known) > least else 1.0

    def deviates(self, function: Callable[[Mapping[str, float]], float]) -> tuple[float, float]:
        """Return the relative change that a function states, and its standard deviation."""
        here, fitted = function({}), self._final.fitted
        free = () if fitted is None else fitted.free
        names = [n for n in self._names if n in free and 0.0 < (self._numbers[n].std or 0.0) < inf]
        if fitted is None or not names:
            return here - 1.0, 0.0
        steps = {name: nudged(self._final, name)[name] for name in names}
        slopes = [
            (function({name: step}) - here)
            / (step - self._final.values[name])
            * (self._numbers[name].std or 0.0)
            for name, step in steps.items()
        ]
        rows = [fitted.free.index(name) for name in names]
        square = float(np.array(slopes) @ fitted.correlation[np.ix_(rows, rows)] @ slopes)
        return here - 1.0, max(square, 0.0) ** 0.5

    def _values(self, other: Mapping[str, float]) -> dict[str, float]:
        fitted = {name: self._numbers[name].value for name in self._names}
        return {**self._start.values, **fitted, **other}

    def _respond(self, values: Mapping[str, float]) -> FloatArray:  # [m]
        return np.zeros(0) if self._slow is None else self._run(self._slow, values)

    def _run(self, record: Record, values: Mapping[str, float]) -> FloatArray:  # [m]
        """Return the response of the baseline to a record behind its warm-up, without mean."""
        model = self._start.model
        run = np.asarray(model.respond(record.voltage, model.pack(values), record.dt))
        run = run[record.warm_up_samples :]
        return np.asarray(run - run.mean())
