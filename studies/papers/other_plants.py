"""The methods of Zhou 2021 and Xiao 2014 on actuators that are not their own model.

The simulated actuators of these papers have the structure of the papers' models. Here they carry a
load, or have another hysteresis or damping, and the models are identified from their records.

    python studies/papers/other_plants.py
"""

from __future__ import annotations

import argparse
import functools
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

if not __package__:
    sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import numpy as np

from bench.quick import parsed
from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.compensation.feedback.pid import Pid, PidGains
from piezo_hysteresis.compensation.inverses.inverse_choice import inverse_for
from piezo_hysteresis.compensation.inverses.physical import SlopeSelectedInverse
from piezo_hysteresis.compensation.link import Link
from piezo_hysteresis.compensation.offline_loop import tracking_metrics
from piezo_hysteresis.identification.identify import identify
from piezo_hysteresis.identification.inverse_fit import row_of, selector_table
from piezo_hysteresis.models import named
from piezo_hysteresis.records import Record, RecordInfo
from piezo_hysteresis.waveforms import Sine, Triangle, Waveform
from piezo_hysteresis.waveforms.sine import SineSum
from studies.papers import flap, runs, stack

Changes = tuple[tuple[str, float | bool], ...]

#: Actuators of a flap, by what differs from the model of Zhou 2021.
FLAPS: dict[str, Changes] = {
    'as the model': (),
    'under load': (('effects.load', True),),
    'exponent 2': (('effects.hysteresis_exponent', True),),
    'damping by the speed squared': (('effects.amplitude_damping', True),),
    'Preisach hysteresis': (('effects.bouc_wen', False), ('effects.preisach', True)),
}
#: Stacks, by what differs from a Bouc-Wen hysteresis and a mode.
STACKS: dict[str, Changes] = {
    'as the model': (),
    'Preisach hysteresis': (('effects.bouc_wen', False), ('effects.preisach', True)),
}


@functools.cache
def flap_errors(changes: Changes, *, known: bool, quick: bool = False) -> dict[str, float]:
    """Return the largest errors at 10 Hz and ±200 µm on a changed flap actuator [µm]."""
    overrides = dict(changes) if known else {}
    records = [
        _record(flap.NAME, Sine(60.0, f, s), flap.DT, f, 60.0, 0.5 * s, overrides)
        for f, s in ((1.0, 3.0), (30.0, 0.4))
    ]
    held = {'A1': 5.5e-6, 'stiffness': 8e5, 'mass': 8e5 / (2 * np.pi * 628.0) ** 2}
    if known and ('effects.load', True) in changes:
        # d, k and m are measured on the loaded actuator, as the paper measures them by (5)
        held = _loaded(held)
    found = identify(
        records, named('second_order').hold(**held), method='zhou2021', seed=1,
        max_evaluations=400 if quick else 4000,
    )  # fmt: skip
    wave = Sine(flap.STROKE, 10.0, 1.0 if quick else 4.0, ramp=0.3)

    def links(*, feedback: bool) -> list[Link]:
        chain: list[Link] = [
            inverse_for(
                found.chain, found.values, flap.DT, limits=flap.LIMITS, scale=60.0, law='zhou2021'
            )
        ]
        if feedback:
            chain.append(Pid(PidGains(1e5, 5e7), flap.DT, limits=flap.LIMITS))
        return chain

    errors = {}
    for name, chain in (
        ('none', lambda: [runs.Straight(flap.STRAIGHT)]),
        ('(8)', lambda: links(feedback=False)),
        ('(8) and PID', lambda: links(feedback=True)),
    ):
        plant = runs.plant(flap.NAME, overrides=dict(changes))
        run = runs.run(wave, chain, plant, flap.LIMITS, flap.DT)
        errors[name] = 1e6 * tracking_metrics(run, 0.6 * wave.duration).largest
    return errors


def _loaded(held: Mapping[str, float]) -> dict[str, float]:
    """Return the known values of an actuator with the mass and the spring of the preset."""
    spring, mass = 1e5, 0.05
    stiffness = held['stiffness'] + spring
    return {
        'A1': held['A1'] * held['stiffness'] / stiffness,
        'stiffness': stiffness,
        'mass': held['mass'] + mass,
    }


def _record(
    name: str,
    wave: Sine | Triangle,
    dt: float,
    frequency: float,
    amplitude: float,
    warm_up: float,
    overrides: Mapping[str, float | bool],
) -> Record:
    voltage = wave.sample(np.arange(round(wave.duration / dt), dtype=np.float64) * dt).value
    moved = runs.plant(name, overrides=overrides).run(voltage)
    info = RecordInfo(frequency=frequency, amplitude=amplitude, warm_up=warm_up)
    return Record(f'{frequency:g} Hz', dt, voltage, moved, info=info)


@functools.cache
def minor_loop_misfit(changes: Changes, quick: bool = False) -> dict[str, float]:
    """Return the rms errors of models of one 40 Hz triangle, on it and on minor loops [%].

    The minor loops are those of 10 Hz with 30 V and 70 Hz with 20 V about 50 V.
    """
    dt, overrides = stack.DT, dict(changes)
    wave = Triangle(50.0, 1.0, offset=50.0, frequency=40.0, phase=-0.5 * np.pi)
    major = _record(stack.NAME, wave, dt, 40.0, 50.0, 0.4, overrides)
    time = np.arange(10_000) * dt
    ramp = np.minimum(time / 0.1, 1.0)
    inner = 50.0 + 30.0 * np.sin(20.0 * np.pi * time) + 20.0 * np.sin(140.0 * np.pi * time)
    voltage = np.asarray(ramp * inner, np.float64)
    minor = Record('minor loops', dt, voltage, runs.plant(stack.NAME, overrides=overrides).run(
        voltage))  # fmt: skip
    found = {}
    swarm = identify(
        [major], named('classical'), method='xiao2014', seed=1,
        max_evaluations=300 if quick else 3000,
    )  # fmt: skip
    chain = identify([major], named('bouc_wen_mode+creep'))
    for name, model in (('swarm', swarm), ('chain', chain)):
        for what, record in (('major', major), ('minor', minor)):
            answer = model.chain.respond(record.voltage, model.chain.pack(model.values), dt)
            found[f'{name} {what}'] = _share(record.displacement[4000:], answer[4000:])
    return found


def _share(measured: FloatArray, modelled: FloatArray) -> float:
    error = measured - modelled
    moving = runs.rms(measured - measured.mean())
    return 100.0 * runs.rms(error - error.mean()) / moving


@functools.cache
def selector_errors(changes: Changes, quick: bool = False) -> dict[str, tuple[float, float]]:
    """Return rms and largest error of the selector [µm].

    At 10, 40 and 100 Hz over 30 µm, at 40 Hz over the middle 14 µm, and at minor loops, of 10 and
    70 Hz with 9 and 6 µm; the rows of the table are fitted from the actuator itself.
    """
    dt, overrides = stack.DT, dict(changes)
    rows = [
        _record(
            stack.NAME,
            Triangle(50.0, 1.0, offset=50.0, frequency=row[0], phase=-0.5 * np.pi),
            dt, row[0], 50.0, 0.4, overrides,
        )
        for row in (stack.TABLE_1[::9] if quick else stack.TABLE_1)
    ]  # fmt: skip
    table = selector_table([row_of(record) for record in rows])
    found = {}
    waves: dict[str, Waveform] = {f'{f:g} Hz': stack.reference(f) for f in (10.0, 40.0, 100.0)}
    waves['40 Hz, middle'] = Triangle(7e-6, 2.0, offset=15e-6, frequency=40.0, ramp=0.2)
    waves['40 Hz, full'] = Triangle(15e-6, 2.0, offset=15e-6, frequency=40.0, ramp=0.2)
    waves['minor loops'] = SineSum(
        15e-6, 2.0, 15e-6, 0.2, frequencies=(10.0, 70.0), weights=(0.6, 0.4), phases=(0.0, 0.0)
    )
    for name, wave in waves.items():
        plant = runs.plant(stack.NAME, overrides={**stack.AMPLIFIER, **overrides})
        run = runs.run(
            wave, lambda: [SlopeSelectedInverse(table, dt, limits=stack.LIMITS)], plant,
            stack.LIMITS, dt,
        )  # fmt: skip
        met = tracking_metrics(run, 1.2)
        found[name] = 1e6 * met.rms, 1e6 * met.largest
    return found


_ZHOU = """\
Largest errors at 10 Hz, ±200 µm [µm], on actuators that are not the model. "Before": the model is
that of the preset; "there": identified on the changed actuator, under load with d, k and m
measured under load.

| actuator | identified | without | (8) | (8) and PID | PID takes |
|---|---|---|---|---|---|
| paper | there | 65 | 14 | 9 | 36 % |
{rows}

The paper adds PID "to reduce the hysteresis further". Here it takes most where a load is not
identified, so that the feedforward misses the gain. Errors like the 14 and 9 µm of the paper come
out for a hysteresis that a Bouc-Wen model does not have, smaller ones for another exponent.
Damping by the speed squared hardly acts at 10 Hz, because the linear damping is above the critical
one. An inverse Preisach model, of which the paper says that it costs more, is not built here;
nothing is compared."""


def of_zhou(quick: bool = False) -> list[str]:
    """Return what the method of Zhou 2021 leaves on other actuators, as a section of its page."""
    rows = []
    for name, changes in list(FLAPS.items())[: 2 if quick else None]:
        for known in (True,) if not changes else (False, True):
            e = flap_errors(changes, known=known, quick=quick)
            share = 100 * (1 - e['(8) and PID'] / e['(8)'])
            rows.append(
                f'| {name} | {"there" if known else "before"} | {e["none"]:.0f} | {e["(8)"]:.1f} '
                f'| {e["(8) and PID"]:.1f} | {share:.0f} % |'
            )
    return _ZHOU.format(rows='\n'.join(rows)).split('\n')


_XIAO = """\
Errors of models of one 40 Hz triangle, on it and on minor loops (10 Hz with 30 V and 70 Hz with
20 V about 50 V), in % of the displacement:

| stack | swarm, triangle | swarm, minor loops | mode and creep, triangle | minor loops |
|---|---|---|---|---|
{misfits}

One triangle of the Preisach stack does not separate loop, mode and creep, of which `identify`
warns: two fits that miss it by 0.18 and 0.19 % miss the minor loops by 9 and by 14 %.

Errors of the selector, rms (largest) [µm]; the middle is 14 of the 30 µm, minor loops are 10 Hz
with 9 µm and 70 Hz with 6 µm:

| stack | {names} |
|---|{rule}
{errors}

The paper finds smaller errors in the middle of the range; that does not hold here. Minor loops
have larger errors than triangles up to 40 Hz with both stacks, of the model and of the selector,
whose rows describe whole loops.

Fitted by output error, the default of `identify`, to the displacement, the selector leaves {by}
µm rms at 10, 40 and 100 Hz: use `--method xiao2014` for its feedforward."""


def of_xiao(quick: bool = False) -> list[str]:
    """Return what the methods of Xiao 2014 leave on minor loops and other stacks."""
    stacks = list(STACKS.items())[: 1 if quick else None]
    names = list(selector_errors((), quick))
    misfits, errors = [], []
    for name, changes in stacks:
        misfit = minor_loop_misfit(changes, quick).values()
        misfits.append(f'| {name} | ' + ' | '.join(f'{each:.2g}' for each in misfit) + ' |')
        found = selector_errors(changes, quick).values()
        cells = ' | '.join(f'{rms:.2f} ({most:.2f})' for rms, most in found)
        errors.append(f'| {name} | {cells} |')
    return _XIAO.format(
        misfits='\n'.join(misfits), names=' | '.join(names), rule='---|' * len(names),
        errors='\n'.join(errors), by=', '.join(f'{each:.1f}' for each in by_output_error(quick)),
    ).split('\n')  # fmt: skip


@functools.cache
def by_output_error(quick: bool = False) -> tuple[float, ...]:
    """Return the rms errors at 10, 40 and 100 Hz of the selector by output error [µm]."""
    frequencies = (10.0, 40.0, 100.0)
    few: dict[str, Any] = {'max_evaluations': 20} if quick else {}
    found = identify([stack.record(f) for f in frequencies], named('inverse_selector'), **few)
    errors = []
    for f in frequencies:
        run = runs.run(
            stack.reference(f),
            lambda: [SlopeSelectedInverse(found.values, stack.DT, limits=stack.LIMITS)],
            stack.plant(), stack.LIMITS, stack.DT,
        )  # fmt: skip
        errors.append(1e6 * tracking_metrics(run, 1.2).rms)
    return tuple(errors)


SECTIONS = {'Zhou 2021': of_zhou, 'Xiao 2014': of_xiao}
"""Sections on other actuators, by paper."""


def main() -> int:
    """Print the sections."""
    parser = argparse.ArgumentParser(description=__doc__)
    asked = parsed(parser)
    for write in list(SECTIONS.values())[: 1 if asked.quick else None]:
        print('\n'.join(write(asked.quick)), flush=True)
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
