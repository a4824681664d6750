"""The whole discovery: check, split, floor, baselines, locate, compete, name, prove, advise."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from piezo_hysteresis.discovery.advise import advise
from piezo_hysteresis.discovery.annotate import annotated
from piezo_hysteresis.discovery.arena import Arena
from piezo_hysteresis.discovery.baseline import Baselines, fitted_baselines
from piezo_hysteresis.discovery.check import Check, check
from piezo_hysteresis.discovery.compete import Contest
from piezo_hysteresis.discovery.consistency import explained_together
from piezo_hysteresis.discovery.dataset import Dataset, split
from piezo_hysteresis.discovery.describe import describe
from piezo_hysteresis.discovery.held import HeldArena, find_held
from piezo_hysteresis.discovery.locate import places
from piezo_hysteresis.discovery.naming import named_effects, summary_of, suspects
from piezo_hysteresis.discovery.prove import Proof, ProofRow, over_frequency, prove
from piezo_hysteresis.discovery.search import NEAR, Progress, search
from piezo_hysteresis.discovery.settle import Step
from piezo_hysteresis.discovery.trial import Trial, on_views
from piezo_hysteresis.discovery.verdict import HeldOut, Unexplained, Verdict
from piezo_hysteresis.identification.circumstances import Choices
from piezo_hysteresis.identification.discrepancy import discrepancy_words
from piezo_hysteresis.identification.targets import Target
from piezo_hysteresis.models import Model, ModelFile
from piezo_hysteresis.records import Record

# Effects that explain less than this of the excess, with more left than NEAR, name nothing.
MOSTLY = 0.9


@dataclass(frozen=True)
class Discovery:
    """Everything that was found out.

    Attributes
    ----------
    verdict : Verdict
        As in ``verdict.json``.
    data : Dataset
        The records, split.
    floor : float
        Noise rms [m].
    baselines : Baselines
        The model before.
    steps : tuple of Step
        Accepted effects in the order in which they were found.
    final : Trial
        The model with all of them, fitted jointly.
    proof : Proof
        Before and after on held-out records.
    check : Check
        What the data can tell.
    given : ModelFile or None
        The file that the baseline came from.
    """

    verdict: Verdict
    data: Dataset
    floor: float
    baselines: Baselines
    steps: tuple[Step, ...]
    final: Trial
    proof: Proof
    check: Check
    given: ModelFile | None = None


def discover(
    records: Sequence[Record],
    baseline: Model | ModelFile,
    *,
    name: str = '',
    seed: int = 0,
    workers: int = 1,
    choices: Choices | None = None,
    progress: Progress = lambda fraction, words: None,
) -> Discovery:
    """Find what `baseline` misses in `records`.

    Parameters
    ----------
    records : sequence of Record
        Of one actuator at one rate.
    baseline : Model or ModelFile
        The model that lacks something; a file also gives its nominal values.
    name : str
        What to call the baseline.
    seed : int
        Of every random choice: the same seed gives the same verdict.
    workers : int
        Threads; the verdict does not depend on it.
    choices : Choices, optional
        What is known of how the records begin and where their zeros lie.
    progress : callable
        Told ``(fraction, words)``.

    Raises
    ------
    IdentificationError
        If nothing can be said from the records; the message says what to record.
    """
    began = time.monotonic()
    choices = choices or Choices()
    records = annotated(records)
    found = check(records)
    data = split(records, choices.start)
    progress(0.02, 'checked, split and noise measured')
    arena: Arena
    if isinstance(baseline, ModelFile) and baseline.discrepancy is not None:
        # What the user knows is a prior: a free refit would hide the effect in wrong values.
        arena, steps, final, last = found_held = find_held(
            data, baseline, choices, seed, workers, progress
        )
        nominal = on_views(found_held[0].base, arena.views)
        base = Baselines(nominal, None, nominal)
    else:
        base, data = fitted_baselines(data, baseline, choices)
        progress(0.12, 'baselines fitted')
        hints = [trial.values for trial in (base.slow,) if trial is not None]
        arena, steps, final, last = search(Arena(data, seed, workers, hints), base.joint, progress)
    progress(0.95, 'proving on held-out records')
    proof = prove(arena.data, base.joint, final)
    if steps and not proof.after_in_floors <= proof.before_in_floors:
        # Nothing that is worse on records it has not seen is handed out.
        steps, final = [], base.joint
        proof = prove(arena.data, base.joint, final)
    seen = arena.data
    discovery = Discovery(
        _placeholder(),
        seen,
        seen.noise.rms,
        base,
        tuple(steps),
        final,
        proof,
        found,
        baseline if isinstance(baseline, ModelFile) else None,
    )
    verdict = _verdict(discovery, arena, last, name or base.joint.model.name, seed)
    return replace(discovery, verdict=replace(verdict, seconds=time.monotonic() - began))


def _placeholder() -> Verdict:
    return Verdict(
        '', 0, 0.0, HeldOut(0, 0, 0, 0), (), 'none', Unexplained(False, ''), (), (), {}, 0.0
    )


def _verdict(
    found: Discovery, arena: Arena, last: Contest | None, name: str, seed: int
) -> Verdict:
    data, floor, proof = found.data, found.floor, found.proof
    left, description, proven = (
        _left_held(found, arena) if isinstance(arena, HeldArena) else _left_free(found, arena)
    )
    word = _word(bool(found.steps), left, proven)
    effects = named_effects(found.steps, found.baselines.joint, found.final, arena)
    doubts = suspects(found.steps, last) if word == 'unknown' else ()
    verdict = Verdict(
        baseline=name,
        seed=seed,
        noise_floor_rms_m=floor,
        held_out=HeldOut(proof.before, proof.after, proof.before_in_floors, proof.after_in_floors),
        effects=effects if word == 'named' else (),
        verdict=word,
        unexplained=Unexplained(left, description),
        where=tuple(
            {
                'record': p.record,
                'frequency_hz': p.frequency,
                'harmonic': p.harmonic,
                'rms_m': p.rms,
            }
            for p in places(data, data.training, found.baselines.joint.errors)[:20]
        ),
        next_experiments=tuple(advise(found.check, found.steps, left, description)),
        records={
            'training': [v.name for v in data.training],
            'held_out': [v.name for v in data.held_out],
        },
        seconds=0.0,
        suspects=doubts,
        check=tuple(found.check.sentences()),
        proof=tuple(_told(row, floor) for row in proof.rows),
        over_frequency=tuple(
            {**_told(row, floor), 'held_out': row.held_out}
            for row in over_frequency(data, found.baselines.joint, found.final, proof)
        ),
        baseline_gaps_rms_m=_gaps(found.baselines),
        free_run_stable=proof.stable,
        sampling_offset_s=found.final.sampling_offset,
        starts={v.name: _circumstances(v) for v in (*data.held_out, *data.training)},
    )
    return replace(verdict, summary=summary_of(verdict))


def _left_free(found: Discovery, arena: Arena) -> tuple[bool, str, bool]:
    """Return whether something is left, what it looks like, and whether the effects are proven."""
    data, floor, proof = found.data, found.floor, found.proof
    views, final, open_values = data.training, found.final, ''
    if not arena.lacks_something(final):
        # What training does not show can neither be named nor passed over.
        views, final = data.held_out, on_views(final, data.held_out)
        if arena.lacks_something(final):
            open_values = explained_together(arena, found.final)
    left = arena.lacks_something(final) and not open_values
    # An effect that does not prove itself on held-out records is not the one.
    proven = _explained(found.baselines.joint.floors, found.final.floors) and _explained(
        proof.before_in_floors, proof.after_in_floors
    )
    description = describe(data, views, final.errors, floor) if left else open_values
    return left, description, proven


def _left_held(found: Discovery, arena: HeldArena) -> tuple[bool, str, bool]:
    """Return the same against what the baseline is known to miss; its effects are proven."""
    data, final = found.data, found.final
    if arena.has_news(final):
        return True, describe(data, data.training, final.errors, found.floor), True
    if arena.has_news_held_out(final):
        errors = on_views(final, data.held_out).errors
        return True, describe(data, data.held_out, errors, found.floor), True
    return False, discrepancy_words(arena.known), True


def _circumstances(view: Target) -> dict[str, Any]:
    """Return what is true of one record only."""
    return {
        'start': str(view.begins),
        'own_zero': view.own_zero,
        'noise_rms_m': view.noise,
        'lost_samples': view.lost,
    }


def _told(row: ProofRow, floor: float) -> dict[str, Any]:
    return {
        'record': row.record,
        'frequency_hz': row.frequency,
        'amplitude_v': row.amplitude,
        'before_in_floors': row.before / floor,
        'after_in_floors': row.after / floor,
    }


def _explained(before: float, after: float) -> bool:
    """Tell whether a gap is gone or, in mean square above the floor, nearly so; in floors."""
    return after <= NEAR or before**2 - after**2 >= MOSTLY * (before**2 - 1.0)


def _word(any_effect: bool, left: bool, proven: bool) -> str:
    if not any_effect:
        return 'unknown' if left else 'none'
    return 'named' if proven else 'unknown'


def _gaps(base: Baselines) -> dict[str, float]:
    gaps = {'joint_fit': base.joint.rms}
    if base.slow is not None:
        gaps['low_frequency_fit'] = base.slow.rms
    if base.nominal is not None:
        gaps['nominal'] = base.nominal.rms
    return gaps
