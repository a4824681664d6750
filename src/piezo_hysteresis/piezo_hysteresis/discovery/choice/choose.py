"""Automatic model selection: effects are added one at a time and kept if held-out data agree.

The search of discovery has another purpose: it names effects and omits every effect that is not
certain, whereas a model for prediction keeps it. Fitted to the first 70 % of the measured 150 V
record, discovery names no effect and leaves 0.53 % of the rest, this selection 0.40 %. On
increasing amplitudes of a stack that was fitted at one, they leave 0.44 and 0.20 µm
(``studies/study.py choice``). Both share the effects, starting values, rules and threshold
descriptions.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from piezo_hysteresis.discovery.choice.choice_rules import HeldOutScore, plays_are_bearable
from piezo_hysteresis.discovery.choice.ladder import Ladder, Rung
from piezo_hysteresis.identification.checks import require_usable
from piezo_hysteresis.identification.initial_conditions.revision import Choices
from piezo_hysteresis.models import Model
from piezo_hysteresis.models.named import LADDER, MEMORIES
from piezo_hysteresis.records import Record

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
    choices: Choices | None = None,
    workers: int = 1,
) -> Choice:
    """Select a model for records of an unknown actuator.

    Two models are built: one with an off-center Bouc-Wen hysteresis, Fujii 2018 (1), and one with
    a bank of plays. Each further effect of `LADDER` is fitted to the first 70 % of every record
    jointly with all others. It is kept if it reduces the free-run error there or on the rest of
    the records by 2 %, does not increase the latter, and has parameters that the records
    determine. An effect that only increased the error on the rest is tried once more with the
    effects accepted after it. The plays are selected unless the other model is clearly better on
    the rest, because their inner loops close, as those of ceramics do.

    Records of one amplitude contain no inner loop, and they determine only one static curve, but
    not whether it lies before or after the hysteresis. In this case the plays are selected
    regardless of the errors, and a second curve is not tried.

    Parameters
    ----------
    records : sequence of Record
        Measured records.
    progress : callable
        Called with ``(fraction, words)``.
    choices : Choices, optional
        Known initial conditions and zero offsets.
    workers : int
        Threads over records and trials; the result does not depend on it.

    Raises
    ------
    IdentificationError
        If the records are unsuitable for identification.
    """
    require_usable(records)
    ladder = Ladder(records, choices or Choices(), workers)
    steps: list[TriedModel] = []
    ends: list[Rung] = []
    for k, memory in enumerate(MEMORIES):

        def report(name: str, share: float, k: int = k) -> None:
            progress((k + share) / len(MEMORIES), name)

        ends.append(climbed(ladder, memory, steps, report))
    plain, plays = ends
    bearable = plays_are_bearable(plays.held_out, plain.held_out, ladder.one_amplitude)
    chosen = plays if bearable else plain
    return Choice(chosen.fit.model, chosen.values(), tuple(steps), chosen.records)


def climbed(
    ladder: Ladder, memory: str, steps: list[TriedModel], report: Callable[[str, float], None]
) -> Rung:
    """Return a model with the accepted effects, and append the tested ones to `steps`."""

    def test(name: str, before: Rung | None) -> Rung | None:
        report(name, len(steps) % (1 + len(LADDER)) / (1 + len(LADDER)))
        tried = ladder.memory(name) if before is None else ladder.larger(before, name)
        if tried is None:
            return None
        kept = before is None or tried.improves(before)
        row = (memory, name, len(tried.fit.free), tried.trained, tried.held_out, kept)
        steps.append(TriedModel(*row))
        if not kept and before is not None and tried.fits_better(before):
            rejected[name] = before
        return tried if kept else None

    rejected: dict[str, Rung] = {}
    best = test(memory, None)
    assert best is not None
    for name in LADDER:
        best = test(name, best) or best
    for name, before in list(rejected.items()):
        if before is not best:
            best = test(name, best) or best
    return best
