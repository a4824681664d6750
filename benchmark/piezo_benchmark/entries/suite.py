"""The suite that this benchmark comes with, by its public command `piezo discover` on CSV files.

It gets the records, the name of the baseline and, where there is one, the reference, and competes
with about twenty effects of its own; those that are not on the list count as `unknown`. A variant
decides between two names of the list that are one of the suite's. `none` and `unknown` have no
probability in its verdict and get 0.9 and 0.7. The prediction is the free run of its `model.yaml`
by the documented Python functions, in a process of their own. The command is `PIEZO_COMMAND`
(``piezo`` by default), the interpreter `PIEZO_PYTHON` (``python``).
"""

from __future__ import annotations

import json
import os
import shlex
import subprocess
import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from piezo_benchmark.effects import EFFECTS
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
SECONDS = 120.0  # of one command, after which the answer is missing
SURE_OF_NONE, SURE_OF_UNKNOWN = 0.9, 0.7
_PREDICT = """
import sys
import numpy as np
import piezo_hysteresis as ph
from scipy.interpolate import CubicSpline
model_file, voltages, dt, out = sys.argv[1:]
model, table, dt = ph.Model.load(model_file), np.load(voltages), float(dt)
held = np.vstack([table, table[-1:], table[-1:]])
ticks = dt * np.arange(len(held))
# the file says how much later than its convention the records were read
read = ticks[: len(table)] + model.sampling_offset
columns = [CubicSpline(ticks, model.simulate(u, dt))(read) for u in held.T]
np.save(out, np.array(columns).T)
"""


def answer(task: Task) -> Answer:
    """Return the answer of the verdict.

    Raises
    ------
    RuntimeError
        With the last line that the command wrote, if it fails.
    """
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        files = save_csv(task, folder)
        command = [*shlex.split(os.environ.get('PIEZO_COMMAND', 'piezo')), 'discover', '-q']
        command += [str(file) for file in files['records']]
        command += ['--baseline', BASELINES[task.baseline.name], '--out', str(folder / 'out')]
        command += ['--workers', '1', '--seed', '0', '--time-limit', '0']
        if 'reference' in files:
            command += ['--reference', *(str(file) for file in files['reference'])]
        _run(command)
        verdict = json.loads((folder / 'out' / 'verdict.json').read_text(encoding='utf-8'))
        prediction = _prediction(task, folder, verdict)
    return Answer(probabilities(verdict), prediction=prediction, parameters=parameters(verdict))


def _run(command: list[str]) -> None:
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=SECONDS, check=False
        )
    except subprocess.TimeoutExpired:  # its own text names folders of the machine
        raise RuntimeError(f'no answer within {SECONDS:g} s') from None
    if done.returncode:
        said = (done.stderr or done.stdout).strip().splitlines() or ['no message']
        raise RuntimeError(said[-1])


def probabilities(verdict: Mapping[str, object]) -> dict[str, float]:
    """Return probabilities of outcomes from a verdict.

    One effect has its probability and its alternatives have theirs. Of several, the two most
    probable ones on the list are a pair, and what speaks against the second goes to the first
    alone.
    """
    if verdict['verdict'] == 'none':
        return {NONE: SURE_OF_NONE}
    named = verdict['effects']
    if verdict['verdict'] == 'unknown' or not isinstance(named, list) or not named:
        return {UNKNOWN: SURE_OF_UNKNOWN}
    known = [e for e in named if e['name'] in NAMES]
    if not known:
        return {UNKNOWN: SURE_OF_UNKNOWN}
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


def _spread(effect: Mapping[str, object]) -> dict[str, float]:
    found: dict[str, float] = {}
    others = effect['alternatives']
    for part in (effect, *(others if isinstance(others, list) else ())):
        name = NAMES.get(str(part['name']), UNKNOWN)
        found[name] = found.get(name, 0.0) + float(str(part['probability']))
    total = sum(found.values())
    return {name: p / max(total, 1.0) for name, p in found.items()}


def parameters(verdict: Mapping[str, object]) -> dict[str, dict[str, tuple[float, float]]]:
    """Return parameters that the list has as well."""
    found: dict[str, dict[str, tuple[float, float]]] = {}
    named = verdict['effects']
    for effect in named if isinstance(named, list) else ():
        name = NAMES.get(effect['name'], '')
        for theirs, ours in PARAMETERS.get(name, {}).items():
            said = effect['parameters'].get(theirs)
            if said and said['std'] and ours in EFFECTS[name].units:
                found.setdefault(name, {})[ours] = float(said['value']), float(said['std'])
    return found


def _prediction(task: Task, folder: Path, verdict: Mapping[str, object]) -> Array | None:
    """Return the free run of the found model, shifted as it fits the records best."""
    model = folder / 'out' / 'model.yaml'
    if not model.exists():
        return None
    count = task.records.voltage.shape[1]
    both = np.concatenate([task.records.voltage, task.held_out.voltage], 1)
    np.save(folder / 'voltages.npy', both)
    python = shlex.split(os.environ.get('PIEZO_PYTHON', 'python'))
    (folder / 'predict.py').write_text(_PREDICT, encoding='utf-8')
    given = [str(model), str(folder / 'voltages.npy'), repr(task.scale.dt)]
    _run([*python, str(folder / 'predict.py'), *given, str(folder / 'run.npy')])
    run = np.load(folder / 'run.npy')
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
