"""The figures and tables of 002, 003 and 004."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from bench import closed_loops as loops
from bench import compensation_plants as plants
from bench.papers_page import Draw, Entry, finish, loop, panels
from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.compensation.base import Link
from piezo_hysteresis.compensation.loop import LoopResult, tracking_metrics
from piezo_hysteresis.waveforms import Sine, Waveform, from_spec

FLAP_FREQUENCIES = (10.0, 20.0, 30.0, 40.0, 50.0, 60.0)


def flap_model_error(frequency: float) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """Return voltage, measured and modelled displacement of two periods, and the rms error."""
    seconds = max(0.5, 4.0 / frequency)
    time = np.arange(round(seconds / loops.FLAP_DT)) * loops.FLAP_DT
    voltage = 60.0 * np.sin(2 * np.pi * frequency * time)
    measured = loops.plant(loops.FLAP).run(voltage)
    model, values = loops.flap_model()
    modelled = model.respond(voltage, model.pack(values), loops.FLAP_DT)
    part = slice(-round(2.0 / frequency / loops.FLAP_DT), None)
    error = loops.rms(measured[part] - modelled[part])
    return voltage[part], measured[part], modelled[part], error


def flap_models() -> list[Entry]:
    """Return figures 6 and 7 of 002."""
    data = {f: flap_model_error(f) for f in (1.0, *FLAP_FREQUENCIES)}

    def drawing(frequencies: Sequence[float]) -> Draw:
        def draw(figure: Figure) -> None:
            for axis, f in zip(panels(figure, len(frequencies)), frequencies, strict=True):
                voltage, measured, modelled, _ = data[f]
                loop(axis, voltage, measured, 'measured')
                loop(axis, voltage, modelled, 'model', '--')
                axis.set_title(f'{f:.0f} Hz')

        return draw

    worst = max(data[f][3] for f in FLAP_FREQUENCIES) * 1e6
    same = 'the model is of the kind that the simulated actuator is made of'
    return [
        Entry('002', 'Figure 6', 'model at 1 Hz', 'good agreement',
              f'rms error {data[1.0][3] * 1e6:.2f} um of +-{data[1.0][1].max() * 1e6:.0f} um',
              drawing((1.0,)), same, {'error': data[1.0][3] * 1e6}),
        Entry('002', 'Figure 7', 'model at 10 to 60 Hz',
              'captures the rate dependence in a wide range',
              f'rms error at most {worst:.2f} um; the damping alone widens the loops',
              drawing(FLAP_FREQUENCIES), same, {'error': worst}),
    ]  # fmt: skip


def flap_run(kind: str, wave: Waveform, mismatch: str = 'A -10 %') -> LoopResult:
    """Return a run of 002's actuator with a model that is wrong by `mismatch`."""
    values = plants.flap_mismatches()[mismatch]
    return loops.run(
        wave, lambda: plants.flap_links(kind, values), loops.plant(loops.FLAP), loops.FLAP_LIMITS,
        loops.FLAP_DT,
    )  # fmt: skip


def flap_control(frequencies: Sequence[float], seconds: float) -> list[Entry]:
    """Return figures 9, 11 and 12 of 002."""
    runs = {
        (kind, f): flap_run(kind, Sine(plants.FLAP_STROKE, f, seconds, ramp=0.3))
        for kind in ('none', 'inverse', 'compound')
        for f in frequencies
    }
    worst = {key: 1e6 * tracking_metrics(r, 0.6 * seconds).largest for key, r in runs.items()}

    def part(f: float) -> slice:
        return slice(-round(2.0 / f / loops.FLAP_DT), None)

    def draw_9(figure: Figure) -> None:
        axis = figure.subplots()
        for kind in ('none', 'inverse'):
            r = runs[kind, 10.0]
            axis.plot(r.time[part(10.0)], r.error[part(10.0)] * 1e6, label=kind)
        finish(axis, 'time [s]', 'error [µm]', '10 Hz')

    def draw_11(figure: Figure) -> None:
        for axis, f in zip(panels(figure, len(frequencies)), frequencies, strict=True):
            r = runs['compound', f]
            axis.plot(r.reference[part(f)] * 1e6, r.displacement[part(f)] * 1e6, lw=0.8)
            finish(axis, 'desired [µm]', 'measured [µm]', f'{f:.0f} Hz')

    def draw_12(figure: Figure) -> None:
        for axis, f in zip(panels(figure, len(frequencies)), frequencies, strict=True):
            for kind in ('none', 'inverse', 'compound'):
                error = runs[kind, f].error[part(f)]
                time = np.arange(error.size) * loops.FLAP_DT * 1e3
                axis.plot(time, error * 1e6, lw=0.8, label=kind)
            finish(axis, 'time [ms]', 'error [µm]', f'{f:.0f} Hz')

    ten = [worst[kind, 10.0] for kind in ('none', 'inverse', 'compound')]
    listed = ', '.join(
        f'{f:.0f} Hz {worst["none", f]:.0f} / {worst["inverse", f]:.1f} / '
        f'{worst["compound", f]:.1f}' for f in frequencies
    )  # fmt: skip
    wrong = (
        'with the identified model the inverse alone leaves 1.3 um, so the model is made wrong by '
        '10 % of alpha here; with 10 % of any parameter see `bench/compensation.py`'
    )
    return [
        Entry('002', 'Figure 9', 'feedforward at 10 Hz', '65 um without, about 14 um with it',
              f'{ten[0]:.0f} um without, {ten[1]:.1f} um with it', draw_9, wrong,
              {'none': ten[0], 'inverse': ten[1]}),
        Entry('002', 'Figure 11', 'compound control, 10 to 60 Hz', 'straight lines',
              f'straight lines, largest error {max(worst["compound", f] for f in frequencies):.1f}'
              ' um', draw_11, wrong),
        Entry('002', 'Figure 12', 'errors without, with feedforward, with compound control',
              'at 10 Hz 65, 14 and 9 um; other frequencies without numbers',
              f'largest errors [um]: {listed}', draw_12,
              'compound: inverse, PID and cancellation of orders 1, 2, 3, 5; ' + wrong,
              {'compound': max(worst['compound', f] for f in frequencies)}),
    ]  # fmt: skip


def flap_composites(seconds: float) -> Entry:
    """Return figure 13 of 002."""
    runs = {}
    for kind in ('composite_002_low', 'composite_002_high'):
        spec = {'kind': kind, 'amplitude': plants.FLAP_STROKE, 'duration': seconds, 'ramp': 0.3}
        for chain in ('none', 'inverse', 'PID'):
            runs[kind, chain] = flap_run(chain, from_spec(spec))
    worst = {key: 1e6 * float(np.abs(r.error[r.error.size // 2 :]).max()) for key, r in
             runs.items()}  # fmt: skip

    def draw(figure: Figure) -> None:
        for axis, kind in zip(figure.subplots(1, 2), ('composite_002_low', 'composite_002_high'),
                              strict=True):  # fmt: skip
            for chain in ('none', 'inverse', 'PID'):
                r = runs[kind, chain]
                axis.plot(r.time[-1000:], r.error[-1000:] * 1e6, lw=0.8, label=chain)
            finish(axis, 'time [s]', 'error [µm]', kind)

    low, high = 'composite_002_low', 'composite_002_high'
    return Entry(
        '002', 'Figure 13', 'sums of three sinusoids', 'errors reduced dramatically, no numbers',
        f'20/30/40 Hz {worst[low, "none"]:.0f} -> {worst[low, "inverse"]:.1f} -> '
        f'{worst[low, "PID"]:.1f} um (inverse, inverse and PID); 40/50/60 Hz '
        f'{worst[high, "none"]:.0f} -> {worst[high, "inverse"]:.1f} -> {worst[high, "PID"]:.1f}',
        draw, 'amplitudes and phases of the components are not printed',
        {'low': worst[low, 'PID'] / worst[low, 'none'],
         'high': worst[high, 'PID'] / worst[high, 'none']},
    )  # fmt: skip


def stack_table(frequencies: Sequence[float]) -> Entry:
    """Return table 1 of 003."""
    selector = plants.selector_values()
    rows = {}
    for f, none, _, paper, _ in plants.TABLE_1:
        if f not in frequencies:
            continue
        results = {}
        for kind in ('none', 'selector', 'inverse'):

            def links(kind: str = kind, f: float = f) -> list[Link]:
                return plants.stack_links(kind, f, selector)

            r = loops.run(plants.stack_reference(f), links, loops.plant(loops.STACK),
                          loops.STACK_LIMITS, loops.STACK_DT)  # fmt: skip
            results[kind] = 1e6 * tracking_metrics(r, 1.2).rms_without_mean
        rows[f] = (none, results['none'], paper, results['selector'], results['inverse'])

    def draw(figure: Figure) -> None:
        axis = figure.subplots()
        names = ('paper, none', 'none', 'paper, selector', 'selector', 'inverse of the chain')
        for k, (name, style) in enumerate(zip(names, ('k--', 'k.-', 'b--', 'b.-', 'g.-'),
                                              strict=True)):  # fmt: skip
            axis.plot(list(rows), [row[k] for row in rows.values()], style, label=name)
        finish(axis, 'frequency of the triangle [Hz]', 'rms error [µm]')

    ours = '; '.join(f'{f:.0f} Hz {r[1]:.2f} -> {r[3]:.2f} ({r[4]:.2f})' for f, r in rows.items())
    said = '; '.join(f'{f:.0f} Hz {r[0]:.2f} -> {r[2]:.2f}' for f, r in rows.items())
    return Entry(
        '003', 'Table 1', 'triangles of 30 um, rms error without and with the selector [um]', said,
        ours + ' (in brackets the inverse of hysteresis, mode and creep)', draw,
        "003's hysteresis is not printed; ours was chosen for the column without compensation. "
        'Means removed. Most of the growth with frequency is linear lag, which the inverse of the '
        'chain undoes and a Bouc-Wen law cannot',
        {'worst selector': max(r[3] / r[2] for r in rows.values()),
         'worst inverse': max(r[4] / r[2] for r in rows.values())},
    )  # fmt: skip


def stack_signals(seconds: float) -> list[Entry]:
    """Return figures 17 to 20 of 003."""
    selector = plants.selector_values()
    middle = plants.stack_middle(10.0)
    fast = from_spec({'kind': 'composite_003', 'amplitude': 12e-6, 'offset': middle,
                      'duration': seconds, 'ramp': 0.3})  # fmt: skip
    slow = from_spec({'kind': 'sum', 'amplitude': 12e-6, 'offset': middle, 'duration': 2 * seconds,
                      'ramp': 0.5, 'frequencies': (1.0, 3.0, 5.0)})  # fmt: skip
    found = []
    cases = (
        ('Figure 17', 'none', fast, 'sum of sinusoids without compensation',
         'very intolerable error'),
        ('Figure 18', 'selector', fast, 'with the selector', 'matched well'),
        ('Figure 19', 'selector + H-infinity', fast, 'with selector and H-infinity',
         'within 1 um'),
        ('Figure 20', 'selector + H-infinity', slow, '1 to 5 Hz, selector and H-infinity',
         'within 0.05 um'),
    )  # fmt: skip
    for name, kind, wave, shows, said in cases:

        def links(kind: str = kind) -> list[Link]:
            return plants.stack_links(kind, 10.0, selector)

        r = loops.run(wave, links, loops.plant(loops.STACK), loops.STACK_LIMITS, loops.STACK_DT)
        tail = r.error[r.error.size // 2 :]
        worst = 1e6 * float(np.abs(tail - tail.mean() * (kind == 'none')).max())

        def draw(figure: Figure, r: LoopResult = r) -> None:
            left, right = figure.subplots(1, 2)
            half = r.time.size // 2
            left.plot(r.time[half:], r.reference[half:] * 1e6, label='reference')
            left.plot(r.time[half:], r.displacement[half:] * 1e6, '--', label='displacement')
            finish(left, 'time [s]', '[µm]')
            right.plot(r.time[half:], r.error[half:] * 1e6, lw=0.8)
            finish(right, 'time [s]', 'error [µm]')

        reason = 'frequencies and amplitudes are not printed: 7, 19 and 43 Hz are used'
        found.append(Entry('003', name, shows, said, f'largest error {worst:.3f} um', draw,
                           reason if wave is fast else 'as above, with 1, 3 and 5 Hz',
                           {'worst': worst}))  # fmt: skip
    return found


def stage_figures(names: Sequence[str]) -> list[Entry]:
    """Return figures 7 to 11 of 004."""
    found = []
    for number, (name, spec, pid, compound) in enumerate(plants.FANG, start=7):
        if name not in names:
            continue
        wave = from_spec({**spec, 'duration': 12.0, 'offset': 9e-6, 'ramp': 1.0})
        runs = {}
        for kind in ('PID', 'inverse + fuzzy PID'):

            def links(kind: str = kind) -> list[Link]:
                return plants.stage_links(kind)

            runs[kind] = loops.run(wave, links, loops.plant(loops.STAGE), loops.STAGE_LIMITS,
                                   loops.STAGE_DT)  # fmt: skip
        worst = {k: 1e6 * tracking_metrics(r, 6.0).largest for k, r in runs.items()}

        def draw(figure: Figure, runs: dict[str, LoopResult] = runs) -> None:
            axis = figure.subplots()
            for kind, r in runs.items():
                axis.plot(r.time[6000:], r.error[6000:] * 1e6, lw=0.8, label=kind)
            finish(axis, 'time [s]', 'error [µm]')

        found.append(
            Entry('004', f'Figure {number}', name,
                  f'largest error {pid} um with PID, {compound} um with inverse and fuzzy PID',
                  f'{worst["PID"]:.3f} um with PID, {worst["inverse + fuzzy PID"]:.3f} um with '
                  'inverse and fuzzy PID', draw,
                  'law, rule table and all gains but KD = 120 (read as V s/m) of 004 are missing '
                  'from its text; the encoder is assumed to have 5 nm steps and 3 nm noise',
                  {'PID': worst['PID'], 'compound': worst['inverse + fuzzy PID'],
                   'paper': compound})
        )  # fmt: skip
    return found


def entries(quick: bool = False) -> list[Entry]:
    """Return every figure and table of 002, 003 and 004 that is reproduced."""
    if quick:
        return [
            *flap_models(),
            *flap_control((10.0,), 1.0),
            stack_table((10.0, 100.0)),
            *stage_figures(('4 um, 5 Hz',)),
        ]
    return [
        *flap_models(),
        *flap_control(FLAP_FREQUENCIES, 4.0),
        flap_composites(2.0),
        stack_table([row[0] for row in plants.TABLE_1]),
        *stack_signals(1.5),
        *stage_figures([row[0] for row in plants.FANG]),
    ]
