"""Names, probabilities and evidence of the accepted effects."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import TYPE_CHECKING

from piezo_hysteresis.blocks.base import InverseRole
from piezo_hysteresis.common.wording import counted
from piezo_hysteresis.discovery.detection.bends import LARGEST_CLASS, Similar
from piezo_hysteresis.discovery.detection.statements import in_prefixes
from piezo_hysteresis.discovery.selection.candidate_fit import Added, CandidateFit
from piezo_hysteresis.discovery.selection.policy import POLICY
from piezo_hysteresis.discovery.selection.rounds import SelectionRound
from piezo_hysteresis.discovery.selection.screen import whole_delay
from piezo_hysteresis.discovery.verdict.changes import LISTED, changes_of
from piezo_hysteresis.discovery.verdict.verdict import Alternative, NamedEffect, Number, Verdict
from piezo_hysteresis.identification.sensitivities import delays_by_ticks
from piezo_hysteresis.models import PARAMETER_SHIFT, described
from piezo_hysteresis.numerics.harmonics import HIGHEST_ORDER, harmonics
from piezo_hysteresis.records import Record

if TYPE_CHECKING:
    from piezo_hysteresis.discovery.selection.elimination import Step

# Probability below which an alternative is omitted.
MIN_PROBABILITY = 0.005
# Probability from which an alternative is stated in the summary.
MENTIONED = POLICY.alternative
# Relative distance of a drive harmonic from a mode up to which the drive is listed. Within 4 % a
# lightly damped mode amplifies at least twelve times, 1 / (1 - (1 - 0.04)^2), and a harmonic of
# one per cent reaches an eighth of the drive. Chosen; it affects only this sentence.
NEAR_MODE = 0.04
# The physical quantity of a hysteresis, by what its block is.
_PLACES = {InverseRole.EXACT: 'of the input', InverseRole.OSCILLATOR: 'of the restoring force'}


def named_effects(
    steps: Sequence[Step],
    start: CandidateFit,
    final: CandidateFit,
    records: Sequence[Record],
    floor: float,  # [m]
    certainty: float = 1.0,  # [1]
    alike: Mapping[str, Similar] = MappingProxyType({}),
) -> tuple[NamedEffect, ...]:
    """Return the effects that `final` has in addition to `start`, with parameters and evidence."""
    found: dict[str, NamedEffect] = {}
    for step in steps:
        before = found.get(step.fit.effect)
        one = _named(step, start, final, records, floor, certainty, further=before is not None)
        one = _with_similar(one, alike.get(one.name, Similar()))
        found[one.name] = one if before is None else _joined(before, one)
    return tuple(_with_drives(each, records) for each in found.values())


def _with_similar(named: NamedEffect, found: Similar) -> NamedEffect:
    """Return the effect with those that the records cannot distinguish from it."""
    named = replace(named, look_alikes=found.names, ladder=found.ladder)
    if not found.bends:
        return named
    names = dict.fromkeys((named.name, *found.bends, *named.effect_class))
    return replace(named, one_of=tuple(names)[:LARGEST_CLASS])


def with_fractions(
    effects: Sequence[NamedEffect], final: CandidateFit, dt: float, late: float
) -> tuple[NamedEffect, ...]:  # dt, late [s]
    """Return the effects with delays that include their fraction of a sampling interval.

    A chain without inertia delays a held voltage by whole sampling intervals; the fraction is
    fitted as a sampling offset.
    """
    return tuple(_with_fraction(each, final, dt, late) for each in effects)


def _with_fraction(named: NamedEffect, final: CandidateFit, dt: float, late: float) -> NamedEffect:
    for name in delays_by_ticks(final.model).intersection(named.parameters):
        number = named.parameters[name]
        whole = replace(number, value=whole_delay(final, name, dt, late))
        rest = late - final.sampling_offset
        sentence = (
            f'Of the {name} of {in_prefixes(whole.value, "s")} the model file holds '
            f'{in_prefixes(whole.value - rest, "s")}, whole sampling intervals, and '
            f'{in_prefixes(rest, "s")} as sampling offset.'
        )
        named = replace(
            named,
            parameters={**named.parameters, name: whole},
            evidence=(*named.evidence, sentence),
        )
    return named


def _joined(first: NamedEffect, more: NamedEffect) -> NamedEffect:
    """Return one named effect from several elements of the same effect."""
    return replace(
        first, gap_after_rms_m=more.gap_after_rms_m, evidence=(*first.evidence, *more.evidence[1:])
    )


def _named(
    step: Step,
    start: CandidateFit,
    final: CandidateFit,
    records: Sequence[Record],
    floor: float,
    certainty: float,
    *,
    further: bool,
) -> NamedEffect:
    found_in = step.round
    chances = found_in.probabilities()
    winner = step.fit.effect
    others = tuple(
        Alternative(name, certainty * chance)
        for name, chance in chances.items()
        if name != winner and chance > MIN_PROBABILITY
    )
    # The winner of the round may be another variant of the effect than that in the final model.
    elements = [added for added in final.added if added.effect == winner]
    variants = tuple(dict.fromkeys(added.variant for added in elements))
    numbers = _numbers(elements, start, final)
    evidence = _evidence(step, variants[0], floor, further=further)
    changes: tuple[str, ...] = ()
    if winner == PARAMETER_SHIFT.name:
        changes = changes_of(numbers, start, final, records)
        what = ', '.join(changes) or 'none alone, all of them together'
        evidence.insert(1, f'Changes: {what}.')
    return NamedEffect(
        name=winner,
        variant=', '.join(variants),
        probability=certainty * chances[winner],
        p_value=found_in.gain.p_value,
        gap_before_rms_m=found_in.before.rms,
        gap_after_rms_m=step.fit.rms,
        parameters=numbers,
        alternatives=others,
        evidence=tuple(evidence),
        changes=changes,
    )


def _with_drives(named: NamedEffect, records: Sequence[Record]) -> NamedEffect:
    """Return the effect with the drives that have a harmonic near its modes."""
    for frequency in _modes(named):
        drives = _drives_on(frequency, records)
        more = (*named.evidence, *_mode_evidence(drives, frequency))
        named = replace(named, evidence=more, drives=(*named.drives, *drives))
    return named


def _numbers(
    elements: Sequence[Added], start: CandidateFit, final: CandidateFit
) -> dict[str, Number]:
    """Return the fitted parameters of `elements` that are new in `final` or shifted."""
    free = set(final.model.free_names) - set(start.model.free_names).difference(final.shifted)
    units = {q.name: q.unit for q in final.model.parameters}
    std = final.fitted.std if final.fitted is not None else {}
    return {
        name: Number(final.values[name], std.get(name), units[name])
        for added in elements
        for name in added.names.values()
        if name in free and _owner(name, final) is added
    }


def _owner(name: str, final: CandidateFit) -> Added:
    """Return the element to which a parameter belongs.

    A block that was added for one effect may hold parameters that another, smaller effect makes
    free.
    """
    holders = [added for added in final.added if name in added.names.values()]
    return min(holders, key=lambda added: len(added.names))


def _evidence(step: Step, variant: str, floor: float, *, further: bool) -> list[str]:
    found_in = step.round
    effect = next(e for e in described(step.fit.effect) if e.variant == variant)
    gap = f'{found_in.before.rms / floor:.3g} to {step.fit.rms / floor:.3g} noise floors'
    trust = (
        f'{found_in.gain.ratio:.3g} standard errors, {counted(found_in.tried, "candidate")} tried'
    )
    subject = 'A further element' if further else 'It'
    sentences = [
        effect.physics,
        f'{subject} lowers the gap on fitted records from {gap} ({trust}).',
    ]
    if len(found_in.finalists) > 1 and not further:
        second = next((t for t in found_in.finalists if t.effect != step.fit.effect), None)
        if second is not None:
            sentences.append(
                f'The next best effect, {second.effect}, gives {second.rms / floor:.3g} noise '
                'floors.'
            )
    return sentences


def _drives_on(frequency: float, records: Sequence[Record]) -> list[dict[str, float]]:
    """Return the drives with an odd harmonic near a mode, largest measured amplitude first."""
    found: dict[float, dict[str, float]] = {}
    for record in records:
        drive = record.info.frequency
        order = round(frequency / drive) if drive > 0 else 0
        if not 1 < order <= HIGHEST_ORDER or order % 2 == 0:
            continue
        if abs(order * drive / frequency - 1.0) > NEAR_MODE:
            continue
        measured = record.displacement[record.warm_up_samples :]
        orders, phasors, _ = harmonics(measured, drive, record.dt)
        if order not in orders:
            continue
        size = float(abs(phasors[order]))
        if size > found.get(drive, {'amplitude_m': 0.0})['amplitude_m']:
            found[drive] = {'frequency_hz': drive, 'order': order, 'amplitude_m': size}
    return sorted(found.values(), key=lambda each: -each['amplitude_m'])


def _mode_evidence(drives: Sequence[dict[str, float]], frequency: float) -> list[str]:
    """Return a sentence on the drive harmonics that excite the identified mode."""
    hits = [
        f'{each["frequency_hz"]:g} Hz (order {each["order"]}, '
        f'{each["order"] * each["frequency_hz"]:g} Hz, {1e6 * each["amplitude_m"]:.3g} µm)'
        for each in drives
    ]
    if not hits:
        return []
    where = f'Odd harmonics of these drives excite the mode at {frequency:.4g} Hz'
    return [f'{where}; measured amplitude in brackets: {", ".join(hits)}.']


def _modes(effect: NamedEffect) -> list[float]:
    return [n.value for k, n in effect.parameters.items() if k.startswith('resonance_frequency')]


def suspects(
    steps: Sequence[Step], last: SelectionRound | None, untried: Collection[str] = ()
) -> tuple[Alternative, ...]:
    """Return the known effects that an unknown effect resembles, without those `untried`."""
    rounds = [step.round for step in steps] or ([last] if last is not None else [])
    found: dict[str, float] = {}
    for found_in in rounds:
        assert found_in is not None
        for name, chance in found_in.probabilities().items():
            found[name] = max(found.get(name, 0.0), chance)
    ordered = sorted(found.items(), key=lambda each: -each[1])
    return tuple(
        Alternative(name, chance)
        for name, chance in ordered
        if chance > MIN_PROBABILITY and name not in untried
    )


def summary_of(verdict: Verdict) -> str:
    """Return the verdict in one sentence, and the steps that the time limit skipped."""
    summary = _summary(verdict)
    if verdict.identified_from and not _only_own(verdict):
        summary += (
            f' Excluded records: {len(verdict.identified_from)}, because the model was identified '
            'from them or validated on them.'
        )
    if not verdict.not_tried:
        return summary
    skipped = [', '.join(verdict.not_tried[:LISTED])]
    if len(verdict.not_tried) > LISTED:
        skipped.append(counted(len(verdict.not_tried) - LISTED, 'further step'))
    return f'{summary} The time limit ended the search; not tried: {" and ".join(skipped)}.'


def _only_own(verdict: Verdict) -> bool:
    evaluated = {name for names in verdict.records.values() for name in names}
    return evaluated <= set(verdict.identified_from)


def _summary(verdict: Verdict) -> str:
    held = verdict.held_out
    if _only_own(verdict):
        return (
            f'The model {verdict.baseline} was identified from or validated on these records, so '
            f'they cannot show a new effect: its error on them, {held.before_in_floors:.3g} noise '
            'floors, is part of the model.'
        )
    gap = f'{held.before_in_floors:.3g} to {held.after_in_floors:.3g} noise floors'
    if verdict.verdict == 'none':
        floors = f'{held.before_in_floors:.3g} noise floors'
        what = f'that these records show: the gap on held-out records is {floors}'
        if verdict.held_baseline:
            what = f'new: the gap on held-out records, {floors}, is one that it was known to leave'
        return (
            f'The model {verdict.baseline} misses nothing {what}. '
            f'{verdict.unexplained.description}'
        ).rstrip()
    if verdict.verdict == 'unknown':
        left = f'the held-out gap is {held.after_in_floors:.3g} noise floors.'
        if held.after_in_floors < held.before_in_floors:
            left = f'the closest one lowers the held-out gap only from {gap}.'
        known = 'effect that was tried' if verdict.not_tried else 'known effect'
        return f'The error of {verdict.baseline} is real, but no {known} explains it: {left}'
    more = ' A significant residual remains.' if verdict.unexplained.significant else ''
    shifts = [each for each in verdict.effects if each.name == PARAMETER_SHIFT.name]
    found = {each.name for each in verdict.effects}
    missed = [with_chance(each, found) for each in verdict.effects if each not in shifts]
    them = 'it' if len(missed) == 1 else 'them'
    findings = [f'misses {" and ".join(missed)}'] if missed else []
    done = [f'adding {them}'] if missed else []
    for shift in shifts:
        others = [a.name for a in shift.alternatives if a.probability > MENTIONED]
        what = 'has parameters that do not fit these records'
        if shift.changes:
            what = f'no longer fits ({", ".join(shift.changes)})'
        findings.append(f'{what}{_or(others)}')
        done.append('refitting them')
    return (
        f'The model {verdict.baseline} {" and ".join(findings)}; {" and ".join(done)} lowers the '
        f'held-out gap from {gap}.{more}'
    )


def _or(others: Sequence[str]) -> str:
    return f', or misses {" or ".join(others)} (they do not show which)' if others else ''


def with_chance(effect: NamedEffect, found: Collection[str]) -> str:
    """Return the name of an effect, with the alternatives that are not `found` themselves."""
    others = [name for name in effect.effect_class if name not in found]
    if others:
        return f'{" or ".join([effect.name, *others])} (these records do not show which)'
    modes = ' and '.join(f'{frequency:.4g} Hz' for frequency in _modes(effect))
    where = f'at {modes}' if modes else _where(effect)
    return f'{effect.name} {where}'.rstrip()


def _where(effect: NamedEffect) -> str:
    """Return the physical quantity of a variant, if the variants of the effect differ in it."""
    found = (each for each in described(effect.name) if each.variant == effect.variant)
    role = next((each.block.role for each in found if each.block is not None), None)
    return '' if role is None else _PLACES.get(role, '')
