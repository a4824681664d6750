"""The control figures and tables of Zhou 2021 and Fang 2019."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.compensation.base import Link
from piezo_hysteresis.compensation.loop import LoopResult, tracking_metrics
from piezo_hysteresis.waveforms import Sine, Waveform, from_spec
from studies import closed_loops as loops
from studies import compensation_plants as plants
from studies.papers_page import Draw, Entry, finish, loop, panels

FLAP_FREQUENCIES = (10.0, 20.0, 30.0, 40.0, 50.0, 60.0)


def flap_model_error(frequency: float) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """Return voltage, measured and modelled displacement of two periods, and the rms error."""
    seconds = max(0.5, 4.0 / frequency)
    time = np.arange(round(seconds / loops.FLAP_DT)) * loops.FLAP_DT
    voltage = 60.0 * np.sin(2 * np.pi * frequency * time)
    measured = loops.plant(loops.FLAP).run(voltage)
    found = loops.flap_by_002()
    modelled = found.model.respond(voltage, found.model.pack(found.values), loops.FLAP_DT)
    part = slice(-round(2.0 / frequency / loops.FLAP_DT), None)
    error = loops.rms(measured[part] - modelled[part])
    return voltage[part], measured[part], modelled[part], error


def flap_table() -> Entry:
    """Return table 2 of Zhou 2021: what its two steps find."""
    found = loops.flap_by_002()
    v, d = found.values, found.values['A1']
    rows = {'alpha': (v['A'] / d, 0.61), 'beta': (v['beta'], 0.039), 'gamma': (v['gamma'], 0.0065),
            'b': (v['damping'], 513.0)}  # fmt: skip

    def draw(figure: Figure) -> None:
        axis = figure.subplots()
        for place, (name, (ours, printed)) in enumerate(rows.items()):
            axis.bar(place, ours / printed)
            axis.text(place, ours / printed, f'{ours:.4g}', ha='center', va='bottom')
            axis.text(place, 0.05, name, ha='center')
        axis.axhline(1.0, color='k', lw=0.8)
        finish(axis, '', 'found here over printed')

    return Entry(
        'Zhou 2021', 'Table 2', 'identified parameters',
        'alpha 0.61, beta 0.039 /V, gamma 0.0065 /V, b 513 N s/m; m 5.4e-5 kg, k 8.0e5 N/m, '
        'd 5.5e-6 mm/V',
        f'alpha {rows["alpha"][0]:.3f}, beta {rows["beta"][0]:.4f} /V, gamma '
        f'{rows["gamma"][0]:.4f} /V, b {rows["b"][0]:.0f} N s/m, by its two steps of particle '
        'swarm (zhou2021)', draw,
        'the preset has the printed values with their units mended (m in tonnes, d in m/V). Step '
        '1 takes 1 Hz for quasi-static: what the damping lags there goes into the hysteresis; at '
        'one amplitude only the shape of the loop tells beta from gamma',
        {name: ours / printed for name, (ours, printed) in rows.items()},
    )  # fmt: skip


def flap_models() -> list[Entry]:
    """Return figures 6 and 7 of Zhou 2021."""
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
        Entry('Zhou 2021', 'Figure 6', 'model at 1 Hz', 'good agreement, no number',
              f'rms error {data[1.0][3] * 1e6:.2f} um of +-{data[1.0][1].max() * 1e6:.0f} um, by '
              'the two steps of Zhou 2021', drawing((1.0,)), same, {'error': data[1.0][3] * 1e6}),
        Entry('Zhou 2021', 'Figure 7', 'model at 10 to 60 Hz',
              'captures the rate dependence in a wide range, no number',
              f'rms error at most {worst:.2f} um; the damping alone widens the loops',
              drawing(FLAP_FREQUENCIES), same, {'error': worst}),
    ]  # fmt: skip


def flap_run(kind: str, wave: Waveform) -> LoopResult:
    """Return a run of Zhou 2021's actuator: by its own model and law, or by the fit (``ours``)."""
    own = kind.startswith('ours ')
    values = loops.flap_model()[1] if own else None
    kind = kind.removeprefix('ours ')
    return loops.run(
        wave, lambda: plants.flap_links(kind, values), loops.plant(loops.FLAP), loops.FLAP_LIMITS,
        loops.FLAP_DT,
    )  # fmt: skip


def flap_control(frequencies: Sequence[float], seconds: float) -> list[Entry]:
    """Return figures 9, 11 and 12 of Zhou 2021."""
    kinds = ('none', 'inverse', 'PID', 'ours inverse', 'ours compound')
    runs = {
        (kind, f): flap_run(kind, Sine(plants.FLAP_STROKE, f, seconds, ramp=0.3))
        for kind in kinds
        for f in frequencies
    }
    worst = {key: 1e6 * tracking_metrics(r, 0.6 * seconds).largest for key, r in runs.items()}
    names = {'none': 'none', 'inverse': '(8)', 'PID': '(8) and PID'}

    def part(f: float) -> slice:
        return slice(-round(2.0 / f / loops.FLAP_DT), None)

    def draw_9(figure: Figure) -> None:
        axis = figure.subplots()
        for kind in ('none', 'inverse'):
            r = runs[kind, 10.0]
            axis.plot(r.time[part(10.0)], r.error[part(10.0)] * 1e6, label=names[kind])
        finish(axis, 'time [s]', 'error [µm]', '10 Hz')

    def draw_11(figure: Figure) -> None:
        for axis, f in zip(panels(figure, len(frequencies)), frequencies, strict=True):
            r = runs['PID', f]
            axis.plot(r.reference[part(f)] * 1e6, r.displacement[part(f)] * 1e6, lw=0.8)
            finish(axis, 'desired [µm]', 'measured [µm]', f'{f:.0f} Hz')

    def draw_12(figure: Figure) -> None:
        for axis, f in zip(panels(figure, len(frequencies)), frequencies, strict=True):
            for kind, name in names.items():
                error = runs[kind, f].error[part(f)]
                time = np.arange(error.size) * loops.FLAP_DT * 1e3
                axis.plot(time, error * 1e6, lw=0.8, label=name)
            finish(axis, 'time [ms]', 'error [µm]', f'{f:.0f} Hz')

    def listed(*chosen: str) -> str:
        return ', '.join(
            f'{f:.0f} Hz ' + ' / '.join(f'{worst[kind, f]:.1f}' for kind in chosen)
            for f in frequencies
        )

    ten = [worst[kind, 10.0] for kind in ('none', 'inverse', 'PID')]
    why = (
        "the simulated actuator is of the model's own kind, so that only the error of the "
        'identification and that of the law are left; gains of the PID are ours, none are printed'
    )
    better = 'exact inverse of a joint fit, and cancellation of orders 1, 2, 3, 5 with PID: '
    return [
        Entry('Zhou 2021', 'Figure 9', 'feedforward at 10 Hz',
              '65 um without, about 14 um with it',
              f'{ten[0]:.0f} um without, {ten[1]:.1f} um with (8)', draw_9, why,
              {'none': ten[0], 'inverse': ten[1]},
              f'exact inverse {worst["ours inverse", 10.0]:.1f} um'),
        Entry('Zhou 2021', 'Figure 11', 'compound control, 10 to 60 Hz', 'straight lines',
              'straight lines, largest error '
              f'{max(worst["PID", f] for f in frequencies):.1f} um', draw_11, why),
        Entry('Zhou 2021', 'Figure 12', 'errors without, with feedforward, with compound control',
              'largest at 10 Hz 65, 14 and 9 um; other frequencies without numbers',
              'largest errors without / (8) / (8) and PID [um]: '
              + listed('none', 'inverse', 'PID'), draw_12, why,
              {'compound': max(worst['PID', f] for f in frequencies)},
              better + listed('ours inverse', 'ours compound')),
    ]  # fmt: skip


def flap_composites(seconds: float) -> Entry:
    """Return figure 13 of Zhou 2021."""
    runs = {}
    for kind in ('composite_zhou2021_low', 'composite_zhou2021_high'):
        spec = {'kind': kind, 'amplitude': plants.FLAP_STROKE, 'duration': seconds, 'ramp': 0.3}
        for chain in ('none', 'inverse', 'PID', 'ours inverse'):
            runs[kind, chain] = flap_run(chain, from_spec(spec))
    worst = {key: 1e6 * float(np.abs(r.error[r.error.size // 2 :]).max()) for key, r in
             runs.items()}  # fmt: skip

    def draw(figure: Figure) -> None:
        kinds = ('composite_zhou2021_low', 'composite_zhou2021_high')
        for axis, kind in zip(figure.subplots(1, 2), kinds, strict=True):
            for chain, name in (('none', 'none'), ('inverse', '(8)'), ('PID', '(8) and PID')):
                r = runs[kind, chain]
                axis.plot(r.time[-1000:], r.error[-1000:] * 1e6, lw=0.8, label=name)
            finish(axis, 'time [s]', 'error [µm]', kind)

    low, high = 'composite_zhou2021_low', 'composite_zhou2021_high'
    return Entry(
        'Zhou 2021', 'Figure 13', 'sums of three sinusoids',
        'errors reduced dramatically, no numbers',
        f'20/30/40 Hz {worst[low, "none"]:.0f} -> {worst[low, "inverse"]:.1f} -> '
        f'{worst[low, "PID"]:.1f} um ((8), (8) and PID); 40/50/60 Hz '
        f'{worst[high, "none"]:.0f} -> {worst[high, "inverse"]:.1f} -> {worst[high, "PID"]:.1f}',
        draw, 'amplitudes and phases of the components are not printed',
        {'low': worst[low, 'PID'] / worst[low, 'none'],
         'high': worst[high, 'PID'] / worst[high, 'none']},
        f'exact inverse {worst[low, "ours inverse"]:.1f} and {worst[high, "ours inverse"]:.1f} um',
    )  # fmt: skip


def stage_reason(name: str, pid: float, worst: Mapping[str, float]) -> str:
    """Return what differs from Fang 2019, and what its fuzzy rules gain over plain PID."""
    plain, fuzzy = worst['inverse + PID'], worst['inverse + fuzzy PID']
    gain = 'helps' if fuzzy < 0.95 * plain else 'is no better' if fuzzy > plain else 'helps little'
    reason = (
        'law, rule table and all gains but KD = 120 (read as V s/m) of Fang 2019 are missing from '
        "its text. Only the compensator is the paper's here: the inverses are of two models of "
        'this project, identified by least squares, not of the modified model by particle swarm '
        'of figure 4. The encoder is assumed to have 5 nm steps and 3 nm noise. Beside plain PID '
        f'of the same base gains, fuzzy PID {gain} ({fuzzy:.3f} against {plain:.3f} um)'
    )
    if name == 'composite':
        reason += (
            '. The terms of the reference are not printed: 1, 5 and 10 Hz with 3, 1.8 and 1.2 um '
            f'are used, which the PID here follows {pid / worst["PID"]:.0f} times better than the '
            'PID of the paper follows its own; the switch takes it for a reference of 1 Hz'
        )
    return reason


def stage_figures(names: Sequence[str]) -> list[Entry]:
    """Return figures 7 to 11 of Fang 2019."""
    found = []
    for number, (name, spec, pid, compound) in enumerate(plants.FANG, start=7):
        if name not in names:
            continue
        wave = from_spec({**spec, 'duration': 12.0, 'offset': 9e-6, 'ramp': 1.0})
        runs = {}
        for kind in plants.STAGE_KINDS:

            def links(kind: str = kind) -> list[Link]:
                return plants.stage_links(kind)

            runs[kind] = loops.run(wave, links, loops.plant(loops.STAGE), loops.STAGE_LIMITS,
                                   loops.STAGE_DT)  # fmt: skip
        worst = {k: 1e6 * tracking_metrics(r, 6.0).largest for k, r in runs.items()}

        def draw(figure: Figure, runs: dict[str, LoopResult] = runs) -> None:
            axis = figure.subplots()
            for kind in ('PID', 'switched inverse + fuzzy PID'):
                r = runs[kind]
                axis.plot(r.time[6000:], r.error[6000:] * 1e6, lw=0.8, label=kind)
            finish(axis, 'time [s]', 'error [µm]')

        ours = worst['switched inverse + fuzzy PID']
        others = ', '.join(f'{k} {worst[k]:.3f}' for k in plants.STAGE_KINDS[1:5])
        wins = 'the PID of the paper is better than this one' if worst['PID'] > pid else ''
        found.append(
            Entry('Fang 2019', f'Figure {number}', name,
                  f'largest error {pid} um with PID, {compound} um with inverse and fuzzy PID',
                  f'{worst["PID"]:.3f} um with PID, {ours:.3f} um with the inverse switched at 1 '
                  'Hz and fuzzy PID' + (f'; {wins}' if wins else ''), draw,
                  stage_reason(name, pid, worst),
                  {'PID': worst['PID'], 'compound': ours, 'paper': compound,
                   'inverse': worst['inverse']},
                  f'largest errors [um]: {others}')
        )  # fmt: skip
    return found


def flap_entries(quick: bool = False) -> list[Entry]:
    """Return every figure and table of Zhou 2021 that is reproduced."""
    if quick:
        return [flap_table(), *flap_models(), *flap_control((10.0,), 1.0)]
    return [
        flap_table(),
        *flap_models(),
        *flap_control(FLAP_FREQUENCIES, 4.0),
        flap_composites(2.0),
    ]


def stage_entries(quick: bool = False) -> list[Entry]:
    """Return figures 7 to 11 of Fang 2019."""
    return stage_figures(['4 um, 5 Hz'] if quick else [row[0] for row in plants.FANG])
