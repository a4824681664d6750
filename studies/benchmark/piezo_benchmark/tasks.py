"""What an entry gets (`Task`), what it returns (`Answer`), what the examiner keeps (`Truth`)."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from piezo_benchmark import VERSION
from piezo_benchmark.effects import EFFECTS
from piezo_benchmark.worlds import Array, Scale, respond

#: Answers in addition to the names: nothing is missing; something is, and it is not on the list.
NONE, UNKNOWN = 'none', 'unknown'

QUESTIONS = (
    'Which effects of the list does the baseline miss? Probabilities of outcomes (a name, two '
    'names, none, unknown: something that is not on the list), or of classes of outcomes.\n'
    'What is the displacement on the held-out voltages? The zero of each record is free.\n'
    'What are the parameters of the effects that you name, and their standard deviations?'
)

CONVENTIONS = (
    'The voltage is held from sample to sample; the displacement is read at the end of each '
    'sample. Records begin at rest at 0 V; those in motion (scale.moving) are simulated from rest '
    'at their first voltage, and no score looks at their first warm_up samples.'
)

EQUATIONS = {
    'bouc_wen': (
        "y = gain u - loop h + offset; h' = u' - beta |u'| h - gamma u' |h|; h = 0 at the start"
    ),
    'bouc_wen_mode': (
        "x''/w^2 + 2 damping x'/w + x = gain u - loop h; y = x + offset; w = 2 pi frequency; "
        "h' = u' - beta |u'| h - gamma u' |h|; h = 0 at the start"
    ),
    'play_bank': (
        'y = w0 u + w1 p1 + ... + w9 p9 + offset; pj = max(u - rj, min(u + rj, pj)), rj = 0.1 j U'
    ),
}


def outcomes(names: Sequence[str] = tuple(EFFECTS)) -> list[str]:
    """Return every outcome that has a probability: names, pairs of names, none and unknown."""
    pairs = ['+'.join(sorted(pair)) for pair in combinations(names, 2)]
    return [*names, *pairs, NONE, UNKNOWN]


@dataclass(frozen=True)
class Records:
    """Records of equal length.

    Attributes
    ----------
    names : tuple of str
    voltage : (samples, records) [V]
    displacement : (samples, records) [m], or None where it is to be predicted
    free_run : (samples, records) [m]
        Of the baseline with the values given.
    """

    names: tuple[str, ...]
    voltage: Array
    displacement: Array | None
    free_run: Array


@dataclass(frozen=True)
class Baseline:
    """The model that misses something.

    Attributes
    ----------
    name : str
        ``bouc_wen``, ``bouc_wen_mode`` or ``play_bank``.
    equations : str
    values, deviations : dict of str to float
        Of a least-squares fit, in V, m, s, Hz: to the reference where there is one, else to
        the records of the task themselves.
    """

    name: str
    equations: str
    values: Mapping[str, float]
    deviations: Mapping[str, float]

    def run(
        self, voltage: Array, scale: Scale, values: Mapping[str, float] | None = None
    ) -> Array:
        """Compute the free run [m] on voltages (samples, records) [V]."""
        return respond(self.name, values or self.values, voltage, scale, {})


@dataclass(frozen=True)
class Task:
    """Everything that an entry may use.

    Attributes
    ----------
    identifier : str
    level : str
        ``clean``, ``conditions``, ``foreign`` or ``measured``: what kind of actuator and record.
    scale : Scale
        Range U [V], stroke Y [m], sampling time [s], duration T [s], whether records begin in
        motion.
    warm_up : int
        Samples at the beginning of each record that no score looks at.
    baseline : Baseline
    records, held_out : Records
        The held-out ones have no displacement.
    reference : Records or None
        Taken before anything was missing, where the baseline cannot be exact.
    """

    identifier: str
    level: str
    scale: Scale
    warm_up: int
    baseline: Baseline
    records: Records
    held_out: Records
    reference: Records | None = None

    @property
    def effects(self) -> dict[str, str]:
        """Names that are possible, with their equations."""
        return {name: effect.equation for name, effect in EFFECTS.items()}

    @property
    def measured(self) -> Array:
        """Displacement of the records (samples, records) [m]."""
        if self.records.displacement is None:
            raise ValueError('records of a task have a displacement')
        return self.records.displacement


@dataclass(frozen=True)
class Answer:
    """Answer of an entry.

    Attributes
    ----------
    probabilities : dict of str to float
        Of outcomes: a name, ``none``, ``unknown``, or two names joined by ``+``.
    classes : list of (outcomes, probability)
        Probability that the truth is one of several; each member gets an equal part.
    prediction : (samples, held-out records) [m], optional
        The free run of the baseline counts where it is missing.
    parameters : dict of effect to dict of parameter to (value, deviation)
    """

    probabilities: Mapping[str, float]
    classes: Sequence[tuple[frozenset[str], float]] = ()
    prediction: Array | None = None
    parameters: Mapping[str, Mapping[str, tuple[float, float]]] = field(default_factory=dict)


@dataclass(frozen=True)
class Truth:
    """What the examiner keeps.

    Attributes
    ----------
    kind : str
        ``single``, ``pair``, ``nothing`` or ``outside``.
    names : tuple of str
    parameters : dict of effect to parameters
    held_out : (samples, records) [m]
    control : float
        Held-out error of the actuator's own equations [m] rms, or of the baseline on the
        untouched records where these are unknown.
    discrepancy : (samples, records) [m]
        What the effects changed in the records.
    noise : float
        Of the records, rms [m].
    rest : (samples, records) [m]
        Noise of the records as it was; of measured records, white noise as large as the one at
        rest that their source states.
    values : dict of str to float
        True values of the baseline, or those fitted to the reference where none are true.
    """

    identifier: str
    level: str
    kind: str
    names: tuple[str, ...]
    parameters: dict[str, dict[str, float]]
    held_out: Array
    control: float
    discrepancy: Array
    noise: float
    rest: Array
    values: dict[str, float]

    @property
    def outcome(self) -> str:
        """The right answer."""
        if self.kind == 'nothing':
            return NONE
        return UNKNOWN if self.kind == 'outside' else '+'.join(sorted(self.names))

    @property
    def group(self) -> str:
        """Where it counts: the level for single effects, else the kind."""
        return self.level if self.kind == 'single' else self.kind


# --- files --------------------------------------------------------------------------------------


def _arrays(task: Task) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for part, records in (
        ('records', task.records), ('held_out', task.held_out), ('reference', task.reference),
    ):  # fmt: skip
        if records is not None:
            found[f'{part}_voltage_V'] = records.voltage
            found[f'{part}_free_run_m'] = records.free_run
            if records.displacement is not None:
                found[f'{part}_displacement_m'] = records.displacement
    return found


def save(task: Task, folder: Path, csv: bool = False) -> None:
    """Write a task as ``ID.npz`` and ``ID.json``; and as CSV, one file per record, where asked.

    Numbers have a fixed width, so that sizes of files do not depend on what hides.
    """
    folder.mkdir(parents=True, exist_ok=True)
    np.savez(folder / f'{task.identifier}.npz', **_arrays(task))
    said = {
        'version': VERSION,
        'identifier': task.identifier,
        'level': task.level,
        'scale': {k: _wide(v) for k, v in asdict(task.scale).items()},
        'units': {'volts': 'V', 'metres': 'm', 'dt': 's', 'span': 's'},
        'warm_up_samples': task.warm_up,
        'baseline': {
            'name': task.baseline.name,
            'equations': task.baseline.equations,
            'conventions': CONVENTIONS,
            'values': {k: _wide(v) for k, v in task.baseline.values.items()},
            'deviations': {k: _wide(v) for k, v in task.baseline.deviations.items()},
        },
        'effects': task.effects,
        'questions': QUESTIONS.split('\n'),
    }
    (folder / f'{task.identifier}.json').write_text(json.dumps(said, indent=1), encoding='utf-8')
    if csv:
        save_csv(task, folder / task.identifier)


def _wide(value: object) -> object:
    return f'{value:+.9e}' if isinstance(value, float) else value


def save_csv(task: Task, folder: Path) -> dict[str, list[Path]]:
    """Write ``PART_K.csv`` with columns time_s, voltage_V, displacement_m; return the files."""
    folder.mkdir(parents=True, exist_ok=True)
    found: dict[str, list[Path]] = {}
    for part, records in (
        ('records', task.records), ('held_out', task.held_out), ('reference', task.reference),
    ):  # fmt: skip
        if records is None:
            continue
        count = records.voltage.shape[0]
        time = task.scale.dt * np.arange(count)
        for k in range(records.voltage.shape[1]):
            columns, head = [time, records.voltage[:, k]], 'time_s,voltage_V'
            if records.displacement is not None:
                columns, head = [*columns, records.displacement[:, k]], f'{head},displacement_m'
            file = folder / f'{part}_{k}.csv'
            table = np.column_stack(columns)
            np.savetxt(file, table, '%+.9e', ',', header=head, comments='')
            found.setdefault(part, []).append(file)
    return found


def load(folder: Path, identifier: str) -> Task:
    """Read a task."""
    said = json.loads((folder / f'{identifier}.json').read_text(encoding='utf-8'))
    with np.load(folder / f'{identifier}.npz') as file:
        arrays = {name: np.asarray(file[name]) for name in file.files}

    def part(name: str) -> Records | None:
        if f'{name}_voltage_V' not in arrays:
            return None
        voltage = arrays[f'{name}_voltage_V']
        names = tuple(f'{name}_{k}' for k in range(voltage.shape[1]))
        measured = arrays.get(f'{name}_displacement_m')
        return Records(names, voltage, measured, arrays[f'{name}_free_run_m'])

    scale: dict[str, Any] = {
        k: v if isinstance(v, bool) else float(v) for k, v in said['scale'].items()
    }
    b = said['baseline']
    baseline = Baseline(
        b['name'],
        b['equations'],
        {k: float(v) for k, v in b['values'].items()},
        {k: float(v) for k, v in b['deviations'].items()},
    )
    records, held_out = part('records'), part('held_out')
    if records is None or held_out is None:
        raise ValueError(f'{identifier}.npz lacks records')
    return Task(
        identifier, said['level'], Scale(**scale), said['warm_up_samples'], baseline,
        records, held_out, part('reference'),
    )  # fmt: skip


def save_truths(truths: Sequence[Truth], folder: Path, seed: int | None = None) -> None:
    """Write ``truth.json`` and ``truth.npz``: the examiner keeps them apart from the tasks."""
    folder.mkdir(parents=True, exist_ok=True)
    rows, arrays = [], {}
    for truth in truths:
        row = asdict(truth)
        for name in ('held_out', 'discrepancy', 'rest'):
            arrays[f'{truth.identifier}_{name}'] = row.pop(name)
        rows.append(row)
    said = {'version': VERSION, 'seed': seed, 'truths': rows}
    (folder / 'truth.json').write_text(json.dumps(said, indent=1), encoding='utf-8')
    np.savez(folder / 'truth.npz', **arrays)


def load_truths(folder: Path) -> list[Truth]:
    """Read the truths of a folder."""
    rows = json.loads((folder / 'truth.json').read_text(encoding='utf-8'))['truths']
    found = []
    with np.load(folder / 'truth.npz') as file:
        for row in rows:
            row['names'] = tuple(row['names'])
            for name in ('held_out', 'discrepancy', 'rest'):
                row[name] = np.asarray(file[f'{row["identifier"]}_{name}'])
            found.append(Truth(**row))
    return found
