"""Draw tasks and their truths from a seed.

Actuator, conditions and drives come from one stream of random numbers, what hides from another
and noise from a third: no choice of one shows in the others. Tasks are shuffled before they are
numbered.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.random import Generator
from scipy.signal import lfilter

from piezo_benchmark import measured as lab
from piezo_benchmark.effects import EFFECTS, OUTSIDE, Parameters, between, scaled, strength
from piezo_benchmark.fits import NAMES, centred, fitted, linearised
from piezo_benchmark.tasks import EQUATIONS, Baseline, Records, Task, Truth
from piezo_benchmark.worlds import FOREIGN, PLAYS, Array, Scale, after_core, respond

SAMPLES, BEFORE = 1500, 1000  # of a record; simulated before one that begins in motion
TRAINING, HELD_OUT, REFERENCE = 4, 2, 4
#: How many tasks of each level and kind, of 200.
COUNTS = {
    ('clean', 'single'): 33, ('clean', 'nothing'): 8, ('clean', 'outside'): 7,
    ('clean', 'pair'): 12,
    ('conditions', 'single'): 33, ('conditions', 'nothing'): 8, ('conditions', 'outside'): 7,
    ('conditions', 'pair'): 12,
    ('foreign', 'single'): 22, ('foreign', 'nothing'): 8, ('foreign', 'outside'): 4,
    ('foreign', 'pair'): 6,
    ('measured', 'single'): 28, ('measured', 'nothing'): 12,
}  # fmt: skip
PRACTICE_SEED = 2026


@dataclass(frozen=True)
class Conditions:
    """How records are taken; noise over the stroke [1], quantum over the stroke [1]."""

    scale: Scale
    noise: float
    coloured: bool
    grows: bool
    quantum: float
    zeros: float


def _conditions(random: Generator, level: str) -> Conditions:
    volts, metres = between(random, 1.0, 150.0), between(random, 5e-6, 2e-4)
    noise = between(random, 5e-4, 4e-3)
    if level != 'conditions':
        scale = Scale(volts, metres, 2e-3, SAMPLES * 2e-3)
        return Conditions(scale, noise, False, False, 0.0, 0.0)
    dt = 1.0 / round(between(random, 200.0, 5000.0))
    scale = Scale(volts, metres, dt, SAMPLES * dt, bool(random.random() < 0.5))
    return Conditions(
        scale,
        noise,
        bool(random.random() < 0.4),
        bool(random.random() < 0.5),
        3.0 / 2 ** int(random.integers(9, 17)),
        float(random.choice([0.0, 0.05])),
    )


def _world(random: Generator, level: str, scale: Scale) -> tuple[str, dict[str, float], str]:
    """Return a world, its values and the baseline that is given for it."""
    per_volt = scale.metres / scale.volts
    if level == 'foreign':
        world = str(random.choice(sorted(FOREIGN)))
        values = {
            'duhem': {'height': 0.75, 'bend': random.uniform(1.0, 1.4),
                      'slope': random.uniform(0.45, 0.65), 'decay': random.uniform(1.0, 2.0)},
            'preisach': {'width': random.uniform(0.2, 0.4), 'spread': random.uniform(0.2, 0.35),
                         'middle': random.uniform(0.35, 0.6), 'share': random.uniform(0.2, 0.4)},
            'elastoslides': {'widest': random.uniform(0.5, 1.0), 'power': random.uniform(1.0, 2.0),
                             'share': random.uniform(0.3, 0.6)},
        }[world]  # fmt: skip
        return world, {**values, 'gain': per_volt}, str(random.choice(['bouc_wen', 'play_bank']))
    world = str(random.choice(['bouc_wen', 'bouc_wen_mode', 'play_bank']))
    if world == 'play_bank':
        weights = random.uniform(0.2, 1.0, PLAYS.size) * np.linspace(1.0, 0.4, PLAYS.size)
        weights *= random.uniform(0.25, 0.5) / weights.sum()
        bank = {f'w{j + 1}': float(per_volt * w) for j, w in enumerate(weights)}
        return world, {'w0': float(per_volt * (1.0 - weights.sum())), **bank}, world
    beta = random.uniform(0.6, 2.0) / scale.volts
    found = {
        'gain': per_volt * 1.1,
        'loop': per_volt * random.uniform(0.2, 0.5),
        'beta': beta,
        'gamma': random.uniform(-0.4, 0.6) * beta,
    }
    if world == 'bouc_wen_mode':
        found['frequency'] = between(random, 1 / 30, 1 / 12) / scale.dt
        found['damping'] = between(random, 0.02, 0.1)
    return world, found, world


def _wave(random: Generator, scale: Scale, kind: str, loud: float) -> Array:
    """Return a voltage [V] that begins at 0 V, or was running before."""
    before = BEFORE if scale.moving else 0
    k = np.arange(SAMPLES + before, dtype=np.float64)
    period = between(random, 60.0, 700.0)
    turn = 2 * np.pi * k / period
    shape = np.sin(turn)
    if kind == 'multisine':
        phases = random.uniform(0, 2 * np.pi, 3)
        orders = np.array([1.0, 2.6, 5.3])
        parts = [
            np.sin(o * turn * 0.6 + p) - np.sin(p) for o, p in zip(orders, phases, strict=True)
        ]
        shape = np.sum(np.array(parts) / orders[:, None] ** 0.5, 0)
        shape = shape / np.max(np.abs(shape))
    elif kind == 'chirp':
        ratio = np.log(8.0) / k.size
        shape = np.sin(2 * np.pi * (np.exp(ratio * k) - 1.0) / (ratio * 600.0))
    elif kind == 'growing':
        shape = (0.25 + 0.75 * k / k.size) * np.sin(turn)
    return np.asarray(scale.volts * loud * shape)


def _drives(random: Generator, scale: Scale, count: int) -> Array:
    columns = []
    for place in range(count):
        if place == 0:
            kind = 'sine'
        else:
            kind = str(random.choice(['sine', 'sine', 'multisine', 'chirp', 'growing']))
        loud = 1.0 if place == 0 else float(random.choice([0.45, 0.7, 1.0]))
        columns.append(_wave(random, scale, kind, loud))
    return np.array(columns).T


@dataclass(frozen=True)
class Actuator:
    """One actuator and how it is recorded."""

    world: str
    values: dict[str, float]
    conditions: Conditions

    def clean(self, voltage: Array, effects: dict[str, Parameters]) -> Array:
        """Compute the displacement without noise [m]; what was before a record is cut off."""
        scale, skip = self.conditions.scale, voltage.shape[0] - SAMPLES
        late = replace(scale, moving=False)
        if not skip:
            return respond(self.world, self.values, voltage, late, effects)
        slow = {n: dict(e) for n, e in effects.items() if n in _BY_RECORD}
        rest = {n: e for n, e in effects.items() if n not in slow}
        y = respond(self.world, self.values, voltage, late, rest)[skip:]
        return _by_record(y, slow, scale)

    def recorded(self, clean: Array, random: Generator) -> Array:
        """Return what a sensor and its converter make of it [m]."""
        c = self.conditions
        noise = random.standard_normal(clean.shape)
        if c.coloured:
            noise = np.asarray(lfilter([np.sqrt(1 - 0.81)], [1.0, -0.9], noise, axis=0))
        size = c.noise * c.scale.metres * np.ones(clean.shape[1])
        if c.grows:
            size = size * np.ptp(clean, axis=0) / max(float(np.max(np.ptp(clean, axis=0))), 1e-30)
        zero = c.zeros * c.scale.metres * random.standard_normal(clean.shape[1])
        read = clean + size * noise + zero
        if c.quantum:
            quantum = c.quantum * c.scale.metres
            read = np.round(read / quantum) * quantum
        return np.asarray(read)


_BY_RECORD = ('drift', 'falling_gain', 'tone', 'sensor_steps')


def _by_record(y: Array, effects: dict[str, Parameters], scale: Scale) -> Array:
    return after_core(y, np.zeros_like(y), effects, scale, None)


# --- what hides ---------------------------------------------------------------------------------


def _visible(plain: Array, changed: Array, tangent: Array, warm_up: int) -> float:
    """Return what of a change no baseline parameter and no zero hides [m] rms."""
    left = centred(changed - plain, warm_up).ravel()
    left = left - tangent @ (tangent.T @ left)
    return float(np.sqrt(np.mean(left**2)))


def _hidden(
    random: Generator, name: str, actuator: Actuator, voltage: Array, tangent: Array, warm_up: int
) -> Parameters | None:
    """Return parameters of an effect of 3 to 40 times the noise, or None where that fails."""
    c = actuator.conditions
    scale = c.scale
    least = max(c.noise, c.quantum / np.sqrt(12.0))
    wanted = least * scale.metres * between(random, 3.0, 40.0)
    if name in EFFECTS:
        parameters, most = EFFECTS[name].draw(random, scale), EFFECTS[name].most(scale)
    else:
        parameters, most = OUTSIDE[name][1](random, scale), OUTSIDE[name][2]
    plain = actuator.clean(voltage, {})
    seen = 0.0
    for _ in range(4):
        seen = _visible(plain, actuator.clean(voltage, {name: parameters}), tangent, warm_up)
        factor = float(np.clip(wanted / max(seen, 1e-15), 0.2, 5.0))
        if name != 'slew_limit':
            factor = min(factor, most / max(strength(name, parameters), 1e-15))
        parameters = scaled(name, parameters, factor)
        if name == 'transport_delay':
            ticks = max(round(parameters['delay'] / scale.dt), 3)
            parameters['delay'] = ticks * scale.dt
        if name == 'amplifier_lag':
            parameters['lag_time'] = max(parameters['lag_time'], scale.dt)
    seen = _visible(plain, actuator.clean(voltage, {name: parameters}), tangent, warm_up)
    return parameters if seen > 2.0 * least * scale.metres else None


def _chosen(random: Generator, kind: str, place: int) -> list[str]:
    """Return names to try, in order; names take turns so that all are equally frequent."""
    names = list(OUTSIDE if kind == 'outside' else EFFECTS)
    if kind == 'pair':
        return [str(n) for n in random.permutation(names)]
    return [names[(place + k) % len(names)] for k in range(len(names))]


def _effects(
    random: Generator,
    kind: str,
    place: int,
    actuator: Actuator,
    voltage: Array,
    tangent: Array,
    warm_up: int,
) -> dict[str, Parameters]:
    """Return the effects of a task with their parameters.

    Raises
    ------
    ValueError
        If too few effects are visible on these voltages.
    """
    effects: dict[str, Parameters] = {}
    wanted = {'nothing': 0, 'pair': 2}.get(kind, 1)
    for name in _chosen(random, kind, place) * 3:
        if len(effects) < wanted and name not in effects:
            found = _hidden(random, name, actuator, voltage, tangent, warm_up)
            if found is not None:
                effects[name] = found
    if len(effects) < wanted:
        raise ValueError(f'only {len(effects)} of {wanted} effects are visible')
    return effects


def _tangent(
    world: str, voltage: Array, scale: Scale, values: dict[str, float], skip: int
) -> Array:
    """Return an orthonormal basis of what the parameters of a baseline can do."""
    keys = [('', name) for name in NAMES[world]]
    _, slopes, _ = linearised(world, voltage, scale, values, {}, keys)
    matrix = np.array([centred(s, skip).ravel() for s in slopes]).T
    matrix = matrix / (np.sqrt(np.sum(matrix**2, 0)) + 1e-30)
    basis, sizes, _ = np.linalg.svd(matrix, full_matrices=False)
    return np.asarray(basis[:, sizes > 1e-6 * sizes[0]])


def start_values(world: str, scale: Scale) -> dict[str, float]:
    """Return values from which the fit of a baseline begins, by the ranges alone."""
    per_volt = scale.metres / scale.volts
    if world == 'play_bank':
        return {name: per_volt * (0.6 if name == 'w0' else 0.05) for name in NAMES[world]}
    found = {
        'gain': 1.1 * per_volt, 'loop': 0.3 * per_volt,
        'beta': 1.0 / scale.volts, 'gamma': 0.1 / scale.volts,
    }  # fmt: skip
    if world == 'bouc_wen_mode':
        found |= {'frequency': 1 / 19 / scale.dt, 'damping': 0.05}
    return found


def fitted_baseline(
    name: str, voltage: Array, read: Array, scale: Scale, warm_up: int, near: dict[str, float]
) -> Baseline:
    """Return the baseline fitted to records."""
    fit = fitted(name, voltage, read, scale, warm_up, near)
    offset = float(
        np.mean(read[warm_up:] - respond(name, fit.values, voltage, scale, {})[warm_up:])
    )
    deviations = {key[1]: value for key, value in fit.deviations.items()}
    return Baseline(name, EQUATIONS[name], {**fit.values, 'offset': offset}, deviations)


def one(seed: Sequence[int], level: str, kind: str, place: int) -> tuple[Task, Truth]:
    """Draw one task of a simulated level and its truth; the identifier comes later."""
    streams = [np.random.default_rng([*seed, k]) for k in range(3)]
    first, second, third = streams
    conditions = _conditions(first, level)
    scale = conditions.scale
    world, values, baseline_name = _world(first, level, scale)
    actuator = Actuator(world, values, conditions)
    training = _drives(first, scale, TRAINING)
    unseen = _drives(first, scale, HELD_OUT)
    known = _drives(first, scale, REFERENCE)
    warm_up = 400 if scale.moving else 50
    near = dict(values) if world == baseline_name else start_values(baseline_name, scale)

    def cut(voltage: Array) -> Array:
        return voltage[voltage.shape[0] - SAMPLES :]

    reference = None
    if level == 'foreign':
        read = actuator.recorded(actuator.clean(known, {}), third)
        base = fitted_baseline(baseline_name, cut(known), read, scale, warm_up, near)
        near = {k: v for k, v in base.values.items() if k != 'offset'}
    tangent = _tangent(baseline_name, cut(training), scale, near, warm_up)
    effects = _effects(second, kind, place, actuator, training, tangent, warm_up)
    plain, changed = actuator.clean(training, {}), actuator.clean(training, effects)
    read_training = actuator.recorded(changed, third)
    clean_unseen = actuator.clean(unseen, effects)
    read_unseen = actuator.recorded(clean_unseen, third)
    if level != 'foreign':
        base = fitted_baseline(baseline_name, cut(training), read_training, scale, warm_up, near)
    else:
        reference = Records(
            _names('reference', known), cut(known), read, base.run(cut(known), scale)
        )
    task = Task(
        '', level, scale, warm_up, base,
        Records(_names('records', training), cut(training), read_training,
                base.run(cut(training), scale)),
        Records(_names('held_out', unseen), cut(unseen), None, base.run(cut(unseen), scale)),
        reference,
    )  # fmt: skip
    noise = float(np.sqrt(np.mean(centred(read_training - changed, warm_up) ** 2)))
    missed = read_unseen - clean_unseen
    if level == 'foreign':  # no baseline is exact: what it misses where nothing hides counts
        missed = missed + actuator.clean(unseen, {}) - base.run(cut(unseen), scale)
    control = float(np.sqrt(np.mean(centred(missed, warm_up) ** 2)))
    truth = Truth(
        '', level, kind, tuple(effects), effects, read_unseen, control, changed - plain, noise,
        read_training - changed, near,
    )  # fmt: skip
    return task, truth


def _names(part: str, voltage: Array) -> tuple[str, ...]:
    return tuple(f'{part}_{k}' for k in range(voltage.shape[1]))


def plan() -> list[tuple[str, str, int]]:
    """Return (level, kind, place) of every task of a set."""
    return [
        (level, kind, place) for (level, kind), count in COUNTS.items() for place in range(count)
    ]


def drawn(
    seed: int,
    share: int = 1,
    data: Path | None = None,
    levels: Sequence[str] = (),
    each: Callable[..., Iterable[tuple[Task, Truth]]] = map,
) -> tuple[list[Task], list[Truth]]:
    """Draw a set of tasks; each is the same, whichever others are drawn with it.

    Parameters
    ----------
    seed : int
        Of everything.
    share : int
        Draw one of so many of each level and kind.
    data : Path, optional
        Folder of the measured records; without it the level `measured` is omitted.
    levels : sequence of str
        All by default.
    each : callable
        `map`, or that of a pool of processes.
    """
    cells, files = plan(), lab.available(data)
    order = np.random.default_rng([seed, 7]).permutation(len(cells))
    jobs = [
        (f'task-{number:04d}', seed, *cells[index])
        for number, index in enumerate(order)
        if not cells[index][2] % share
        and (not levels or cells[index][0] in levels)
        and (files or cells[index][0] != 'measured')
    ]
    found = list(each(partial(_task, data), jobs))
    return [task for task, _ in found], [truth for _, truth in found]


def _task(data: Path | None, job: tuple[str, int, str, str, int]) -> tuple[Task, Truth]:
    name, seed, level, kind, place = job
    key = [seed, list(COUNTS).index((level, kind)), place]
    if level == 'measured' and data is not None:
        task, truth = lab.one(key, kind, place, data)
    else:
        task, truth = one(key, level, kind, place)
    return replace(task, identifier=name), replace(truth, identifier=name)
