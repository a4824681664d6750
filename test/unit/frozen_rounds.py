"""Small actuators with one hidden effect, and the evaluators that judge candidates on them.

The fits of a search take most of its time, and its decisions almost none. So the candidates that
a search compared are kept in `frozen/rounds.json` with the values to which they were fitted, and
tests judge them again. After a change of what is compared, write the file anew:

    python test/unit/frozen_rounds.py
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.discovery.data.dataset import split
from piezo_hysteresis.discovery.data.tones import annotated
from piezo_hysteresis.discovery.selection.candidate_fit import (
    CandidateFit,
    ModelSpec,
    evaluated_on,
)
from piezo_hysteresis.discovery.selection.evaluator import Deadline, Evaluator
from piezo_hysteresis.discovery.selection.fixed_baseline_evaluator import FixedBaselineEvaluator
from piezo_hysteresis.discovery.selection.free_evaluator import FreeEvaluator
from piezo_hysteresis.discovery.selection.search import search
from piezo_hysteresis.discovery.selection.start import SearchOptions, held_data
from piezo_hysteresis.identification import identify
from piezo_hysteresis.identification.initial_conditions.revision import RecordAssumptions
from piezo_hysteresis.models import ModelFile, named
from piezo_hysteresis.records import Record, RecordInfo

FROZEN = Path(__file__).with_name('frozen')
DT = 2e-3

#: What is hidden, and the names that a search finds with the model's values held, or fitted.
HELD = {
    'nothing': (),
    'delay': ('transport_delay',),
    'lag': ('amplifier_lag',),
    'tone': ('mains_hum',),
    'drift': ('drift',),
    'gain': ('parameter_shift',),
}
FREE = {
    'nothing': (),
    'delay': ('transport_delay',),
    'tone': ('mains_hum',),
    'curve': ('sensor_nonlinearity',),
}


def plays(u: FloatArray) -> FloatArray:
    """Return a bank of plays with a curve behind it: no block of the suite [m]."""
    total = 0.7 * u
    for radius, weight in ((0.1, 0.2), (0.3, 0.15), (0.6, 0.1)):
        y, last = np.empty(u.size), 0.0
        for k, x in enumerate(u):
            last = max(x - radius, min(x + radius, last))
            y[k] = last
        total = total + weight * y
    return np.asarray(1.7e-5 * (total + 0.01 * total**2))


def loop(u: FloatArray) -> FloatArray:
    """Return what the baseline of the free search answers with its own numbers [m]."""
    model = named('classical')
    return model.respond(u, model.pack({**model.defaults(), 'offset': 0.0}), DT)


def hidden(y: FloatArray, kind: str, stroke: float) -> FloatArray:
    """Return a displacement with one effect; `stroke` is that of the first record [m]."""
    t = DT * np.arange(y.size)
    if kind == 'lag':
        share, late = 1.0 - np.exp(-DT / 8e-3), np.empty(y.size)
        last = y[0]
        for k, each in enumerate(y):
            last += share * (each - last)
            late[k] = last
        return late
    if kind == 'delay':
        return np.concatenate([np.full(2, y[0]), y[:-2]])
    added = {
        'tone': 0.015 * stroke * np.sin(2 * np.pi * 37.3 * t),
        'drift': 0.01 * stroke * t,
        'gain': 0.1 * y,
        'curve': 0.1 * y**2 / stroke,
    }
    return np.asarray(y + added.get(kind, 0.0))


def records(kind: str, actuator: Any, drives: Sequence[tuple[float, float]]) -> list[Record]:
    """Return measured sines of an actuator, from rest."""
    found: list[Record] = []
    stroke = 0.0
    for k, (frequency, amplitude) in enumerate(drives):
        u = amplitude * np.sin(2 * np.pi * frequency * DT * np.arange(2000))
        y = actuator(u)
        stroke = stroke or float(np.ptp(y))
        y = hidden(y, kind, stroke)
        noise = 5e-4 * stroke * np.random.default_rng([k, len(kind)]).standard_normal(u.size)
        info = RecordInfo(excitation='sine', frequency=frequency, amplitude=amplitude, warm_up=0.5)
        name = f'{kind} {frequency:g} Hz {amplitude:g} V'
        found.append(Record(name, DT, u, y + noise, info=info))
    return found


FITTED = ((1, 1.0), (5, 1.0), (1, 0.5))


def held(kind: str) -> tuple[Evaluator, CandidateFit]:
    """Return the evaluator of a model file, and the model as the file says."""
    given = ModelFile.load(FROZEN / 'plays.yaml')
    data = split(annotated(records(kind, plays, ((1, 1.0), (5, 1.0)))))
    how = SearchOptions(RecordAssumptions(), 1, 1, {}, Deadline())
    base, seen = held_data(data, given, how, searched=False)
    return FixedBaselineEvaluator(seen, 1, 1, base, given), base


def free(kind: str, content: Mapping[str, Any] | None = None) -> tuple[Evaluator, CandidateFit]:
    """Return the evaluator of a model by name, and the model fitted or as it was kept."""
    data = split(annotated(records(kind, loop, ((1, 1.0), (7, 1.0), (20, 0.5)))))
    evaluator = FreeEvaluator(data, 1, 1)
    model = named('classical')
    start = evaluated_on(ModelSpec(model, model.defaults()), evaluator.views)
    if content is None:
        return evaluator, evaluator.refit(start)
    return evaluator, unpacked(evaluator, start, content)


def packed(fit: CandidateFit) -> dict[str, Any]:
    """Return what a fit is made of, without its errors."""
    added = [[each.effect, each.variant, dict(each.names)] for each in fit.added]
    numbers = {'offset': fit.sampling_offset, 'parameters': fit.parameters}
    return {'values': fit.values, 'added': added, **numbers}


def unpacked(evaluator: Evaluator, base: CandidateFit, content: Mapping[str, Any]) -> CandidateFit:
    """Return a fit judged on the records of an evaluator."""
    spec: ModelSpec = base
    for effect, variant, names in content['added']:
        (candidate,) = (
            each
            for each in evaluator.candidates(spec)
            if (each.effect.name, each.effect.variant) == (effect, variant)
            and dict(each.renamed) == names
        )
        spec = spec.with_candidate(candidate, candidate.values(spec.values))
    moved = replace(spec, values=dict(content['values']), sampling_offset=content['offset'])
    return replace(evaluator.evaluated(moved), parameters=content['parameters'])


def frozen(evaluator: Evaluator, base: CandidateFit) -> dict[str, Any]:
    """Return what the rounds of a search compared: those that named something, and the last."""
    ended = search(evaluator, base, lambda fraction, words: None)
    every = [step.round for step in ended.steps]
    every += [] if ended.last is None else [ended.last]
    kept = [
        {
            'before': packed(each.before),
            'finalists': [packed(fit) for fit in each.finalists],
            'tried': each.tried,
        }
        for each in every
    ]
    names = [step.fit.effect for step in ended.steps]
    return {'base': packed(base), 'rounds': kept, 'names': names}


def main() -> None:
    """Write `frozen/rounds.json` and the model file of the held baseline."""
    fitted = identify(records('nothing', plays, FITTED), named('classical'))
    fitted.model.save(FROZEN / 'plays.yaml')
    found = {f'held {kind}': frozen(*held(kind)) for kind in HELD}
    found |= {f'free {kind}': frozen(*free(kind)) for kind in FREE}
    (FROZEN / 'rounds.json').write_text(json.dumps(found) + '\n', encoding='utf-8')
    for name, each in found.items():
        print(f'{name}: {each["names"]}, {len(each["rounds"])} rounds')


if __name__ == '__main__':
    main()
