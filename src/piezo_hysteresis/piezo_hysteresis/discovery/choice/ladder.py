"""A good model without asking: effects are added one by one and kept where held-out data agree."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from math import ceil

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks import named_block
from piezo_hysteresis.blocks.base import Between, Block
from piezo_hysteresis.blocks.effect import Effect
from piezo_hysteresis.identification.checks import require_usable
from piezo_hysteresis.identification.circumstances import Choices
from piezo_hysteresis.identification.errors import views_of
from piezo_hysteresis.identification.fit import fit
from piezo_hysteresis.identification.objective import SAMPLING_OFFSET
from piezo_hysteresis.identification.opening import misfit
from piezo_hysteresis.identification.output_error import output_error, refined, suited
from piezo_hysteresis.identification.result import FitResult
from piezo_hysteresis.identification.targets import Target, targets_of
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

Progress = Callable[[float, str], None]

TRAINED = 0.7  # share of each record that is fitted; the rest decides
_GAIN = 0.98  # an effect must lower the error below this share of what it was
# Evaluations of each start, and the share of them that goes on.
_ROUNDS = ((4, 1 / 2), (10, 1.0))
_POLISH = 80  # evaluations of the best of them
_ROUGH = 1e-4  # relative change at which a trial ends
# Inner loops of plays close, as those of actuators do and those of Bouc-Wen do not. Records of one
# amplitude do not show it, so plays may leave so much more.
_INNER_LOOPS = 1.25
_TOLERATED = 1.01  # and may never raise the held-out error above this share
# Share of the largest level to which the voltage turns back at least where it has one amplitude.
_ONE_LEVEL = 0.8
_SURE = 3.0  # standard deviations by which its parameters together must differ from no effect


@dataclass(frozen=True)
class Step:
    """One model that was tried.

    Attributes
    ----------
    memory : str
        Name of the model that it began with.
    name : str
        What was added; the name of the model for the first one.
    parameters : int
        Number of free parameters.
    trained_rms, held_out_rms : float
        Free-run error on the fitted and on the held-out part of the records [m].
    kept : bool
        Whether the next model was built on it.
    """

    memory: str
    name: str
    parameters: int
    trained_rms: float
    held_out_rms: float
    kept: bool


@dataclass(frozen=True)
class HeldOut:
    """What the chosen model leaves of the rest of a record, which it was not fitted to.

    Attributes
    ----------
    record : str
        Name.
    free_run_rms : float
        Free-run error behind the cut [m].
    nrmse_percent : float
        100 times that over the standard deviation of the displacement there.
    """

    record: str
    free_run_rms: float
    nrmse_percent: float


@dataclass(frozen=True)
class Choice:
    """The chosen model, where a fit of it starts, and how it was found.

    Attributes
    ----------
    model : Model
        The chain, scaled to the records.
    start : dict of str to float
        Values fitted to the first part of the records, and their ``sampling_offset``.
    steps : tuple of Step
        Every model that was tried, in order.
    held_out : tuple of HeldOut
        What the chosen model, fitted to the first part of the records, leaves of the rest.
    """

    model: Model
    start: dict[str, float]
    steps: tuple[Step, ...]
    held_out: tuple[HeldOut, ...] = ()


def choose_model(
    records: Sequence[Record],
    progress: Progress = lambda fraction, words: None,
    choices: Choices | None = None,
) -> Choice:
    """Choose a chain for records of which nothing is known.

    Two chains are built: one on an off-centre Bouc-Wen hysteresis, Fujii 2018 (1), one on a bank
    of plays. Each further effect of `LADDER` is fitted to the first 70 % of every record together
    with all others. It stays where it lowers the free-run error there, or on the rest of the
    records, by 2 %, does not raise the latter, and its parameters are told by the records. The
    plays are chosen unless the other chain is clearly better on the rest: their inner loops close,
    as those of ceramics do.

    Records of one amplitude show no inner loop, and one static curve only, not whether it lies
    before or behind the hysteresis. There the plays are chosen whatever the errors say, and a
    second curve is not tried.

    Parameters
    ----------
    records : sequence of Record
        What was measured.
    progress : callable
        Told ``(fraction, words)``.
    choices : Choices, optional
        What is known of starts and zeros.

    Raises
    ------
    IdentificationError
        If the records cannot identify anything.
    """
    require_usable(records)
    ladder = _Ladder(records, choices or Choices())
    steps: list[Step] = []
    ends: list[_Rung] = []
    for k, memory in enumerate(MEMORIES):
        best: _Rung | None = None
        for j, name in enumerate((memory, *LADDER)):
            progress((k + j / (1 + len(LADDER))) / len(MEMORIES), name)
            tried = ladder.memory(name) if best is None else ladder.larger(best, name)
            if tried is None:
                continue
            kept = best is None or (tried.told and tried.improves(best))
            row = (memory, name, len(tried.fit.free), tried.trained, tried.held_out, kept)
            steps.append(Step(*row))
            best = tried if kept else best
        if best is not None:
            ends.append(best)
    plain, plays = ends
    bearable = ladder.one_amplitude or plays.held_out <= _INNER_LOOPS * plain.held_out
    chosen = plays if bearable else plain
    return Choice(chosen.fit.model, chosen.values(), tuple(steps), chosen.records)


@dataclass(frozen=True)
class _Rung:
    """A fitted model and its free-run errors before and behind the cuts [m]."""

    fit: FitResult
    trained: float
    held_out: float
    records: tuple[HeldOut, ...]
    told: bool

    def improves(self, before: _Rung) -> bool:
        lower = self.held_out <= _GAIN * before.held_out or self.trained <= _GAIN * before.trained
        return lower and self.held_out <= _TOLERATED * before.held_out

    def values(self) -> dict[str, float]:
        free = {name: self.fit.values[name] for name in self.fit.model.free_names}
        return {**free, SAMPLING_OFFSET: self.fit.sampling_offset}


def _alike(one: Sequence[Target], other: Sequence[Target]) -> bool:
    return [t.begins for t in one] == [t.begins for t in other]


def _late(found: FitResult) -> dict[str, float]:
    return {SAMPLING_OFFSET: found.sampling_offset}


def _attempted(
    seen: Sequence[Target], evaluations: int, start: tuple[Model, dict[str, float]]
) -> FitResult:
    return fit(
        start[0],
        (),
        start[1],
        targets=seen,
        sampling_offset=True,
        max_evaluations=evaluations,
        tolerance=_ROUGH,
    )


def _one_of_each(tried: Sequence[FitResult]) -> list[FitResult]:
    """Return the best trial of every model, the best first."""
    best: dict[int, FitResult] = {}
    for each in sorted(tried, key=lambda each: each.cost):
        best.setdefault(id(each.model), each)
    return list(best.values())


def _left(fit: FitResult) -> float:
    """Return the median size of what a fit leaves [m]: its weights are its own."""
    return float(np.median(np.abs(np.concatenate(list(fit.residuals.values())))))


class _Ladder:
    """The records, cut in two, and how models are fitted to the first part."""

    def __init__(self, records: Sequence[Record], choices: Choices) -> None:
        self._records = records
        self._choices = choices
        self._cuts = [max(round(TRAINED * len(record)), 2) for record in records]
        self._training = [r.section(0, c) for r, c in zip(records, self._cuts, strict=True)]
        self._plain = targets_of(
            self._training, folded=False, start=choices.start, zero=choices.zero
        )
        self._voltage = max(float(np.max(np.abs(r.voltage))) for r in records)
        self._span = max(float(np.ptp(r.displacement)) for r in records)
        self.one_amplitude = _has_one_amplitude(records)

    def memory(self, name: str) -> _Rung:
        """Fit a named model from the data alone."""
        chain = suited(named(name), self._records)
        return self._judged(
            output_error(
                chain,
                self._training,
                folded=False,
                begins=self._choices.start,
                zero=self._choices.zero,
                count=2,
            )
        )

    def larger(self, before: _Rung, effect: str) -> _Rung | None:
        """Fit the model before with one effect more, in the best of its ways."""
        model = before.fit.model
        if effect not in EFFECT_NAMES:
            return self._with_block(before, effect)
        ways = [d for d in described(effect) if applicable(model, d) and self._shows(model, d)]
        if not ways:
            return None
        return self._fitted(
            before, [add_effect(model, d, self._voltage, self._span / 2) for d in ways]
        )

    def _shows(self, model: Model, effect: Effect) -> bool:
        """Tell whether the records could tell the effect from the curves that the model has."""
        if not (self.one_amplitude and _is_static(effect.block)):
            return True
        rivals = {d.block.name for name in effect.mistaken_for for d in described(name) if d.block}
        return not any(_is_static(each) and each.name in rivals for each in model.blocks)

    def _with_block(self, before: _Rung, name: str) -> _Rung:
        """Fit the model before with a block whose place, as a frequency, is sought everywhere."""
        block = named_block(name)
        model = before.fit.model.with_block(block)
        known = before.values()
        return self._judged(
            output_error(
                model,
                self._training,
                start=known,
                folded=False,
                begins=self._choices.start,
                zero=self._choices.zero,
                count=3,
            ),
            {parameter.name: 0.0 for parameter in block.parameters},
        )

    def _fitted(self, before: _Rung, candidates: Sequence[Candidate]) -> _Rung:
        """Fit from every start of every candidate for a little, and from the best to the end."""
        seen, late = before.fit.targets, before.fit.sampling_offset
        starts = [
            (each.model, {**each.values(before.fit.values, start), SAMPLING_OFFSET: late})
            for each in candidates
            for start in each.starts
        ]
        tried: list[FitResult] = []
        for evaluations, share in _ROUNDS:
            with ThreadPoolExecutor(os.cpu_count()) as pool:
                tried = list(pool.map(partial(_attempted, seen, evaluations), starts))
            tried = sorted(tried, key=lambda each: each.cost)[: ceil(share * len(tried))]
            starts = [(each.model, {**each.values, **_late(each)}) for each in tried]
        best: _Rung | None = None
        for each in _one_of_each(tried):
            neutral = next(c.neutral for c in candidates if c.model is each.model)
            rung = self._polished(each, seen, neutral)
            if rung.told and rung.improves(before):
                return rung
            best = rung if best is None or rung.held_out < best.held_out else best
        assert best is not None
        return best

    def _polished(
        self, found: FitResult, seen: Sequence[Target], neutral: Mapping[str, float]
    ) -> _Rung:
        """Fit from a trial to the end."""
        again = {**found.values, **_late(found)}
        # what was missing may have passed for a start: the plain ones get another chance
        views = [seen] if _alike(seen, self._plain) else [seen, self._plain]

        def polished(targets: Sequence[Target]) -> FitResult:
            return refined(
                found.model,
                targets,
                self._training,
                again,
                choices=self._choices,
                max_evaluations=_POLISH,
            )

        with ThreadPoolExecutor(os.cpu_count()) as pool:
            ends = list(pool.map(polished, views))
        return self._judged(min(ends, key=_left), neutral)

    def _judged(self, found: FitResult, neutral: Mapping[str, float] | None = None) -> _Rung:
        """Return a fit with its errors over the whole records, before and behind the cuts.

        `neutral` are the values with which the newest effect does nothing.
        """
        packed, late = found.model.pack(found.values), found.sampling_offset
        views = views_of(found.model, found.values, self._records, late, self._choices)
        parts: tuple[list[FloatArray], list[FloatArray]] = ([], [])
        rows = []
        for view, record, cut in zip(views, self._records, self._cuts, strict=True):
            with np.errstate(over='ignore', invalid='ignore'):
                error = misfit(found.model, packed, view, late)
            before = max(cut - record.warm_up_samples, 0)
            parts[0].append(error[:before])
            parts[1].append(error[before:])
            rows.append(_held_out(view, error, before))
        trained, held_out = (float(np.sqrt(np.mean(np.concatenate(p) ** 2))) for p in parts)
        return _Rung(found, trained, held_out, tuple(rows), _is_told(found, neutral or {}))


def _is_told(found: FitResult, neutral: Mapping[str, float]) -> bool:
    """Tell whether the fit's own deviations exclude the values of `neutral` together."""
    places = [found.free.index(name) for name in neutral if name in found.free]
    away = np.array([found.values[found.free[k]] - neutral[found.free[k]] for k in places])
    std = found.covariance.std[places]
    if not places:
        return True
    if not np.all(np.isfinite(std)) or np.any(std <= 0.0):
        return False
    scaled = away / std
    solved = solve_square(found.covariance.correlation[np.ix_(places, places)], scaled)
    return bool(scaled @ solved.values >= _SURE**2 * len(places))


def _is_static(block: Block | None) -> bool:
    return block is not None and block.between is Between.INSTANT


def _has_one_amplitude(records: Sequence[Record]) -> bool:
    """Tell whether the voltage of all records turns back at one high and one low level."""
    voltage = np.concatenate([record.voltage for record in records])
    middle = 0.5 * (float(voltage.max()) + float(voltage.min()))
    levels = np.abs(np.concatenate([_turns(record.voltage) for record in records]) - middle)
    return bool(levels.size and np.quantile(levels, 0.1) >= _ONE_LEVEL * levels.max())


def _turns(voltage: FloatArray) -> FloatArray:
    """Return where the voltage turns back [V]."""
    moving = voltage[np.append(True, np.diff(voltage) != 0.0)]
    way = np.sign(np.diff(moving))
    return np.asarray(moving[1:-1][way[1:] != way[:-1]])


def _held_out(view: Target, error: FloatArray, first: int) -> HeldOut:
    rms = float(np.sqrt(np.mean(error[first:] ** 2)))
    spread = float(np.std(view.measured[first:]))
    return HeldOut(view.name, rms, 100 * rms / spread if spread > 0 else float('nan'))
