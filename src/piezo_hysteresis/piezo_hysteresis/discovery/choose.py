"""Choice of a model for records: proposed chains, one step of all at a time, and its rules."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from math import inf
from typing import Any

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks import named_block
from piezo_hysteresis.blocks.base import Block, InterSample
from piezo_hysteresis.blocks.effect import Effect
from piezo_hysteresis.discovery.data.dataset import thinned
from piezo_hysteresis.discovery.selection.policy import POLICY, number
from piezo_hysteresis.discovery.selection.rules import is_no_worse
from piezo_hysteresis.identification.checks import require_usable
from piezo_hysteresis.identification.fit import FitResult, fit
from piezo_hysteresis.identification.fit_data import FitData, targets_of, with_start_of
from piezo_hysteresis.identification.initial_conditions.revision import RecordAssumptions
from piezo_hysteresis.identification.objective import SAMPLING_OFFSET
from piezo_hysteresis.identification.output_error import output_error, refined, suited
from piezo_hysteresis.identification.prediction import predictions
from piezo_hysteresis.models import (
    EFFECT_NAMES,
    Candidate,
    Model,
    add_effect,
    applicable,
    described,
    named,
)
from piezo_hysteresis.models.named import LADDER, MEMORIES
from piezo_hysteresis.numerics.linalg import solve_square
from piezo_hysteresis.records import Record


@dataclass(frozen=True)
class ChoicePolicy:
    """Thresholds in addition to `FITS`; fields have ``metadata`` as those of `SelectionPolicy`."""

    trained: float = number(
        0.7,
        '1',
        'Share of each record that is fitted; the rest is held out.',
        'chosen: usual in other tools',
    )
    min_gain: float = number(
        0.02,
        '1',
        'Share by which an effect must lower the fitted or the held-out error.',
        'chosen: less has no effect on tracking',
    )
    min_standard_errors: float = number(
        3.0,
        'standard deviations',
        'Joint deviation of the parameters of an effect from their neutral values.',
        'derived: one in 370 of a normal distribution; held-out data are also tested',
    )
    inner_loops: float = number(
        1.25,
        '1',
        'Held-out error of play operators, relative to Bouc-Wen, up to which they are selected: '
        'their inner loops close as in actuators, which records of few amplitudes do not show.',
        'chosen: accepts a quarter more error for loops that were not recorded',
    )
    one_level: float = number(
        0.8,
        '1',
        'Smallest reversal level, relative to the largest, of a voltage that counts as one '
        'amplitude.',
        'chosen: closer loops look alike',
    )
    rough: float = number(1e-4, '1', 'Relative change at which a trial stops.', 'effort')


CHOICE = ChoicePolicy()
#: Evaluations of the fits, and the accepted increase of the held-out error.
FITS = POLICY.but(first_evaluations=10, final_evaluations=80, worse=0.01)


@dataclass(frozen=True)
class HeldOutScore:
    """Error of the selected model on the held-out rest of a record."""

    record: str  # name of the record
    free_run_rms: float  # free-run error after the cut [m]
    nrmse_percent: float  # [%]


def predicts_better(
    trained: tuple[float, float], held_out: tuple[float, float], policy: ChoicePolicy = CHOICE
) -> bool:
    """Return whether an effect reduces one of two errors and does not increase the held-out one.

    Each error is a pair (before, after). Held-out data can reject an effect as in discovery. Here
    they can also propose one, because the model must predict and no effect is named.
    """
    lower = any(after <= (1.0 - policy.min_gain) * before for before, after in (trained, held_out))
    return lower and is_no_worse(*held_out, FITS)


def differs_from_none(
    away: FloatArray, std: FloatArray, correlation: FloatArray, policy: ChoicePolicy = CHOICE
) -> bool:  # away, std (q,); correlation (q, q)
    """Return whether parameters jointly differ significantly from those of no effect."""
    if not away.size:
        return True
    if not np.all(np.isfinite(std)) or np.any(std <= 0.0):
        return False
    scaled = away / std
    solved = solve_square(correlation, scaled)
    return bool(scaled @ solved.values >= policy.min_standard_errors**2 * away.size)


def plays_are_bearable(
    plays: float, bouc_wen: float, one_amplitude: bool, policy: ChoicePolicy = CHOICE
) -> bool:
    """Return whether the bank of plays is selected, given the held-out errors of both models."""
    return one_amplitude or plays <= policy.inner_loops * bouc_wen


def has_one_amplitude(
    voltage: FloatArray, turns: FloatArray, policy: ChoicePolicy = CHOICE
) -> bool:  # voltage, turns [V]
    """Return whether a voltage has one high and one low reversal level."""
    middle = 0.5 * (float(voltage.max()) + float(voltage.min()))
    levels = np.abs(turns - middle)
    return bool(levels.size and np.quantile(levels, 0.1) >= policy.one_level * levels.max())


# Samples to which a trial is fitted.
_BRIEF = 60_000

_Start = tuple[Candidate, dict[str, float]]
_Trial = tuple[Candidate, FitResult]


@dataclass(frozen=True)
class Trial:
    """A fitted model with its free-run errors before and after the cuts [m].

    `sure` states that the parameters of its last effect differ significantly from no effect;
    `views` are the whole records with the initial conditions of the errors.
    """

    fit: FitResult
    trained: float
    held_out: float
    records: tuple[HeldOutScore, ...]
    sure: bool
    views: tuple[FitData, ...] = ()

    def improves(self, before: Trial) -> bool:
        """Return whether the last effect is significant and improves the prediction."""
        trained = (before.trained, self.trained)
        return self.sure and predicts_better(trained, (before.held_out, self.held_out))

    def would_improve(self, before: Trial, now: Trial) -> bool:
        """Return whether what the last effect took away `before` is noticeable in the error `now`.

        A large error of another cause hides a small effect: the squares that it explains count
        for little then, and for much when that cause is in the model.
        """
        least = (1.0 - (1.0 - CHOICE.min_gain) ** 2) * now.trained**2
        return self.sure and before.trained**2 - self.trained**2 >= least

    @property
    def useful_cost(self) -> float:
        """Largest cost, on the targets of its fit, of a model that fits noticeably better."""
        return (1.0 - CHOICE.min_gain) ** 2 * self.fit.cost

    def promises(self, before: Trial) -> bool:
        """Return whether a trial on the data of the previous fit is worth converging."""
        less = self.held_out <= (1.0 - CHOICE.min_gain) * before.held_out
        return less or self.fit.cost <= before.useful_cost

    def values(self) -> dict[str, float]:
        """Return the fitted values as starting values of another fit."""
        free = {name: self.fit.values[name] for name in self.fit.model.free_names}
        return {**free, SAMPLING_OFFSET: self.fit.sampling_offset}


def _alike(one: Sequence[FitData], other: Sequence[FitData]) -> bool:
    return [t.begins for t in one] == [t.begins for t in other]


def _values(found: FitResult) -> dict[str, float]:
    return {**found.values, SAMPLING_OFFSET: found.sampling_offset}


def _attempted(
    seen: Sequence[FitData],
    evaluations: int,
    model: Model,
    values: Mapping[str, float],
    free: Sequence[str] | None = None,
    enough: float = inf,
) -> FitResult:
    """Fit a model, or some of its parameters, to cut records from known starts."""
    return fit(
        model,
        (),
        values,
        free=free,
        targets=seen,
        sampling_offset=True,
        max_evaluations=evaluations,
        tolerance=CHOICE.rough,
        enough=enough,
    )


def _one_of_each(tried: Sequence[_Trial]) -> list[_Trial]:
    """Return the best trial of every candidate."""
    best: dict[int, _Trial] = {}
    for each in sorted(tried, key=lambda each: each[1].cost):
        best.setdefault(id(each[0]), each)
    return list(best.values())


def simplest_first(tried: Sequence[_Trial]) -> list[_Trial]:
    """Return trials by cost; of those that fit alike, by the number of new parameters."""
    alike = min(found.cost for _, found in tried) / (1.0 - CHOICE.min_gain) ** 2

    def place(each: _Trial) -> tuple[bool, int, float]:
        worse = each[1].cost > alike
        return worse, 0 if worse else len(each[0].added), each[1].cost

    return sorted(tried, key=place)


def _left(fit: FitResult) -> float:
    """Return the median absolute residual of a fit [m].

    It allows comparisons, because each fit has its own weights.
    """
    return float(np.median(np.abs(np.concatenate(list(fit.residuals.values())))))


class ForwardSelection:
    """The records, cut in two parts, and fits of models to the first part."""

    def __init__(
        self, records: Sequence[Record], choices: RecordAssumptions, workers: int = 1
    ) -> None:
        self._records = records
        self._choices, self._workers = choices, workers
        self._cuts = [max(round(CHOICE.trained * len(record)), 2) for record in records]
        self._training = [r.section(0, c) for r, c in zip(records, self._cuts, strict=True)]
        self._plain, self._whole = (
            targets_of(each, folded=False, start=choices.start, zero=choices.zero)
            for each in (self._training, records)
        )
        self._voltage = max(float(np.max(np.abs(r.voltage))) for r in records)
        self._span = max(float(np.ptp(r.displacement)) for r in records)
        self.one_amplitude = has_one_amplitude(
            np.concatenate([record.voltage for record in records]),
            np.concatenate([_turns(record.voltage) for record in records]),
        )

    def memory(self, name: str) -> Trial:
        """Fit a named model without starting values."""
        return self._evaluated(self._searched(suited(named(name), self._records), count=2))

    def _searched(self, model: Model, **how: Any) -> FitResult:
        return output_error(
            model,
            self._training,
            folded=False,
            begins=self._choices.start,
            zero=self._choices.zero,
            workers=self._workers,
            **how,
        )

    def larger(self, before: Trial, effect: str) -> Trial | None:
        """Fit the previous model with one more effect, in the best of its variants."""
        model = before.fit.model
        if effect not in EFFECT_NAMES:
            return self._with_block(before, effect)
        plain = [each for each in described(effect) if not each.refines]
        ways = [d for d in plain if applicable(model, d) and self._shows(model, d)]
        if not ways:
            return None
        return self._fitted(
            before, [add_effect(model, d, self._voltage, self._span / 2) for d in ways]
        )

    def _shows(self, model: Model, effect: Effect) -> bool:
        """Return whether the records can distinguish the effect from the model's static curves."""
        if not (self.one_amplitude and _is_static(effect.block)):
            return True
        alternatives = {
            d.block.name for name in effect.mistaken_for for d in described(name) if d.block
        }
        return not any(_is_static(each) and each.name in alternatives for each in model.blocks)

    def _with_block(self, before: Trial, name: str) -> Trial:
        """Fit the previous model with a block whose frequency is searched globally."""
        block = named_block(name)
        model = before.fit.model.with_block(block)
        known, neutral = before.values(), {each.name: 0.0 for each in block.parameters}
        found = self._searched(model, start=known, count=3)
        trial = self._evaluated(found, neutral)
        if trial.trained <= before.trained:
            return trial
        # a richer model that fits worse is a local minimum: continue from the simpler model
        late = known.pop(SAMPLING_OFFSET)
        near = replace(found, values={**found.values, **known}, sampling_offset=late)
        again = self._polished(near, before.fit.targets, neutral)
        return min(trial, again, key=lambda each: each.trained)

    def _fitted(self, before: Trial, candidates: Sequence[Candidate]) -> Trial:
        """Fit briefly from every starting point of every candidate, and continue from the best."""
        seen, late = before.fit.targets, before.fit.sampling_offset
        brief = thinned(seen, _BRIEF, {})
        starts = [
            (each, {**each.values(before.fit.values, start), SAMPLING_OFFSET: late})
            for each in candidates
            for start in each.starts
        ]

        def tested(start: _Start, alone: bool) -> _Trial:
            free = start[0].added if alone else None
            found = _attempted(brief, FITS.first_evaluations, start[0].model, start[1], free)
            return start[0], found

        tried: list[_Trial] = []
        for alone in (True, False):
            with ThreadPoolExecutor(self._workers) as pool:
                tried = _one_of_each(list(pool.map(partial(tested, alone=alone), starts)))
            starts = [(each, _values(found)) for each, found in tried]
        best: Trial | None = None
        for candidate, found in simplest_first(tried):
            trial = self._continued(candidate, found, before)
            if trial.promises(before):
                trial = self._polished(trial.fit, seen, candidate.neutral)
            if trial.improves(before):
                return trial
            best = trial if best is None or trial.held_out < best.held_out else best
        assert best is not None
        return best

    def _continued(self, candidate: Candidate, found: FitResult, before: Trial) -> Trial:
        """Continue a trial until it converges, or promises too little.

        The errors are those with the initial conditions of the previous model.
        """
        again = _attempted(
            before.fit.targets,
            FITS.final_evaluations,
            candidate.model,
            _values(found),
            enough=before.useful_cost,
        )
        return self._scored(again, before.views, candidate.neutral)

    def _polished(
        self, found: FitResult, seen: Sequence[FitData], neutral: Mapping[str, float]
    ) -> Trial:
        """Continue the fit of a trial until it converges."""
        values = _values(found)
        # initial conditions may have absorbed a missing effect: also try the original ones
        views = [seen] if _alike(seen, self._plain) else [seen, self._plain]
        tried = [partial(_attempted, each, FITS.final_evaluations) for each in views]
        with ThreadPoolExecutor(self._workers) as pool:
            ends = list(pool.map(lambda attempt: attempt(found.model, values), tried))
        best = min(ends, key=_left)
        end = refined(
            found.model,
            best.targets,
            self._training,
            _values(best),
            choices=self._choices,
            max_evaluations=FITS.final_evaluations,
            workers=self._workers,
        )
        return self._evaluated(end, neutral)

    def _evaluated(self, found: FitResult, neutral: Mapping[str, float] | None = None) -> Trial:
        """Return a fit with its errors on the whole records, before and after the cuts.

        The records begin as in the fit: a start belongs to the parameters fitted with it, and one
        that another search finds for them may predict far worse. `neutral` are the parameter
        values for which the last effect is inactive.
        """
        fitted = {target.name: target for target in found.targets}
        views = [with_start_of(view, fitted[view.name]) for view in self._whole]
        return self._scored(found, views, neutral)

    def _scored(
        self, found: FitResult, views: Sequence[FitData], neutral: Mapping[str, float] | None
    ) -> Trial:
        """Return a fit with its errors on views of the whole records."""
        parts: tuple[list[FloatArray], list[FloatArray]] = ([], [])
        rows = []
        runs = predictions(found.model, found.values, views, found.sampling_offset)
        for run, record, cut in zip(runs, self._records, self._cuts, strict=True):
            error = run.valid_error
            before = max(cut - record.warm_up_samples, 0)
            parts[0].append(error[:before])
            parts[1].append(error[before:])
            rows.append(_held_out(run.target, error, before))
        trained, held_out = (float(np.sqrt(np.mean(np.concatenate(p) ** 2))) for p in parts)
        sure = _is_significant(found, neutral or {})
        return Trial(found, trained, held_out, tuple(rows), sure, tuple(views))


def _is_significant(found: FitResult, neutral: Mapping[str, float]) -> bool:
    """Return whether the covariance of the fit excludes the values of `neutral` jointly."""
    places = [found.free.index(name) for name in neutral if name in found.free]
    away = np.array([found.values[found.free[k]] - neutral[found.free[k]] for k in places])
    together = np.ix_(places, places)
    return differs_from_none(
        away, found.covariance.std[places], found.covariance.correlation[together]
    )


def _is_static(block: Block | None) -> bool:
    return block is not None and block.between is InterSample.INSTANT


def _turns(voltage: FloatArray) -> FloatArray:
    """Return the reversal levels of the voltage [V]."""
    moving = voltage[np.append(True, np.diff(voltage) != 0.0)]
    way = np.sign(np.diff(moving))
    return np.asarray(moving[1:-1][way[1:] != way[:-1]])


def _held_out(view: FitData, error: FloatArray, first: int) -> HeldOutScore:
    rms = float(np.sqrt(np.mean(error[first:] ** 2)))
    spread = float(np.std(view.measured[first:]))
    return HeldOutScore(view.name, rms, 100 * rms / spread if spread > 0 else float('nan'))


Progress = Callable[[float, str], None]


@dataclass(frozen=True)
class TriedModel:
    """One tested model.

    Attributes
    ----------
    memory : str
        Name of the initial model with its hysteresis.
    name : str
        Name of the added effect; name of the model for the first one.
    parameters : int
        Number of free parameters.
    trained_rms, held_out_rms : float
        Free-run error on the fitted and on the held-out part of the records [m].
    kept : bool
        Whether the model was accepted.
    """

    memory: str
    name: str
    parameters: int
    trained_rms: float
    held_out_rms: float
    kept: bool


@dataclass(frozen=True)
class Choice:
    """Selected model, starting values of a fit, and the tested models.

    Attributes
    ----------
    model : Model
        The chain, scaled to the records.
    start : dict of str to float
        Values fitted to the first part of the records, and their ``sampling_offset``.
    steps : tuple of TriedModel
        All tested models, in order.
    held_out : tuple of HeldOutScore
        Held-out error of the selected model on the rest of the records.
    """

    model: Model
    start: dict[str, float]
    steps: tuple[TriedModel, ...]
    held_out: tuple[HeldOutScore, ...] = ()


def choose_model(
    records: Sequence[Record],
    progress: Progress = lambda fraction, words: None,
    choices: RecordAssumptions | None = None,
    workers: int = 1,
) -> Choice:
    """Select a model for records of an unknown actuator.

    Two models are built: one with an off-center Bouc-Wen hysteresis, Fujii 2018 (1), and one with
    a bank of plays. Each further effect of `LADDER` is fitted to the first 70 % of every record
    jointly with all others. It is kept if it reduces the free-run error there or on the rest of
    the records by 2 %, does not increase the latter, and has parameters that the records
    determine. A rejected effect is tried once more with the effects accepted after it, if what
    it explained is noticeable in the error that these leave. The plays are selected unless the
    other model is clearly better on the rest, because their inner loops close, as those of
    ceramics do.

    Records of one amplitude contain no inner loop, and they determine only one static curve, but
    not whether it lies before or after the hysteresis. In this case the plays are selected
    regardless of the errors, and a second curve is not tried.

    Parameters
    ----------
    records : sequence of Record
        Measured records.
    progress : callable
        Called with ``(fraction, words)``.
    choices : RecordAssumptions, optional
        Known initial conditions and zero offsets.
    workers : int
        Threads over records and trials; the result does not depend on it.

    Raises
    ------
    IdentificationError
        If the records are unsuitable for identification.
    """
    require_usable(records)
    selection = ForwardSelection(records, choices or RecordAssumptions(), workers)
    steps: list[TriedModel] = []
    ends: list[Trial] = []
    for k, memory in enumerate(MEMORIES):

        def report(name: str, share: float, k: int = k) -> None:
            progress((k + share) / len(MEMORIES), name)

        ends.append(climbed(selection, memory, steps, report))
    plain, plays = ends
    bearable = plays_are_bearable(plays.held_out, plain.held_out, selection.one_amplitude)
    chosen = plays if bearable else plain
    return Choice(chosen.fit.model, chosen.values(), tuple(steps), chosen.records)


def climbed(
    selection: ForwardSelection,
    memory: str,
    steps: list[TriedModel],
    report: Callable[[str, float], None],
) -> Trial:
    """Return a model with the accepted effects, and append the tested ones to `steps`."""

    def test(name: str, before: Trial | None) -> Trial | None:
        report(name, len(steps) % (1 + len(LADDER)) / (1 + len(LADDER)))
        tried = selection.memory(name) if before is None else selection.larger(before, name)
        if tried is None:
            return None
        kept = before is None or tried.improves(before)
        row = (memory, name, len(tried.fit.free), tried.trained, tried.held_out, kept)
        steps.append(TriedModel(*row))
        if not kept and before is not None:
            rejected[name] = before, tried
        return tried if kept else None

    rejected: dict[str, tuple[Trial, Trial]] = {}
    best = test(memory, None)
    assert best is not None
    for name in LADDER:
        best = test(name, best) or best
    for name, (before, tried) in list(rejected.items()):
        if before is not best and tried.would_improve(before, best):
            best = test(name, best) or best
    return best
