"""The suite that this benchmark comes with, by `discover` of its documented Python interface.

It gets the records, the name of the baseline, whether records begin at rest at 0 V and, where
there is one, the reference, as CSV files. It competes with about twenty effects of its own; those
that are not on the list count as `unknown`. Every worker asks one process of the suite's
interpreter `PIEZO_PYTHON` (``python``), so that its modules are imported once. The probabilities
of its verdict are calibrated as those of every entry (`calibrated`). The prediction is the free
run of the found model, shifted as it fits the records best: a model of the suite may be read at
another time within a sample.
"""

from __future__ import annotations

import json
import os
import select
import shlex
import subprocess
import tempfile
from collections.abc import Mapping
from functools import lru_cache
from multiprocessing.util import Finalize
from pathlib import Path
from typing import Any

import numpy as np

from piezo_benchmark.effects import EFFECTS
from piezo_benchmark.entries.calibrated import Statement, answered, kind_of
from piezo_benchmark.fits import centred
from piezo_benchmark.tasks import NONE, UNKNOWN, Answer, Task, save_csv
from piezo_benchmark.worlds import Array

BASELINES = {
    'bouc_wen': 'classical',
    'bouc_wen_mode': 'bouc_wen_mode',
    'play_bank': 'prandtl_ishlinskii',
}
#: Names of the suite in the words of the list.
NAMES = {
    'transport_delay': 'transport_delay',
    'amplifier_lag': 'amplifier_lag',
    'creep': 'creep',
    'resonance': 'mode',
    'electrostriction': 'square_law',
    'saturation': 'saturation',
    'sensor_nonlinearity': 'sensor_curve',
    'mains_hum': 'tone',
    'drift': 'drift',
    'gain_decay': 'falling_gain',
    'friction': 'friction',
}
#: Other values of the baseline than on the reference: the list has no such effect.
SHIFT = 'parameter_shift'
#: Parameters in the words of the list, where they are the same numbers.
PARAMETERS = {
    'transport_delay': {'delay': 'delay'},
    'amplifier_lag': {'lag_time': 'lag_time'},
    'creep': {'creep_share': 'share', 'creep_time': 'time'},
    'mode': {
        'resonance_frequency': 'frequency',
        'resonance_damping': 'damping',
        'resonance_share': 'share',
    },
    'tone': {'hum_frequency': 'frequency'},
}
#: Time limit of a search, the default of `piezo discover`, and of an answer [s].
TIME_LIMIT, SECONDS = 60.0, 180.0
_DISCOVERY = """
import json, os, sys
import numpy as np
import piezo_hysteresis as ph
from scipy.interpolate import CubicSpline

answers = os.fdopen(os.dup(1), 'w')
os.dup2(2, 1)


def free_runs(model, table, dt):
    held = np.vstack([table, table[-1:], table[-1:]])
    ticks = dt * np.arange(len(held))
    # the model states how much later than its convention the records were read
    read = ticks[: len(table)] + model.sampling_offset
    return np.array([CubicSpline(ticks, model.simulate(u, dt))(read) for u in held.T]).T


for line in sys.stdin:
    task = json.loads(line)
    try:
        before = ph.load(task['reference']) if task['reference'] else ()
        records, options = ph.load(task['records']), task['options']
        found = ph.discover(records, task['baseline'], reference=before, **options)
        run = free_runs(found.model_file(), np.load(task['voltages']), task['dt'])
        np.save(task['run'], run)
        answer = {'verdict': found.verdict.to_dict()}
    except Exception as error:
        answer = {'error': f'{type(error).__name__}: {error}'}
    answers.write(json.dumps(answer) + chr(10))
    answers.flush()
"""


class Process:
    """A process of the suite that answers one task after another."""

    def __init__(self) -> None:
        python = shlex.split(os.environ.get('PIEZO_PYTHON', 'python'))
        self._process = subprocess.Popen(
            [*python, '-W', 'ignore', '-c', _DISCOVERY],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        self._pipes = self._process.stdin, self._process.stdout

    def ask(self, task: Mapping[str, object]) -> dict[str, Any]:
        """Return the answer to one task.

        Raises
        ------
        RuntimeError
            If the suite raises an error, ends, or needs more than `SECONDS`.
        """
        question, answers = self._pipes
        if question is None or answers is None:
            raise RuntimeError('the process has no pipes')
        try:
            question.write(json.dumps(task).encode() + b'\n')
            question.flush()
        except BrokenPipeError:
            self.close()
            raise RuntimeError('the interpreter of the suite does not start') from None
        if not select.select([answers], [], [], SECONDS)[0]:
            self.close()
            raise RuntimeError(f'no answer within {SECONDS:g} s')
        try:
            found: dict[str, Any] = json.loads(answers.readline())
        except ValueError:
            self.close()
            raise RuntimeError('the process of the suite ended without an answer') from None
        if 'error' in found:
            raise RuntimeError(found['error'])
        return found

    def close(self) -> None:
        """End the process; the next task begins another one."""
        _process.cache_clear()
        self._process.kill()
        self._process.wait()


@lru_cache(maxsize=1)
def _process() -> Process:
    begun = Process()
    Finalize(begun, begun.close, exitpriority=0)  # also where a worker of a pool ends
    return begun


def discovered(task: Task) -> tuple[dict[str, Any], Array]:
    """Return the verdict and the free run [m] on records and, after them, held-out voltages."""
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        files = save_csv(task, folder)
        both = np.concatenate([task.records.voltage, task.held_out.voltage], 1)
        np.save(folder / 'voltages.npy', both)
        asked = {
            'records': [str(file) for file in files['records']],
            'reference': [str(file) for file in files.get('reference', [])],
            'baseline': BASELINES[task.baseline.name],
            'voltages': str(folder / 'voltages.npy'),
            'dt': task.scale.dt,
            'options': {
                'begins': 'auto' if task.scale.moving else 'step',
                'time_limit': TIME_LIMIT,
            },
            'run': str(folder / 'run.npy'),
        }
        verdict: dict[str, Any] = _process().ask(asked)['verdict']
        return verdict, np.load(folder / 'run.npy')


def answer(task: Task) -> Answer:
    """Return the calibrated answer."""
    return answered('suite', task, statement(task))


def statement(task: Task) -> Statement:
    """Return what the verdict states.

    Raises
    ------
    RuntimeError
        If there is no verdict.
    """
    verdict, run = discovered(task)
    return stated(task, verdict, _fitting(task, run))


def stated(task: Task, verdict: Mapping[str, Any], prediction: Array | None = None) -> Statement:
    """Return a verdict in the words of the list."""
    named, left = verdict['effects'], bool(verdict['unexplained']['significant'])
    found = probabilities(verdict)
    kind = kind_of(max(found, key=lambda name: found[name]), left, task)
    if any(effect['name'] not in (*NAMES, SHIFT) for effect in named):
        kind = ('not on the list', *kind)
    others: dict[str, float] = {}
    doubted = [effect for effect in named for effect in effect['look_alikes']]
    doubted += [*verdict['suspects'], *(o for effect in named for o in effect['alternatives'])]
    for each in doubted:
        others[NAMES.get(each['name'], UNKNOWN)] = 1.0
    return Statement(kind, found, others, prediction, parameters(verdict))


def probabilities(verdict: Mapping[str, Any]) -> dict[str, float]:
    """Return probabilities of outcomes from a verdict.

    One effect has its probability and its alternatives have theirs. Of several, the two most
    probable ones on the list are a pair, and what speaks against the second goes to the first
    alone.
    """
    if verdict['verdict'] == 'none':
        return {NONE: 1.0}
    known = [effect for effect in verdict['effects'] if effect['name'] in NAMES]
    if not known:
        return {UNKNOWN: 1.0}
    first = known[0]
    found = _spread(first)
    if len(known) > 1:
        second = _spread(known[1])
        joint: dict[str, float] = {}
        for a, p in found.items():
            for b, q in second.items():
                key = a if a in (b, UNKNOWN) or b == UNKNOWN else '+'.join(sorted((a, b)))
                joint[key] = joint.get(key, 0.0) + p * q
            joint[a] = joint.get(a, 0.0) + p * max(1.0 - sum(second.values()), 0.0)
        found = joint
    return found


def _spread(effect: Mapping[str, Any]) -> dict[str, float]:
    found: dict[str, float] = {}
    for part in (each for each in (effect, *effect['alternatives']) if each['name'] != SHIFT):
        name = NAMES.get(part['name'], UNKNOWN)
        found[name] = found.get(name, 0.0) + float(part['probability'])
    total = sum(found.values())
    return {name: p / max(total, 1.0) for name, p in found.items()}


def parameters(verdict: Mapping[str, Any]) -> dict[str, dict[str, tuple[float, float]]]:
    """Return parameters that the list has as well."""
    found: dict[str, dict[str, tuple[float, float]]] = {}
    for effect in verdict['effects']:
        name = NAMES.get(effect['name'], '')
        for theirs, ours in PARAMETERS.get(name, {}).items():
            number = effect['parameters'].get(theirs)
            if number and number['std'] and ours in EFFECTS[name].units:
                value, deviation = float(number['value']), float(number['std'])
                found.setdefault(name, {})[ours] = value, deviation
    return found


def _fitting(task: Task, run: Array) -> Array:
    """Return the held-out part of a free run, shifted as its other part fits the records."""
    count = task.records.voltage.shape[1]
    target = centred(task.measured, task.warm_up)

    def error(shift: float) -> float:
        moved = _shifted(run[:, :count], shift)
        return float(np.sum((target - centred(moved, task.warm_up)) ** 2))

    coarse = np.arange(-2.0, 3.01, 0.25)
    first = float(coarse[int(np.argmin([error(s) for s in coarse]))])
    fine = first + np.linspace(-0.25, 0.25, 21)
    best = float(fine[int(np.argmin([error(s) for s in fine]))])
    return _shifted(run[:, count:], best)


def _shifted(run: Array, samples: float) -> Array:
    """Return responses that many samples later."""
    k = np.arange(run.shape[0]) - samples
    return np.array([np.interp(k, np.arange(run.shape[0]), y) for y in run.T]).T
