"""Report and folder of a discovery."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from piezo_hysteresis.blocks.effect import FEWEST_FREQUENCIES
from piezo_hysteresis.discovery import Discovery, Verdict
from piezo_hysteresis.discovery.data.dataset import Check
from piezo_hysteresis.discovery.selection.candidate_fit import CandidateFit, evaluated_on
from piezo_hysteresis.discovery.verdict.verdict import NamedEffect, over_frequency
from piezo_hysteresis.identification.fit_data import FitData
from piezo_hysteresis.reporting.display_units import MICRO
from piezo_hysteresis.reporting.folder import write_folder
from piezo_hysteresis.reporting.folding import Value, folded, values_of, weights_figures
from piezo_hysteresis.reporting.page import PageSection, Plot, render, table
from piezo_hysteresis.reporting.plots import (
    Curve,
    band_figure,
    bars_before_after,
    response_figure,
    spectrum_figure,
    xy_figure,
)
from piezo_hysteresis.reporting.validation_report import detection_section

PERIODS = 3


def discovery_page(found: Discovery) -> str:
    """Return the report as HTML: the verdict on two screens, the details folded."""
    verdict = found.verdict
    sections = [
        _gaps(found),
        _effects(verdict),
        _two_way(verdict),
        _plots(found),
        _next(verdict, found.check),
        _records(found),
        _where(found),
        _parameters(verdict),
        detection_section(verdict.detection_limits),
        _model(found),
    ]
    kept = [section for section in sections if section is not None]
    shown = (
        'Gap between model and measurement',
        'Effects',
        'Up and down',
        'Residual',
        'Held-out data',
        'Next experiment',
    )
    title = f'Which effect does the model {verdict.baseline} lack?'
    folds = [replace(each, folded=each.title not in shown) for each in kept]
    return render(title, verdict.summary, folds)


def _gaps(found: Discovery) -> PageSection:
    """Return the gaps on held-out and on fitted records as a table."""
    verdict, held = found.verdict, found.verdict.held_out
    before, after = found.baselines.joint.rms, found.final.rms
    rows: list[tuple[Any, ...]] = [
        ('held out: no fit has used them', len(found.proof.rows), held.before_in_floors),
        ('fitted', len(found.data.training), before / found.floor),
    ]
    header: tuple[str, ...] = ('records', 'number', 'gap [noise floors]')
    if verdict.effects:
        header = ('records', 'number', 'gap before [noise floors]', 'gap after [noise floors]')
        rows = [(*rows[0], held.after_in_floors), (*rows[1], after / found.floor)]
    caption = (
        'Gap: rms of measured minus simulated displacement. One noise floor is '
        f'{MICRO * verdict.noise_floor_rms_m:.3g} µm rms.'
    )
    text = ''
    if not verdict.free_run_stable:
        text = 'The free run of the final model is NOT stable on all held-out records.'
    return PageSection(
        'Gap between model and measurement', text, (), (table(header, rows, caption),)
    )


def _plots(found: Discovery) -> PageSection:
    """Return the plots of the held-out records."""
    verdict, proof = found.verdict, found.proof
    names = _unique([row.record for row in proof.rows])
    bars = bars_before_after(
        names,
        [r.before for r in proof.rows],
        [r.after for r in proof.rows] if verdict.effects else None,
        found.floor,
        title='Held-out gap by record',
        caption='Rms error in µm on data that no fit has used. At the line only noise remains.',
        labels=_labels(verdict),
    )
    return PageSection('Held-out data', '', (bars, *_over_frequency(found), *_pictures(found)))


def _labels(verdict: Verdict) -> tuple[str, str]:
    return verdict.baseline, 'with the reported effects'


def _records(found: Discovery) -> PageSection:
    """Return the gap of every held-out record as a table."""
    unit = found.data.records[0].info.input_unit
    rows: list[tuple[Any, ...]] = [
        (r.record, r.frequency or None, r.amplitude, r.before / found.floor)
        for r in found.proof.rows
    ]
    header: tuple[str, ...] = ('record', 'frequency [Hz]', f'amplitude [{unit}]')
    if found.verdict.effects:
        header = (*header, 'before [noise floors]', 'after [noise floors]')
        after = [r.after / found.floor for r in found.proof.rows]
        rows = [(*row, each) for row, each in zip(rows, after, strict=True)]
    else:
        header = (*header, 'gap [noise floors]')
    return PageSection('Held-out records', '', (), (table(header, rows),))


def _over_frequency(found: Discovery) -> tuple[Plot, ...]:
    """Draw the gap of all records with the largest amplitude over the drive frequency."""
    rows = over_frequency(found.data, found.baselines.joint, found.final, found.proof)
    largest = max((row.amplitude for row in rows), default=0.0)
    rows = [row for row in rows if row.amplitude > 0.99 * largest]
    frequency = np.array([row.frequency for row in rows])
    if np.unique(frequency).size < FEWEST_FREQUENCIES:
        return ()
    spared = ', '.join(f'{row.frequency:g}' for row in rows if row.held_out)
    before, after = _labels(found.verdict)
    curves = [
        Curve(before, frequency, np.array([r.before for r in rows]), 'before'),
        Curve(after, frequency, np.array([r.after for r in rows]), 'after'),
    ]
    plot = xy_figure(
        _changed(found, curves),
        'Gap over drive frequency, held-out and fitted records',
        f'Drives of {largest:.3g} {found.data.records[0].info.input_unit}; held out: {spared} Hz.',
        'frequency of the drive [Hz]',
        'rms gap [µm]',
        log_y=True,
        floor=found.floor,
    )
    return (plot,)


def _pictures(found: Discovery) -> tuple[Plot, ...]:
    """Draw the held-out record with the largest improvement: loop and error over time."""
    views = found.data.held_out
    gains = [r.before - r.after for r in found.proof.rows]
    name = found.proof.rows[int(np.argmax(gains))].record
    view = next(v for v in views if v.name == name)
    part = _part(view, found.data.periods[name])
    measured, before, after = (np.full_like(view.voltage, np.nan) for _ in range(3))
    measured[view.first :] = view.measured
    for row, trial in ((before, found.baselines.joint), (after, found.final)):
        (error,) = evaluated_on(trial, [view]).errors
        row[view.first :] = view.measured - error
    time = view.start + np.arange(view.voltage.size, dtype=np.float64) * view.dt
    unit = found.data.records[0].info.input_unit
    names = ('model before', 'model after') if found.verdict.effects else ('model', '')
    responses = [
        ('measured', measured[part], ''),
        (names[0], before[part], 'before'),
        (names[1], after[part], 'after'),
    ]
    loops = response_figure(
        view.voltage[part],
        time[part],
        responses if found.verdict.effects else responses[:2],
        f'{name}, held out',
        'Measured, and simulated in free run.',
        unit,
    )
    names = ('before', 'after') if found.verdict.effects else ('model', '')
    pair = [
        Curve(names[0], time[view.first :], (measured - before)[view.first :], 'before'),
        Curve(names[1], time[view.first :], (measured - after)[view.first :], 'after'),
    ]
    errors = band_figure(
        _changed(found, pair),
        f'Held-out error of {name}',
        'Measured minus simulated displacement.',
        'error',
        view.frequency,
    )
    return loops, errors


def _changed(found: Discovery, pair: list[Curve]) -> list[Curve]:
    """Return the curves before and after; only the first if no effect was added."""
    return pair if found.verdict.effects else pair[:1]


def _part(view: FitData, period: int) -> slice:
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
        ('record', 'drive [Hz]', 'harmonic', 'gap [µm rms]'), rows, 'The ten largest components.'
    )
    views = found.data.training
    sizes = [float(np.std(e)) for e in found.baselines.joint.errors]
    worst = int(np.argmax(sizes))
    spectrum = spectrum_figure(
        [('before', found.baselines.joint.errors[worst]), ('after', found.final.errors[worst])],
        views[worst].dt,
        f'Spectrum of the error, {views[worst].name}, fitted',
        'Amplitude of measured minus simulated displacement.',
        roles=('before', 'after'),
        fundamental=views[worst].frequency,
    )
    moved = ', '.join(
        f'{key.replace("_", " ")} {MICRO * value:.3g} µm'
        for key, value in verdict.baseline_gaps_rms_m.items()
    )
    text = (
        f'Gap of the baseline on fitted records: {moved}. The joint fit uses all of them; the '
        'low-frequency fit uses the slowest ones and shows the change with frequency.'
    )
    return PageSection('Residual of the baseline by harmonic', text, (spectrum,), (places,))


def _order(harmonic: int) -> str:
    return {0: 'mean', -1: 'none'}.get(harmonic, str(harmonic))


def _effects(verdict: Verdict) -> PageSection | None:
    """Return the effects with their probabilities, or the residual without a name."""
    if not verdict.effects:
        if verdict.verdict == 'none':
            return None
        # their probabilities are shares among effects of which none is significant
        names = ', '.join(each.name for each in verdict.suspects)
        more = f' It resembles {names}, but no effect is significant.' if names else ''
        return PageSection('Residual', verdict.unexplained.description + more)
    parts = []
    rows: list[tuple[str, str, str]] = []
    for effect in verdict.effects:
        parts.append(f'`{effect.name}`: {" ".join(effect.evidence)}')
        rows.append((effect.name, f'{effect.probability:.3f}', probability_text(effect.p_value)))
        rows += [(f'or {a.name}', f'{a.probability:.3f}', '') for a in effect.alternatives]
        rows += [
            (f'or {near.name}', f'within {near.distance:.2g} standard deviations', '')
            for near in effect.only_alike
        ]
    if verdict.unexplained.significant:
        parts.append(f'Remaining residual: {verdict.unexplained.description}')
    caption = (
        'Probability among all candidates and no effect. P-value: probability of this improvement '
        'by chance, over all candidates.'
    )
    header = ('effect', 'probability', 'p-value')
    return PageSection('Effects', '\n\n'.join(parts), (), (table(header, rows, caption),))


def _two_way(verdict: Verdict) -> PageSection | None:
    """Return by how much the way down lies above the way up in each record."""
    if not verdict.two_way:
        return None
    rows = [
        (
            each.record,
            MICRO * each.difference_m,
            100.0 * each.share,
            1e3 * each.delay_s,
            None if each.first_cycle_m is None else MICRO * each.first_cycle_m,
        )
        for each in verdict.two_way
    ]
    header = ('record', 'difference [µm]', '[% of stroke]', 'as a delay [ms]', 'first cycle [µm]')
    caption = (
        'Way down above way up at equal voltage, over the middle half of the range. At all speeds '
        'the same as a delay: delay or lag. The same in µm: hysteresis or play. Smaller at speed: '
        'creep. In the first cycle only: the way from the initial state.'
    )
    return PageSection('Up and down', '', (), (table(header, rows, caption),))


def _parameters(verdict: Verdict) -> PageSection | None:
    """Return the parameters of the reported effects."""
    if not verdict.effects:
        return None
    rows = []
    plots: tuple[Plot, ...] = ()
    for effect in verdict.effects:
        values = effect_values(effect)
        rows += [(effect.name, *line) for line in folded(values)]
        plots += weights_figures(values)
    header = ('effect', 'parameter', 'value', 'unit')
    found = table(header, rows, 'With one standard deviation.')
    return PageSection('Parameters of the effects', '', plots, (found,))


def effect_values(effect: NamedEffect) -> list[Value]:
    """Return the reported parameters of an effect."""
    return [
        Value(name, number.value, number.std, number.unit)
        for name, number in effect.parameters.items()
    ]


_SMALLEST_P = 1e-9


def probability_text(p_value: float) -> str:
    """Return a p-value as text, with a lower display limit."""
    return f'{p_value:.1e}' if p_value > _SMALLEST_P else f'below {_SMALLEST_P:.0e}'


def _next(verdict: Verdict, check: Check) -> PageSection:
    lines = [f'- {each}' for each in verdict.next_experiments]
    limits = limits_of_records(check, verdict.next_experiments)
    if limits:
        lines += ['', 'These records cannot show:', '', *(f'- {each}' for each in limits)]
    return PageSection('Next experiment', '\n'.join(lines))


def limits_of_records(check: Check, experiments: Sequence[str]) -> list[str]:
    """Return the limitations of the records, without those that the experiments already state."""
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
    # a fixed parameter has no standard deviation
    shown = {name: value for name, value in std.items() if name not in held}
    numbers = {name: final.values[name] for name in final.model.parameter_names}
    rows = folded(values_of(numbers, shown, units))
    chain = ' -> '.join(block.name for block in final.model.blocks)
    verdict = found.verdict
    text = (
        f'Chain from voltage to displacement, with | between parallel blocks: '
        f'{chain}.\n\nFitted records: {", ".join(verdict.records["training"])}.\n\n'
        f'Held out: {", ".join(verdict.records["held_out"])}.\n\n'
        f'Seed {verdict.seed}; {verdict.seconds:.1f} s.'
    )
    return PageSection('Final model', text, (), (table(('parameter', 'value', 'unit'), rows),))


def _unique(names: Sequence[str]) -> list[str]:
    seen: dict[str, int] = {}
    found = []
    for name in names:
        seen[name] = seen.get(name, 0) + 1
        found.append(name if seen[name] == 1 else f'{name} ({seen[name]})')
    return found


def write_discovery(out: str | Path, found: Discovery, data: Sequence[str] = ()) -> None:
    """Write verdict.json, model.yaml, params.yaml and report.html."""
    saved = found.model_file(data)
    ros = {'/**': {'ros__parameters': saved.to_ros_parameters()}}
    verdict = json.dumps(found.verdict.to_dict(), indent=2, allow_nan=False)
    write_folder(
        out,
        {
            'verdict.json': verdict + '\n',
            'model.yaml': saved.text(),
            'params.yaml': yaml.safe_dump(ros, sort_keys=False),
            'report.html': discovery_page(found),
        },
        'discover',
    )
