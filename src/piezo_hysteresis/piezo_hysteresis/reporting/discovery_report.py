"""The discovery as a page that a colleague can read without us."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from piezo_hysteresis.blocks.effect import FEWEST_FREQUENCIES
from piezo_hysteresis.discovery import Discovery, Verdict
from piezo_hysteresis.discovery.data.check import Check
from piezo_hysteresis.discovery.selection.candidate_fit import CandidateFit, judged_on
from piezo_hysteresis.discovery.verdict.prove import over_frequency
from piezo_hysteresis.discovery.verdict.verdict import NamedEffect
from piezo_hysteresis.identification.targets import Target
from piezo_hysteresis.reporting.detection_table import detection_section
from piezo_hysteresis.reporting.folding import Value, folded, values_of, weights_figures
from piezo_hysteresis.reporting.page import PageSection, Plot, render, table
from piezo_hysteresis.reporting.plots import (
    Curve,
    bars_before_after,
    loop_figure,
    spectrum_figure,
    trace_figure,
    xy_figure,
)
from piezo_hysteresis.reporting.signals import stands_out
from piezo_hysteresis.reporting.units import MICRO

PERIODS = 3


def discovery_page(found: Discovery) -> str:
    """Return the report as HTML."""
    verdict = found.verdict
    sections = [
        _proof(found),
        _where(found),
        _what(verdict),
        _how_sure(verdict),
        detection_section(verdict.detection_limits),
        _next(verdict, found.check),
        _model(found),
    ]
    title = f'What the model {verdict.baseline} misses'
    return render(title, verdict.summary, [s for s in sections if s is not None])


def _proof(found: Discovery) -> PageSection:
    verdict, proof = found.verdict, found.proof
    unit = found.data.records[0].info.input_unit
    names = _unique([_label(r.record, r.frequency, r.amplitude, unit) for r in proof.rows])
    held = verdict.held_out
    bars = bars_before_after(
        names,
        [r.before for r in proof.rows],
        [r.after for r in proof.rows],
        found.floor,
        title='Gap on held-out records',
        caption='Records that were not fitted. Where the bars reach the line only noise is left.',
        labels=(f'{verdict.baseline} alone', 'with what was found'),
    )
    text = (
        f'On {len(proof.rows)} held-out parts the gap between model and measurement is '
        f'{held.before_in_floors:.3g} noise floors before and {held.after_in_floors:.3g} after. '
        f'The noise floor is {MICRO * verdict.noise_floor_rms_m:.3g} µm rms. The free run of the '
        f'final model is {"stable" if verdict.free_run_stable else "NOT stable"} on all of them.'
    )
    rows = [
        (
            r.record,
            r.frequency or None,
            r.amplitude,
            r.before / found.floor,
            r.after / found.floor,
        )
        for r in proof.rows
    ]
    proof_table = table(
        ('record', 'frequency [Hz]', f'amplitude [{unit}]', 'before [floors]', 'after [floors]'),
        rows,
    )
    plots = (bars, *_over_frequency(found), *_pictures(found))
    return PageSection('Before and after', text, plots, (proof_table,))


def _over_frequency(found: Discovery) -> tuple[Plot, ...]:
    """Draw the gap of all records of the largest amplitude over the frequency of the drive."""
    rows = over_frequency(found.data, found.baselines.joint, found.final, found.proof)
    largest = max((row.amplitude for row in rows), default=0.0)
    rows = [row for row in rows if row.amplitude > 0.99 * largest]
    frequency = np.array([row.frequency for row in rows])
    if np.unique(frequency).size < FEWEST_FREQUENCIES:
        return ()
    spared = ', '.join(f'{row.frequency:g}' for row in rows if row.held_out)
    plot = xy_figure(
        [
            Curve(
                f'{found.verdict.baseline} alone',
                frequency,
                np.array([r.before for r in rows]),
                'before',
            ),
            Curve('with what was found', frequency, np.array([r.after for r in rows]), 'after'),
        ],
        'Gap over the frequency of the drive',
        f'Drives of {largest:.3g} {found.data.records[0].info.input_unit}; held out: {spared} Hz.',
        'frequency of the drive [Hz]',
        'rms gap [µm]',
        log_y=True,
        floor=found.floor,
    )
    return (plot,)


def _pictures(found: Discovery) -> tuple[Plot, ...]:
    """Draw the held-out record in which most was gained: loop and error over time."""
    views = found.data.held_out
    gains = [r.before - r.after for r in found.proof.rows]
    name = found.proof.rows[int(np.argmax(gains))].record
    view = next(v for v in views if v.name == name)
    part = _part(view, found.data.periods[name])
    measured, before, after = (np.full_like(view.voltage, np.nan) for _ in range(3))
    measured[view.first :] = view.measured
    for row, trial in ((before, found.baselines.joint), (after, found.final)):
        (error,) = judged_on(trial, [view]).errors
        row[view.first :] = view.measured - error
    time = np.arange(view.voltage.size, dtype=np.float64) * view.dt
    unit = found.data.records[0].info.input_unit
    loops = loop_figure(
        [
            Curve('measured', view.voltage[part], measured[part]),
            Curve('model before', view.voltage[part], before[part], 'before'),
            Curve('model after', view.voltage[part], after[part], 'after'),
        ],
        f'Loop of {name}',
        'Measured and simulated in free run.',
        unit,
    )
    left = (measured - after)[view.first :]
    caption = 'Measured minus simulated.'
    if stands_out(left, (measured - after)[part]):
        part = slice(view.first, None)
        caption += ' The whole record, for single samples stand out.'
    errors = trace_figure(
        [
            Curve('before', time[part], (measured - before)[part], 'before'),
            Curve('after', time[part], (measured - after)[part], 'after'),
        ],
        f'Error of {name}',
        caption,
        'error',
        ground=False,
    )
    return loops, errors


def _part(view: Target, period: int) -> slice:
    length = PERIODS * period if period else round(2.0 / view.dt)
    return slice(max(view.first, view.voltage.size - length), view.voltage.size)


def _where(found: Discovery) -> PageSection:
    verdict = found.verdict
    rows = [
        (
            place['record'],
            place['frequency_hz'] or None,
            _order(int(place['harmonic'])),
            MICRO * place['rms_m'],
        )
        for place in verdict.where[:10]
    ]
    places = table(
        ('record', 'drive [Hz]', 'harmonic', 'gap [µm rms]'), rows, 'The ten largest places.'
    )
    views = found.data.training
    sizes = [float(np.std(e)) for e in found.baselines.joint.errors]
    worst = int(np.argmax(sizes))
    spectrum = spectrum_figure(
        [
            ('before', found.baselines.joint.errors[worst]),
            ('after', found.final.errors[worst]),
        ],
        views[worst].dt,
        f'Spectrum of the error, {views[worst].name}',
        'Amplitudes of what the model does not explain.',
        roles=('before', 'after'),
        fundamental=views[worst].frequency,
    )
    moved = ', '.join(
        f'{key.replace("_", " ")} {MICRO * value:.3g} µm'
        for key, value in verdict.baseline_gaps_rms_m.items()
    )
    text = (
        f'Gap of the baseline on the training records: {moved}. The joint fit is to all of '
        'them; a fit to the slowest ones alone shows what comes with frequency.'
    )
    return PageSection('Where model and measurement disagree', text, (spectrum,), (places,))


def _order(harmonic: int) -> str:
    return {0: 'mean', -1: 'none (the rest)'}.get(harmonic, str(harmonic))


def _what(verdict: Verdict) -> PageSection | None:
    if not verdict.effects:
        if verdict.verdict == 'none':
            return None
        doubts = ', '.join(f'{s.name} ({s.probability:.0%})' for s in verdict.suspects)
        more = f' It looks most like {doubts}, without being it.' if doubts else ''
        return PageSection('What is left', verdict.unexplained.description + more)
    parts = []
    rows = []
    plots: tuple[Plot, ...] = ()
    for effect in verdict.effects:
        parts.append(f'`{effect.name}`: {" ".join(effect.evidence)}')
        values = effect_values(effect)
        rows += [(effect.name, *line) for line in folded(values)]
        plots += weights_figures(values)
    if verdict.unexplained.significant:
        parts.append(f'Still left: {verdict.unexplained.description}')
    found = table(('effect', 'parameter', 'value', 'unit'), rows, 'With one standard deviation.')
    return PageSection('What is missing', '\n\n'.join(parts), plots, (found,))


def effect_values(effect: NamedEffect) -> list[Value]:
    """Return the parameters of an effect as they are reported."""
    return [
        Value(name, number.value, number.std, number.unit)
        for name, number in effect.parameters.items()
    ]


_SMALLEST_P = 1e-9


def chance_words(p_value: float) -> str:
    """Return a p-value; a smaller one than any assumption is good for is said to be below it."""
    return f'{p_value:.1e}' if p_value > _SMALLEST_P else f'below {_SMALLEST_P:.0e}'


def _how_sure(verdict: Verdict) -> PageSection | None:
    if not verdict.effects:
        return None
    rows = []
    for effect in verdict.effects:
        rows.append((effect.name, f'{effect.probability:.3f}', chance_words(effect.p_value)))
        rows += [(f'or {a.name}', f'{a.probability:.3f}', '') for a in effect.alternatives]
    text = (
        'The probability is that of this effect among all that were tried and none of them. The '
        'p-value is that of such an improvement by chance, for all candidates that were tried.'
    )
    return PageSection('How sure', text, (), (table(('effect', 'probability', 'p-value'), rows),))


def _next(verdict: Verdict, check: Check) -> PageSection:
    lines = [f'- {each}' for each in verdict.next_experiments]
    limits = limits_of_records(check, verdict.next_experiments)
    if limits:
        lines += ['', 'What these records cannot tell:', '', *(f'- {each}' for each in limits)]
    return PageSection('What to measure next', '\n'.join(lines))


def limits_of_records(check: Check, experiments: Sequence[str]) -> list[str]:
    """Return what records cannot tell, without what the experiments above have said already."""
    limits = list(check.findings)
    for names, advice in check.confounded:
        listed = ', '.join(names)
        if not any(listed in each and advice in each for each in experiments):
            known = any(advice in each for each in experiments)
            limits.append(f'{listed} cannot be distinguished{"" if known else f": {advice}"}')
    return limits


def _model(found: Discovery) -> PageSection:
    final: CandidateFit = found.final
    std = final.fitted.std if final.fitted is not None else {}
    units = {q.name: q.unit for q in final.model.parameters}
    held = set(final.model.held)
    # what is held has no deviation
    shown = {name: value for name, value in std.items() if name not in held}
    numbers = {name: final.values[name] for name in final.model.parameter_names}
    rows = folded(values_of(numbers, shown, units))
    chain = ' -> '.join(block.name for block in final.model.blocks)
    verdict = found.verdict
    text = (
        f'Chain, in the order in which the voltage passes, with | between blocks side by side: '
        f'{chain}.\n\nTraining records: {", ".join(verdict.records["training"])}.\n\n'
        f'Held out: {", ".join(verdict.records["held_out"])}.\n\n'
        f'Seed {verdict.seed}; {verdict.seconds:.1f} s.'
    )
    return PageSection('The final model', text, (), (table(('parameter', 'value', 'unit'), rows),))


def _label(record: str, frequency: float, amplitude: float, unit: str) -> str:
    return f'{frequency:g} Hz, {amplitude:.3g} {unit}' if frequency else record


def _unique(names: Sequence[str]) -> list[str]:
    seen: dict[str, int] = {}
    found = []
    for name in names:
        seen[name] = seen.get(name, 0) + 1
        found.append(name if seen[name] == 1 else f'{name} ({seen[name]})')
    return found
