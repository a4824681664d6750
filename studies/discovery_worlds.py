"""Random simulations for the blind test of the discovery: hidden effects and their sizes.

A world is an actuator of `piezo_sim` that a named model describes except for one or two effects.
The parameters of both are random. An effect is enlarged until it is visible in the noise-free
readings after subtraction of everything that a refit of the model would absorb.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from piezo_hysteresis.records import Record
from piezo_sim.sweep import simulate
from studies.discovery_actuators import Generator, Overrides, World, share, world
from studies.discovery_effects import ANY, EXOTIC, KNOBS, Knob

FloatArray = npt.NDArray[np.float64]

PRESET = 'generic_bouc_wen'
# A hidden effect is at least so large [noise floors], after a refit of the model.
VISIBLE = 3.0
MOST_ATTEMPTS = 20


@dataclass(frozen=True)
class Hidden:
    """One set: everything needed to make it again, and the answer.

    Attributes
    ----------
    key, kind, design : str
        What it is called in the results; single, pair, null or unknown; careful or poor.
    world : World
        The actuator with everything that is hidden.
    effects : tuple of str
        What is hidden, in the words of the simulator.
    names : tuple of tuple of str
        By which names of the vocabulary each may be called.
    specs : tuple of mapping
        The experiments.
    rate, noise_db : float
        Sampling rate [Hz]; rms of the slowest record over that of the noise [dB].
    seed : int
        Of the noise.
    floors : tuple of float
        Size of each effect, estimated [noise floors].
    """

    key: str
    kind: str
    design: str
    world: World
    effects: tuple[str, ...]
    names: tuple[tuple[str, ...], ...]
    specs: tuple[Mapping[str, Any], ...]
    rate: float
    noise_db: float
    seed: int
    floors: tuple[float, ...] = field(default=())


def experiments(design: str, rng: Generator, mode: float) -> tuple[Mapping[str, Any], ...]:
    """Draw the experiments of a careful or of a hasty lab; neither drives the mode it knows."""
    if design == 'poor':
        drives = sorted(rng.choice([1, 2, 5, 10, 20, 30], 3, replace=False))
        return tuple(_sine(float(f), 1.0) for f in drives)
    ladder = [(1, 2), (3, 4, 5), (7, 8, 9, 11), (13, 14, 17, 19), (23, 26, 31), (37, 43, 47)]
    ladder += [(61, 73, 89, 110)]
    drives = [float(rng.choice(step)) for step in ladder]
    drives = [f for f in drives if abs(f - mode) > 0.2 * mode]
    small = round(float(rng.uniform(0.4, 0.6)), 2)
    specs = [_sine(f, a) for a in (1.0, small) for f in drives]
    specs += [
        {'kind': 'rest', 'duration': 6.0},
        {'kind': 'step', 'amplitude': 0.8, 'duration': 12.0},
        {'kind': 'reversal_curves', 'amplitude': 1.0, 'rate': 3.0},
    ]
    if rng.random() < 0.5:
        specs.append(
            {
                'kind': 'chirp',
                'amplitude': 0.3,
                'frequency': 1.0,
                'highest': 200.0,
                'duration': 5.0,
            }
        )
    return tuple(specs)


def _sine(frequency: float, amplitude: float) -> Mapping[str, Any]:
    length = 4.0 if frequency < 3.0 else 3.0
    return {'kind': 'sine', 'frequency': frequency, 'amplitude': amplitude, 'duration': length}


def readings(
    specs: Sequence[Mapping[str, Any]], overrides: Mapping[str, float | bool], rate: float
) -> FloatArray:
    """Return the noise-free readings of all experiments behind one another [m]."""
    quiet = dict(overrides) | {'effects.noise': False}
    return np.concatenate(
        [r.displacement[r.warm_up_samples :] for r in simulate(PRESET, specs, quiet, 1, rate)]
    )


def absorbed(actuator: World, specs: Sequence[Mapping[str, Any]], rate: float) -> FloatArray:
    """Return an orthonormal basis of what a refit of the baseline stands for, shape (n, p)."""
    before = readings(specs, actuator.overrides, rate)
    columns = [np.ones_like(before)]
    for name in actuator.absorbed:
        value = float(actuator.overrides.get(name, 0.0))
        moved = value * (1.0 + 1e-4) + 1e-6 * (value == 0.0)
        columns.append(readings(specs, actuator.overrides | {name: moved}, rate) - before)
    columns = [c / np.linalg.norm(c) for c in columns if np.any(c)]
    return np.asarray(np.linalg.qr(np.column_stack(columns))[0])


def left(change: FloatArray, basis: FloatArray) -> float:
    """Return the rms of what a refit leaves of `change`."""
    rest = change - basis @ (basis.T @ change)
    return float(np.sqrt(np.mean(rest**2)))


def records_of(hidden: Hidden) -> list[Record]:
    """Make the set. Tones begin at another phase in every record."""
    rng = np.random.default_rng(hidden.seed)
    made = []
    for k, spec in enumerate(hidden.specs):
        own = hidden.world.overrides | {'mains.phase': float(rng.uniform(-3.0, 3.0))}
        made += simulate(PRESET, [spec], own, hidden.seed + k, hidden.rate, actuator='bench')
    names: dict[str, int] = {}
    unique = []
    for record in made:
        count = names[record.name] = names.get(record.name, 0) + 1
        unique.append(record if count == 1 else replace(record, name=f'{record.name}_{count}'))
    return unique


def draw(kind: str, index: int, seed: int, design: str = 'careful') -> Hidden:
    """Draw set `index` of a kind: single, pair, null or unknown.

    A world in which an effect cannot be made large enough to be seen is drawn anew.
    """
    numbers = [seed, index, ('single', 'pair', 'null', 'unknown').index(kind)]
    for attempt in range(MOST_ATTEMPTS):
        rng = np.random.default_rng([*numbers, attempt] if attempt else numbers)
        hidden = _drawn(f'{kind}-{design}-{seed}-{index}', kind, index, design, rng)
        if all(size >= VISIBLE for size in hidden.floors):
            return hidden
    raise ValueError(f'no {kind} set {index} of seed {seed} shows what it hides')


def _drawn(key: str, kind: str, index: int, design: str, rng: Generator) -> Hidden:
    table = EXOTIC if kind == 'unknown' else KNOBS
    effects = _chosen(kind, index, rng, table)
    fitting = set(table[effects[0]].worlds) if effects else {*ANY, 'linear'}
    for name in effects[1:]:
        fitting &= set(table[name].worlds)
    actuator = world(str(rng.choice(sorted(fitting))), rng)
    mode = float(actuator.overrides.get('structure.natural_frequency', 0.0))
    specs, rate = experiments(design, rng, mode), 1000.0
    noise_db = float(rng.uniform(40.0, 65.0))
    slowest = readings(specs[:1], actuator.overrides, rate)
    noise = float(np.std(slowest)) * 10.0 ** (-noise_db / 20.0)
    hidden_world, sizes = actuator, []
    if effects:
        basis = absorbed(actuator, specs, rate)
        before = readings(specs, actuator.overrides, rate)
    for name in effects:
        own, size = _visible(name, table[name], actuator, specs, rate, rng, basis, before, noise)
        hidden_world = replace(hidden_world, overrides=hidden_world.overrides | own)
        sizes.append(size)
    overrides = hidden_world.overrides | {'sensor.noise_rms': noise}
    return Hidden(
        key=key,
        kind=kind,
        design=design,
        world=replace(hidden_world, overrides=overrides),
        effects=effects,
        names=tuple(table[name].names for name in effects),
        specs=specs,
        rate=rate,
        noise_db=noise_db,
        seed=int(rng.integers(1, 2**31)),
        floors=tuple(sizes),
    )


def _chosen(kind: str, index: int, rng: Generator, table: Mapping[str, Knob]) -> tuple[str, ...]:
    names = list(table)
    if kind == 'null':
        return ()
    if kind != 'pair':
        return (names[index % len(names)],)
    while True:
        first, second = (str(name) for name in rng.choice(names, 2, replace=False))
        different = set(table[first].names).isdisjoint(table[second].names)
        if different and set(table[first].worlds) & set(table[second].worlds):
            return first, second


def _visible(
    name: str,
    knob: Knob,
    actuator: World,
    specs: Sequence[Mapping[str, Any]],
    rate: float,
    rng: Generator,
    basis: FloatArray,
    before: FloatArray,
    noise: float,
) -> tuple[Overrides, float]:
    """Draw an effect and enlarge it until it stands out of the noise."""
    rise = max(2 * np.pi * s.get('frequency', 0.0) * s.get('amplitude', 0.0) for s in specs)
    # The largest speed but for steps, and for the joints of the records.
    speed = float(np.quantile(np.abs(np.diff(before)), 0.999)) * rate
    seen = {
        'amplitude': 1.0,
        'rate': rate,
        'rise': float(rise),
        'reach': float(np.max(np.abs(before))),
        'speed': speed,
    }
    size, state = share(rng, 0.4, 2.5), int(rng.integers(1, 2**31))
    while True:
        own = knob.draw(np.random.default_rng(state), size, seen) | {f'effects.{name}': True}
        change = readings(specs, actuator.overrides | own, rate) - before
        gap = left(change, basis) / noise
        if gap >= VISIBLE or size > knob.most:
            return own, gap
        size *= 1.5
