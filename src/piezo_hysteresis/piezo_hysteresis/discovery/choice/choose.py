"""A good model without asking: effects are added one by one and kept where held-out data agree.

Why the search of discovery does not choose it: that one asks which effect can be named, and
leaves out what it cannot be sure of; a model that shall predict keeps it. Given the first 70 % of
the measured 150 V record, discovery names nothing and misses 0.53 % of the rest, this choice
0.40 %; of growing amplitudes of a stack that was fitted at one, 0.44 and 0.20 µm
(``studies/choice.py``). What they share are effects, starts, rules and the words of their numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from piezo_hysteresis.discovery.choice.ladder import Ladder, Rung
from piezo_hysteresis.discovery.choice.rules import plays_are_bearable
from piezo_hysteresis.discovery.choice.score import HeldOutScore
from piezo_hysteresis.identification.checks import require_usable
from piezo_hysteresis.identification.initial_conditions.revision import Choices
from piezo_hysteresis.models import Model
from piezo_hysteresis.models.named import LADDER, MEMORIES
from piezo_hysteresis.records import Record

Progress = Callable[[float, str], None]


@dataclass(frozen=True)
class TriedModel:
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
class Choice:
    """The chosen model, where a fit of it starts, and how it was found.

    Attributes
    ----------
    model : Model
        The chain, scaled to the records.
    start : dict of str to float
        Values fitted to the first part of the records, and their ``sampling_offset``.
    steps : tuple of TriedModel
        Every model that was tried, in order.
    held_out : tuple of HeldOutScore
        What the chosen model, fitted to the first part of the records, leaves of the rest.
    """

    model: Model
    start: dict[str, float]
    steps: tuple[TriedModel, ...]
    held_out: tuple[HeldOutScore, ...] = ()


def choose_model(
    records: Sequence[Record],
    progress: Progress = lambda fraction, words: None,
    choices: Choices | None = None,
) -> Choice:
    """Choose a chain for records of which nothing is known.

    Two chains are built: one on an off-centre Bouc-Wen hysteresis, Fujii 2018 (1), one on a bank
    of plays. Each further effect of `LADDER` is fitted to the first 70 % of every record together
    with all others. It stays where it lowers the free-run error there, or on the rest of the
    records, by 2 %, does not raise the latter, and its parameters are determined by the records.
    The plays are chosen unless the other chain is clearly better on the rest: their inner loops
    close, as those of ceramics do.

    Records of one amplitude show no inner loop, and one static curve only, not whether it lies
    before or behind the hysteresis. There the plays are chosen whatever the errors say, and a
    second curve is not tried.

    Parameters
    ----------
    records : sequence of Record
        What was measured.
    progress : callable
        Called with ``(fraction, words)``.
    choices : Choices, optional
        What is known of starts and zeros.

    Raises
    ------
    IdentificationError
        If the records cannot identify anything.
    """
    require_usable(records)
    ladder = Ladder(records, choices or Choices())
    steps: list[TriedModel] = []
    ends: list[Rung] = []
    for k, memory in enumerate(MEMORIES):
        best: Rung | None = None
        for j, name in enumerate((memory, *LADDER)):
            progress((k + j / (1 + len(LADDER))) / len(MEMORIES), name)
            tried = ladder.memory(name) if best is None else ladder.larger(best, name)
            if tried is None:
                continue
            kept = best is None or tried.improves(best)
            row = (memory, name, len(tried.fit.free), tried.trained, tried.held_out, kept)
            steps.append(TriedModel(*row))
            best = tried if kept else best
        if best is not None:
            ends.append(best)
    plain, plays = ends
    bearable = plays_are_bearable(plays.held_out, plain.held_out, ladder.one_amplitude)
    chosen = plays if bearable else plain
    return Choice(chosen.fit.model, chosen.values(), tuple(steps), chosen.records)
