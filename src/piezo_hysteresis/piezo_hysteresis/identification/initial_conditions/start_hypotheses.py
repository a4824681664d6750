"""Selection of the initial condition of records by a model.

Hypotheses on the initial condition are tested in sequence. A hypothesis with nuisance parameters
must reduce the cost by more than its penalty.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import isfinite, log, sqrt

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.common.cached_property import cached_property
from piezo_hysteresis.identification.fit_data import WAY_IN, FitData, led_in
from piezo_hysteresis.identification.free_run import read, samples_late
from piezo_hysteresis.identification.initial_conditions.initial_state import (
    InitialStateRun,
    start_rows,
)
from piezo_hysteresis.identification.initial_conditions.record_start import (
    SETTLED,
    STEP,
    RecordStart,
    cycle_of,
    deepened,
    refined,
    rivals,
)
from piezo_hysteresis.identification.prediction import Prediction
from piezo_hysteresis.models import Model
from piezo_hysteresis.models.simulation.plan import free_states
from piezo_hysteresis.numerics.qr import inner
from piezo_hysteresis.records import Record

Hypothesis = tuple[float, RecordStart]

# An alternative start is accepted if it reduces what the cost exceeds the noise by this share, by
# more if the record shows its initial condition, and the cost by this multiple of the squared
# noise: five standard deviations.
_SHARE = 0.1
_SHOWN = 0.3
_SURE = 25.0
# Share from which a start is tried in a fit of its own, and share of what is missed that this fit
# must explain: parameters and states together explain much of an effect that the model lacks.
_HINTED, _NEARLY_ALL = 0.05, 0.9
# Part of a record, and share of the rms residual by which starts may still differ after it, where
# the effect of the initial condition has decayed.
_EARLY, _ALIKE = 8, 0.01
# The same share to compare starts on that part only, which leaves costs wrong by up to twice it.
# One over the largest such part of a record, and samples behind it.
_EQUAL, _SMALL_PART, _MARGIN = 0.002, 4, 8
# Another level is tested if the cost exceeds this multiple of the squared noise, and accepted if
# it reduces the cost by this share.
_LEFT = 1.05
_LEVEL_SHARE = 0.03
# Largest number of levels before a record.
_MOST_LEVELS = 3
# Ratio of the costs with levels and with a free state up to which levels are preferred.
_AS_WELL = 1.01
# Largest level, as a share of the largest voltage of the record.
_FARTHEST = 1.5
# Number of starts with one more level that are refined.
_REFINED = 3
# A step is tested in a fit if its cost is at most this multiple of the previous cost.
_WORTH_A_TRY = 100.0
# Shares of the largest voltage by which an unknown level before a record is refined, and the
# number of Gauss-Newton steps afterwards.
_STEPS = (0.12, 0.06, 0.03, 0.015)
_TURNS = 3
# Ratio of the squared error of a run to its linearised cost from which runs are compared.
_MISLEADS = 1.5
# Largest number of steps of the levels of the selected start, and their tolerance as a share of
# the largest voltage.
_SETTLING_TURNS = 10
_STILL = 1e-4


@dataclass(frozen=True)
class _Beginning:
    """First samples of a record, in which its starts differ, and the cost of the others [m^2]."""

    target: FitData
    later: float = 0.0


@dataclass(frozen=True)
class _Needed:
    """What a start must gain over the one that is kept."""

    kept: Hypothesis
    noise: float  # square of the noise of a sample [m^2]
    samples: int

    def accepts(self, other: Hypothesis) -> bool:
        """Return whether a start explains enough of what the kept one misses."""
        return self._explains(other, _SHARE if self.kept[1].kind == 'estimate' else _SHOWN)

    def hints_at(self, other: Hypothesis) -> bool:
        """Return whether a start may explain enough after its levels are refined."""
        return self._known(other) or self._explains(other, _HINTED)

    def deserves_more(self, other: Hypothesis) -> bool:
        """Return whether a start that is accepted as it is leaves more than the noise."""
        return self.leaves_more(other) and (self._known(other) or self.accepts(other))

    def leaves_more(self, other: Hypothesis) -> bool:
        """Return whether a start leaves more than the noise."""
        return other[0] > _LEFT * self.noise * self.samples

    def _known(self, other: Hypothesis) -> bool:
        """Return whether a start has as many levels as the kept one."""
        return len(other[1].levels) == len(self.kept[1].levels)

    def _explains(self, other: Hypothesis, share: float) -> bool:
        gain, missed = self.kept[0] - other[0], self.kept[0] - self.noise * self.samples
        return gain > share * max(missed, 0.0) and gain > _SURE * self.noise


class InitialConditionSelector:
    """Compares start hypotheses of records by a model with known values."""

    def __init__(
        self,
        model: Model,
        values: Mapping[str, float],
        sampling_offset: float,  # [s]
        records: Sequence[Record],
        wanted: str,
        *,
        lasting: bool = False,
        by_run: bool = False,
    ) -> None:
        self._model, self._packed, self._late = model, model.pack(values), sampling_offset
        self._records = {record.name: record for record in records}
        self._values, self._wanted = values, wanted
        self._lasting, self._by_run = lasting, by_run

    def left(self, target: FitData) -> FloatArray:
        """Return the residual of a target, shape (m,) [m]."""
        return self._predicted(target).residual

    def _predicted(self, target: FitData) -> Prediction:
        return Prediction(self._model, self._packed, target, self._late)

    def square(self, target: FitData) -> float:
        """Return the sum of squares of the residual [m^2], infinite where it is not finite."""
        return self._square(self._predicted(target))

    def _square(self, found: Prediction) -> float:
        return square_of(_run_error(found) if self._by_run else found.residual)

    def best_start(self, target: FitData, zero: str) -> FitData:
        """Return the target with the start of the smallest residual, or with its initial guess."""
        record = self._record_of(target)
        if record is None:
            return target
        free = replace(target, own_zero=zero != 'common')
        found = self._predicted(free)
        kept = best = self._square(found), target.begins
        early, others = _Beginning(free), list[Hypothesis]()
        if self._is_free(record):
            starts = [
                each
                for each in rivals(record, self._wanted, levels=self._levels)
                if each != SETTLED or self._repeats(target)
            ]
            if target.begins.kind != 'estimate' and self._fading_start(found, record, starts):
                return target
            early = self._beginning(found, record, starts)
            others = [self._tried(early, record, each) for each in starts]
            if early.target is not free:
                # as it is: a part of a record may lack the cycle that its start repeats
                kept = self.square(early.target) + early.later, target.begins
            best = min([kept, *others], key=_cost)
        noise = target.noise if isfinite(target.noise) else 0.0
        needed = _Needed(kept, noise**2, target.measured.size)
        if needed.hints_at(best):
            best = self._with_levels(early, record, best, needed.deserves_more)
        if self._lasting and others and not best[1].levels and best[1].kind == 'estimate':
            best = self._levels_instead(early, record, best, others, needed)
        if needed.accepts(best):
            kept = best
        kept = self._plainest(kept, others, target.measured.size)
        return target if kept[1] == target.begins else led_in(target, record, kept[1])

    def _fading_start(
        self, found: Prediction, record: Record, starts: Sequence[RecordStart]
    ) -> bool:
        """Return whether no start can reduce the cost by `_SHOWN`, since their effect decays.

        The residual after an eighth of the record is then the same for every start, up to
        `_ALIKE` of it, and the larger part of the cost.
        """
        target = found.target
        early = target.measured.size // _EARLY
        count = target.voltage.size - target.first - early * target.stride
        left = found.residual[early:]
        if target.valid is not None:
            left = left[target.valid[early:] > 0.0]
        if target.own_zero:
            left = left - left.mean()
        least = square_of(left)
        if not (1.0 - _ALIKE) ** 2 * least > (1.0 - _SHOWN) * self._square(found):
            return False
        limit = _ALIKE * sqrt(least / left.size)
        del left
        return all(
            sum(
                float(np.max(np.abs(change[-count:])))
                for change in self._changes(found, record, start)
            )
            <= limit
            for start in starts
        )

    def _changes(
        self, found: Prediction, record: Record, start: RecordStart
    ) -> Iterator[FloatArray]:
        """Yield the changes of the driven samples by a start and by its states, shape (n,)."""
        target, count = led_in(found.target, record, start), self._driven(found.target)
        late = samples_late(self._model, target.dt, self._late)
        run = InitialStateRun(self._model, self._packed, target)
        change = read(run.response, target, late)[-count:] - found.response[-count:]
        yield _or_infinite(change)
        if start == RecordStart('estimate'):
            for row in start_rows(run)[0]:
                yield _or_infinite(read(row, target, late)[-count:])

    def _beginning(
        self, found: Prediction, record: Record, starts: Sequence[RecordStart]
    ) -> _Beginning:
        """Return the part of a record at its beginning in which starts differ.

        Behind it they differ by a constant up to `_EQUAL` of the residual: one sample with the
        weight of all stands for the rest. The whole record, if that part is no small one; starts
        without levels are too few for this to save time.
        """
        target, left = found.target, found.residual
        levels = any(start.levels for start in starts)
        if not levels or self._by_run or target.shared is not None or not np.isfinite(left).all():
            return _Beginning(target)
        limit = _EQUAL * sqrt(square_of(left) / left.size)
        farthest = _FARTHEST * float(np.max(np.abs(record.voltage)))
        probes = [RecordStart('estimate', (way * farthest,)) for way in (-1.0, 1.0)]
        lasts = 0
        for start in [*probes, *(start for start in starts if not start.levels)]:
            for change in self._changes(found, record, start):
                if not np.all(np.isfinite(change)):
                    return _Beginning(target)
                moves = np.flatnonzero(np.abs(change - change[-1]) > limit)
                lasts = max(lasts, int(moves[-1]) + 1 if moves.size else 0)
                if lasts > target.voltage.size // _SMALL_PART:
                    return _Beginning(target)
        size = max(lasts - (target.first - target.origin), 0) // target.stride + _MARGIN
        if size > target.measured.size // _SMALL_PART:
            return _Beginning(target)
        return _first_samples(found, size)

    @staticmethod
    def _driven(target: FitData) -> int:
        """Return the number of driven samples of the record, without its lead-in."""
        return target.voltage.size - target.origin

    def _repeats(self, target: FitData) -> bool:
        """Return whether the whole record is a cycle; a part of it may close by chance."""
        return cycle_of(self._records[target.name.removesuffix(WAY_IN)]) > 0

    def settled(self, target: FitData) -> FitData:
        """Return the target with the levels before it at a stationary point of the cost.

        The derivatives by the levels are projected out of the cost, which hardly depends on them;
        a run that begins after them has no such derivatives.
        """
        record = self._record_of(target)
        if record is None or not target.begins.levels:
            return target
        found = self._predicted(target)
        most, largest = _AS_WELL * self._square(found), float(np.max(np.abs(record.voltage)))
        for _ in range(_SETTLING_TURNS):
            closer = self._stepped(found, record)
            if closer is None or not self._square(closer) <= most:
                return target
            pairs = zip(closer.target.begins.levels, found.target.begins.levels, strict=True)
            if max(abs(a - b) for a, b in pairs) <= _STILL * largest:
                return closer.target
            found = closer
        return target

    def as_run(self, target: FitData, given: FitData, zero: str) -> FitData:
        """Return the target with a start that fits better, if its linearised cost misleads."""
        if target.begins.kind != 'estimate':
            return target
        found = self._predicted(target)
        least = square_of(_run_error(found))
        if least <= _MISLEADS * square_of(found.residual):
            return target
        search = self._as_runs()
        other = search.best_start(given, zero)
        other = search.settled(replace(other, own_zero=target.own_zero))
        return other if search.square(other) < least else target

    def held(self, targets: Sequence[FitData], zero: str) -> list[FitData]:
        """Return the targets with levels held where their linearised cost misleads.

        The parameters see the run from levels that are held, so that they fit nothing that no
        level reaches.
        """
        return [self._held(target, zero) for target in targets]

    def _held(self, target: FitData, zero: str) -> FitData:
        if target.begins.held:
            free = replace(target, begins=replace(target.begins, held=False))
            other = self._as_runs().settled(free)
        else:
            other = self.as_run(target, target, zero)
            if other is target:
                return target
        return replace(other, begins=replace(other.begins, held=bool(other.begins.levels)))

    def square_of_runs(self, targets: Sequence[FitData]) -> float:
        """Return the sum of squares of the errors of runs, weighted as in a fit [m^2]."""
        search = self._as_runs()
        return sum(target.precision**2 * search.square(target) for target in targets)

    def _as_runs(self) -> InitialConditionSelector:
        return InitialConditionSelector(
            self._model, self._values, self._late, list(self._records.values()), self._wanted,
            lasting=self._lasting, by_run=True,
        )  # fmt: skip

    def _stepped(self, found: Prediction, record: Record) -> Prediction | None:
        """Return the prediction after a Gauss-Newton step of the levels, None out of reach."""
        levels, begins = found.nuisances.levels, found.target.begins
        reach = _FARTHEST * float(np.max(np.abs(record.voltage)))
        if not levels or not all(abs(level) <= reach for level in levels):
            return None
        return self._predicted(led_in(found.target, record, RecordStart(begins.kind, levels)))

    def with_steps(self, targets: Sequence[FitData]) -> tuple[list[FitData], float] | None:
        """Return targets that may begin with a step although their initial state is estimated.

        Parameters fitted together with initial states may hide that none are needed; a fit without
        them shows it.
        """
        changed, worth, samples = [], 0.0, sum(each.measured.size for each in targets)
        for target in targets:
            record = self._record_of(target)
            changed.append(target)
            if record is None or target.begins.kind != 'estimate' or not self._is_free(record):
                continue
            step = led_in(target, record, STEP)
            if self.square(step) <= _WORTH_A_TRY * self.square(target):
                changed[-1] = step
                worth += self._numbers(target.begins) * log(target.measured.size) / samples
        return (changed, worth) if worth > 0.0 else None

    def in_motion(self, targets: Sequence[FitData]) -> tuple[list[FitData], float] | None:
        """Return targets that may begin in motion although they begin with a step at 0 V.

        Parameters fitted together with a wrong start adapt to it, so that another start promises
        little before a fit with it.
        """
        changed, noise, before = list(targets), 0.0, 0.0
        for k, target in enumerate(targets):
            record, own = self._record_of(target), self.square(target)
            floor = target.noise**2 * target.measured.size if isfinite(target.noise) else 0.0
            noise, before = noise + min(floor, own), before + own
            if record is None or target.begins != STEP or not self._is_free(record):
                continue
            other = led_in(target, record, RecordStart('estimate'))
            if own - self.square(other) > _HINTED * max(own - floor, 0.0):
                changed[k] = other
        if all(map(FitData.begins_like, changed, targets)):
            return None
        return changed, 1.0 - _NEARLY_ALL * (before - noise) / before

    @cached_property
    def _levels(self) -> bool:
        """Whether levels before a record are tested, and not only states."""
        return any(b.has_memory if self._lasting else b.needs_levels for b in self._model.blocks)

    def _is_free(self, record: Record) -> bool:
        return 'auto' in (self._wanted, record.info.start)

    def _numbers(self, start: RecordStart) -> int:
        """Return the number of nuisance parameters of a record with an unknown initial state."""
        dt = min(record.dt for record in self._records.values())
        memory = not start.levels
        states = sum(len(free_states(s, dt, memory=memory)) for s in self._model.stages)
        return 1 + states + start.parameters

    def _record_of(self, target: FitData) -> Record | None:
        record = self._records.get(target.name.removesuffix(WAY_IN))
        if record is None or target.repeats > 1:
            return None
        return record.section(0, self._driven(target))

    def _tried(self, early: _Beginning, record: Record, start: RecordStart) -> Hypothesis:
        return self.square(led_in(early.target, record, start)) + early.later, start

    def _with_levels(
        self,
        early: _Beginning,
        record: Record,
        best: Hypothesis,
        deserves_more: Callable[[Hypothesis], bool],
    ) -> Hypothesis:
        """Return a start with refined levels, and more levels if the residual requires them."""
        if not best[1].levels:
            return best
        best = self._refined(early, record, best)
        while deserves_more(best) and len(best[1].levels) < _MOST_LEVELS:
            more = [self._tried(early, record, each) for each in deepened(best[1], record)]
            first = sorted(more, key=_cost)[:_REFINED]
            other = min([self._refined(early, record, each) for each in first], key=_cost)
            if best[0] - other[0] <= _LEVEL_SHARE * best[0]:
                break
            best = other
        return best

    def _levels_instead(
        self,
        early: _Beginning,
        record: Record,
        best: Hypothesis,
        others: Sequence[Hypothesis],
        needed: _Needed,
    ) -> Hypothesis:
        """Return levels before the record where they fit as well as an initial state."""
        levels = [each for each in others if each[1].levels]
        if not levels:
            return best
        levelled = self._with_levels(early, record, min(levels, key=_cost), needed.leaves_more)
        return levelled if levelled[0] <= _AS_WELL * best[0] else best

    def _refined(self, early: _Beginning, record: Record, best: Hypothesis) -> Hypothesis:
        """Return a start with its last level refined by search, then all by Gauss-Newton steps."""
        for share in _STEPS:
            near = refined(best[1], record, share)
            best = min([best, *(self._tried(early, record, each) for each in near)], key=_cost)
        return self._sharpened(early, record, best)

    def _sharpened(self, early: _Beginning, record: Record, best: Hypothesis) -> Hypothesis:
        """Return a start with its levels refined by Gauss-Newton steps."""
        found = self._predicted(led_in(early.target, record, best[1]))
        for _ in range(_TURNS):
            closer = self._stepped(found, record)
            if closer is None:
                break
            cost = self._square(closer) + early.later
            if not cost <= best[0] * (1.0 + 1e-6):
                break
            found, best = closer, (cost, closer.target.begins)
        return best

    def _plainest(
        self, kept: Hypothesis, others: Sequence[Hypothesis], samples: int
    ) -> Hypothesis:
        """Return a start without nuisance parameters where it fits as well as one with them.

        Each parameter must reduce the cost as the Bayesian information criterion demands.
        """
        if kept[1].kind != 'estimate':
            return kept
        limit = kept[0] * (1.0 + self._numbers(kept[1]) * log(samples) / samples)
        plain = [each for each in others if each[1].kind != 'estimate' and each[0] <= limit]
        return min(plain, key=_cost, default=kept)


def _run_error(found: Prediction) -> FloatArray:
    """Return the error of a run with the samples that the input before the record decides.

    A state that the actuator cannot have had leaves a jump behind them.
    """
    view, response = found.target, found.target.pick(found.response)
    with np.errstate(over='ignore', invalid='ignore'):
        if view.own_zero:
            response = response + float(np.mean(view.kept(view.measured - response)))
        error = view.measured - response
        return error if view.valid is None else error * view.valid


def _first_samples(found: Prediction, size: int) -> _Beginning:
    """Return the first `size` compared samples, the last of which stands for all that follow."""
    whole, response = found.target, found.target.pick(found.response)
    factors = np.ones(whole.measured.size) if whole.factors is None else whole.factors
    error, squares = (whole.measured - response)[size:], factors[size:] ** 2
    weight = float(squares.sum())
    mean = inner(squares, error) / weight if weight > 0.0 else 0.0
    measured, factors = whole.measured[:size].copy(), factors[:size].copy()
    measured[-1], factors[-1] = response[size - 1] + mean, sqrt(weight)
    part = replace(
        whole,
        voltage=whole.voltage[: whole.first + size * whole.stride],
        measured=measured,
        valid=None,
        influence=factors,
    )
    return _Beginning(part, inner(squares, (error - mean) ** 2))


def _or_infinite(change: FloatArray) -> FloatArray:
    """Return a change of the displacement in place, infinite where it is not finite."""
    change[~np.isfinite(change)] = np.inf
    return change


def _cost(evaluated: Hypothesis) -> float:
    return evaluated[0]


def square_of(error: FloatArray) -> float:
    """Return the sum of squares of a residual [m^2], infinite where it is not finite."""
    total = inner(error, error)
    return total if isfinite(total) else float('inf')
