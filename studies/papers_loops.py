"""The loops that the papers show of actuators and models before they control anything."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.identification.identify import Identification, identify
from piezo_hysteresis.models import named
from piezo_hysteresis.records import Record
from studies import closed_loops as loops
from studies import papers_bimorph as bimorph
from studies.papers_page import Draw, Entry, finish, loop, panels

_LOOPS = 3.0
"""Seconds of a record of the bimorph; the last periods are drawn."""

# Like those of Tatebatake 2017, chosen to show the shape: its RLS finds no loop in the basic model
# at 1 Hz.
_FICTITIOUS = {'A1': 170e-6, 'A': 60e-6, 'beta': 2.0, 'gamma': 0.5}


def drawn(curves: Mapping[str, tuple[FloatArray, FloatArray]]) -> Draw:
    """Return a drawing of loops, each in a panel of its own."""

    def draw(figure: Figure) -> None:
        for axis, (title, (u, y)) in zip(panels(figure, len(curves)), curves.items(), strict=True):
            loop(axis, u, y, '')
            axis.set_title(title)

    return draw


def together(curves: Mapping[str, tuple[FloatArray, FloatArray]]) -> Draw:
    """Return a drawing of loops over one another."""

    def draw(figure: Figure) -> None:
        axis = figure.subplots()
        for label, (u, y) in curves.items():
            loop(axis, u, y, label)
        finish(axis, 'input [V]', 'displacement [µm]')

    return draw


def last(record: Record, periods: float = 2.0) -> tuple[FloatArray, FloatArray]:
    """Return the last periods of a record."""
    part = slice(-round(periods / (record.info.frequency * record.dt)), None)
    return record.voltage[part], record.displacement[part]


def width(curve: tuple[FloatArray, FloatArray]) -> float:
    """Return the widest opening of a loop as a percentage of its height."""
    u, y = curve
    middle = 0.5 * (u.max() + u.min())
    near = np.abs(u - middle) < 0.06 * np.ptp(u)
    way = np.gradient(u)
    gap = abs(float(y[near & (way > 0)].mean() - y[near & (way < 0)].mean()))
    return 100.0 * gap / float(np.ptp(y))


def modelled(frequency: float, kind: str) -> tuple[FloatArray, FloatArray]:
    """Return a loop of a model of Fujii 2018 or Tatebatake 2017."""
    each = loops.bimorph_record(frequency, _LOOPS)
    if kind == 'extended':
        answer = bimorph.rls(frequency, 0, 20.0).free_run(each.voltage)
    else:
        model = named('classical_euler' if kind == 'basic' else 'modified_euler')
        values = {**_FICTITIOUS, 'A0': 0.0 if kind == 'basic' else 0.1 * _FICTITIOUS['A']}
        answer = model.respond(each.voltage, model.pack(values), bimorph.DT)
    part = slice(-round(2.0 / (frequency * bimorph.DT)), None)
    return each.voltage[part], answer[part]


def bimorph_loops() -> list[Entry]:
    """Return the first figures of Fujii 2018 and Tatebatake 2017."""
    seen = {f: last(loops.bimorph_record(f, _LOOPS)) for f in (1.0, 2.0, 30.0, 35.0)}
    centre = 1e6 * float(0.5 * (seen[1.0][1].max() + seen[1.0][1].min()))
    lag = bimorph.phase_difference(
        loops.bimorph_record(35.0).displacement, loops.bimorph_record(35.0).voltage, 35.0
    )
    basic, moved = modelled(1.0, 'basic'), modelled(1.0, 'modified')
    smooth = modelled(30.0, 'extended')
    shift = 1e6 * float(np.mean(moved[1]) - np.mean(basic[1]))
    fictitious = 'parameters fictitious, as in the paper'
    ours = 'with identified parameters; those of the paper are fictitious'
    return [
        Entry('Fujii 2018', 'Figure 2', 'loop at a low frequency', 'off-centre, not symmetric',
              f'centre of the loop at {centre:+.1f} um, {width(seen[1.0]):.0f} % open',
              drawn({'1 Hz': seen[1.0]}), numbers={'centre': centre}),
        Entry('Fujii 2018', 'Figure 3', 'loop at 35 Hz', 'smooth at the tips, the output lags',
              f'lag {-lag:.1f} degrees, {width(seen[35.0]):.0f} % open',
              drawn({'35 Hz': seen[35.0]}),
              numbers={'lag': -lag}),
        Entry('Fujii 2018', 'Figure 4', 'response of the extended model', 'a smooth, rounded loop',
              f'rounded, {width(smooth):.0f} % open at 30 Hz', drawn({'30 Hz': smooth}), ours),
        Entry('Tatebatake 2017', 'Figure 1', 'response of the basic model',
              'symmetric, pointed loop',
              f'mean {1e6 * np.mean(basic[1]):+.2f} um, {width(basic):.0f} % open',
              drawn({'basic, 1 Hz': basic}), fictitious),
        Entry('Tatebatake 2017', 'Figure 2', 'observed loop', 'off-centre, not symmetric',
              f'centre of the loop at {centre:+.1f} um', drawn({'1 Hz': seen[1.0]})),
        Entry('Tatebatake 2017', 'Figure 3', 'response of the modified model', 'off-centre',
              f'the mean moves by {shift:+.2f} um with A0 = A / 10', drawn({'modified': moved}),
              fictitious),
        Entry('Tatebatake 2017', 'Figure 5', 'response of the extended model',
              'off-centre and rounded',
              f'rounded, {width(smooth):.0f} % open at 30 Hz', drawn({'30 Hz': smooth}), ours),
        Entry('Tatebatake 2017', 'Figure 6', 'actuator at 2 Hz', 'pointed tips',
              f'{width(seen[2.0]):.0f} % open', drawn({'2 Hz': seen[2.0]})),
        Entry('Tatebatake 2017', 'Figure 7', 'actuator at a higher frequency',
              'rounded tips, wider',
              f'{width(seen[30.0]):.0f} % open at 30 Hz', drawn({'30 Hz': seen[30.0]})),
        Entry('Tatebatake 2017', 'Figure 8', 'extended model at several frequencies',
              'loops that change with the frequency',
              ', '.join(f'{f:.0f} Hz {width(modelled(f, "extended")):.0f} % open'
                        for f in (2.0, 10.0, 30.0)),
              drawn({f'{f:.0f} Hz': modelled(f, 'extended') for f in (2.0, 10.0, 30.0)}), ours),
    ]  # fmt: skip


def flap_loops() -> list[Entry]:
    """Return figure 3 of Zhou 2021."""

    def measured(frequency: float) -> tuple[FloatArray, FloatArray]:
        seconds = max(0.5, 3.0 / frequency)
        time = np.arange(round(seconds / loops.FLAP_DT)) * loops.FLAP_DT
        voltage = 60.0 * np.sin(2 * np.pi * frequency * time)
        y = loops.plant(loops.FLAP).run(voltage)
        part = slice(-round(1.0 / frequency / loops.FLAP_DT), None)
        return voltage[part], y[part]

    seen = {f: measured(f) for f in (1.0, 5.0, 10.0, 20.0, 40.0, 60.0)}
    stroke = {f: 1e6 * float(np.ptp(y)) / 2 for f, (_, y) in seen.items()}
    return [
        Entry('Zhou 2021', 'Figure 3', 'loops from 1 to 60 Hz',
              'alike up to 10 Hz, much wider above; the stroke hardly changes',
              'opening ' + ', '.join(f'{f:.0f} Hz {width(each):.0f} %' for f, each in seen.items())
              + f'; stroke +-{stroke[1.0]:.0f} um at 1 Hz, +-{stroke[60.0]:.0f} um at 60 Hz',
              together({f'{f:.0f} Hz': each for f, each in seen.items()}),
              'the printed damping alone widens the loop from 1 to 10 Hz already',
              {'1': width(seen[1.0]), '60': width(seen[60.0])}),
    ]  # fmt: skip


@functools.cache
def stage_by_fang(evaluations: int, swarms: int) -> tuple[Identification, ...]:
    """Return Fang 2019's identification from sines up to 10 Hz, by so many swarms, best first."""
    records = loops.stage_records((0.5, 1.0, 5.0, 10.0))
    found = [
        identify(
            records,
            named('rate_dependent'),
            method='fang2019',
            seed=seed,
            max_evaluations=evaluations,
            begins='settled',
        )
        for seed in range(1, swarms + 1)
    ]
    return tuple(sorted(found, key=lambda each: each.history[-1]))


def worst_of(found: Identification) -> float:
    """Return the largest error of a record, as a percentage of what moves."""
    return max(record.nrmse_percent for record in found.records)


def stage_loops(quick: bool) -> list[Entry]:
    """Return figures 3 and 4 and table 1 of Fang 2019."""
    records: Sequence[Record] = loops.stage_records((0.5, 1.0, 5.0, 10.0))
    seen = {each.info.frequency: last(each, 1.0) for each in records}
    swarms = stage_by_fang(600, 1) if quick else stage_by_fang(6000, 6)
    found, moving = swarms[0], sum(not each.converged for each in swarms)
    wide = ', '.join(f'{f:g} Hz {width(each):.1f} %' for f, each in seen.items())
    high = ', '.join(f'{f:g} Hz {1e6 * np.ptp(y):.2f}' for f, (_, y) in seen.items())
    errors = ', '.join(f'{r.record} {r.nrmse_percent:.1f} %' for r in found.records)
    values = ', '.join(f'{k} {v:.3g}' for k, v in found.values.items())
    model = found.model

    def draw(figure: Figure) -> None:
        for axis, each in zip(panels(figure, len(records)), records, strict=True):
            u = np.concatenate([each.voltage, each.voltage])
            y = model.respond(u, model.pack(found.values), each.dt)
            part = slice(-round(1.0 / (each.info.frequency * each.dt)), None)
            loop(axis, *last(each, 1.0), 'measured')
            shift = float(np.mean(last(each, 1.0)[1]) - np.mean(y[part]))
            loop(axis, u[part], y[part] + shift, 'model', '--')
            axis.set_title(f'{each.info.frequency:g} Hz')

    why = (
        'the law is missing from the text; ours is a reading of its words, and the preset is made '
        'of another rate-dependent hysteresis'
    )
    return [
        Entry('Fang 2019', 'Figure 3', 'loops from 0.5 to 10 Hz',
              'hardly change up to 1 Hz; above wider and lower',
              f'opening {wide}; height [um] {high}',
              together({f'{f:g} Hz': each for f, each in seen.items()})),
        Entry('Fang 2019', 'Figure 4', 'modified model and measurement',
              'good agreement, no number',
              f'errors as shares of what moves: {errors}, by the best of {len(swarms)} modified '
              f'swarms (fang2019); the largest error of the others is up to '
              f'{max(map(worst_of, swarms)):.1f} %, and {moving} had not come to rest', draw, why,
              {'worst': worst_of(found)}),
        Entry('Fang 2019', 'Table 1', 'parameters of the modified model', 'missing from the text',
              values, draw, why),
    ]  # fmt: skip
