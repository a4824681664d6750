"""Random simulations for the blind test of the discovery: hidden effects and their sizes.

A world is an actuator of `piezo_sim` that a named model describes except for one or two effects.
The parameters of both are random. An effect is enlarged until it is visible in the noise-free
readings after subtraction of everything that a refit of the model would absorb.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from piezo_hysteresis.records import Record
from piezo_sim.sweep import simulate

FloatArray = npt.NDArray[np.float64]

PRESET = 'generic_bouc_wen'
# A hidden effect is at least so large [noise floors], after a refit of the model.
VISIBLE = 3.0
MOST_ATTEMPTS = 20
Generator = np.random.Generator
Overrides = dict[str, float | bool]


@dataclass(frozen=True)
class World:
    """An actuator without anything hidden."""

    name: str  # kind of world
    baseline: str  # named model that describes it
    overrides: Overrides  # parameters and switches of the simulator
    absorbed: tuple[str, ...]


def sign(rng: Generator) -> float:
    """Draw -1 or 1."""
    return float(rng.choice([-1.0, 1.0]))


def share(rng: Generator, low: float, high: float) -> float:
    """Draw a number whose logarithm is uniform between those of `low` and `high`."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def bouc_wen(rng: Generator) -> Overrides:
    """Draw a classical Bouc-Wen loop."""
    beta = share(rng, 0.5, 3.0)
    return {
        'actuator.gain': share(rng, 0.7e-4, 2e-4),
        'bouc_wen.alpha': float(rng.uniform(0.25, 0.6)),
        'bouc_wen.beta': beta,
        'bouc_wen.gamma': beta * float(rng.uniform(-0.5, 0.8)),
    }


def mode(rng: Generator) -> Overrides:
    """Draw a mode of vibration."""
    return {
        'effects.resonance': True,
        'structure.natural_frequency': share(rng, 55.0, 280.0),
        'structure.damping_ratio': share(rng, 0.01, 0.08),
    }


def play(rng: Generator) -> Overrides:
    """Draw a bank with thresholds at tenths of the range, nine operators."""
    weights = rng.exponential(1.0, 9)
    weights *= rng.uniform(0.2, 0.4) / weights.sum()
    bank: Overrides = {'effects.bouc_wen': False, 'effects.play': True}
    for j in range(12):
        bank[f'play.radius_{j + 1:02}'] = 0.1 * (j + 1) if j < 9 else 1.0
        bank[f'play.weight_{j + 1:02}'] = float(weights[j]) if j < 9 else 0.0
    return {**bank, 'actuator.gain': share(rng, 0.7e-4, 2e-4)}


_OWN = ('actuator.gain', 'bouc_wen.alpha', 'bouc_wen.beta', 'bouc_wen.gamma')
_MODAL = ('structure.natural_frequency', 'structure.damping_ratio')


def world(name: str, rng: Generator) -> World:
    """Draw the numbers of a kind of world."""
    if name == 'static':
        return World(name, 'classical', bouc_wen(rng), _OWN)
    if name == 'off_centre':
        own = bouc_wen(rng) | {'effects.asymmetry': True}
        own['bouc_wen.asymmetry'] = sign(rng) * float(rng.uniform(0.02, 0.15))
        return World(name, 'modified', own, (*_OWN, 'bouc_wen.asymmetry'))
    if name == 'mode':
        return World(name, 'bouc_wen_mode', bouc_wen(rng) | mode(rng), (*_OWN, *_MODAL))
    if name == 'linear':
        own = {'effects.bouc_wen': False, 'actuator.gain': share(rng, 0.7e-4, 2e-4)} | mode(rng)
        return World(name, 'linear_mode', own, ('actuator.gain', *_MODAL))
    if name == 'play':
        weights = tuple(f'play.weight_{j:02}' for j in range(1, 10))
        return World(name, 'prandtl_ishlinskii', play(rng), ('actuator.gain', *weights))
    raise ValueError(f'there is no world {name}')


@dataclass(frozen=True)
class Knob:
    """One effect of the simulator: in which worlds it shows, its names, how its size is drawn."""

    worlds: tuple[str, ...]
    names: tuple[str, ...]
    draw: Callable[[Generator, float, Mapping[str, float]], Overrides]
    most: float = 8.0


def _law(name: str) -> Callable[[Generator, float, Mapping[str, float]], Overrides]:
    """Return how a hysteresis that the model does not have at all is drawn."""

    def draw(rng: Generator, size: float, seen: Mapping[str, float]) -> Overrides:
        if name == 'bouc_wen':
            return {'effects.bouc_wen': True, **bouc_wen(rng)}
        if name == 'play':
            return play(rng)
        return {
            'effects.bouc_wen': False,
            'effects.preisach': True,
            'preisach.weight': float(rng.uniform(0.3, 0.6)),
            'preisach.scale': float(rng.uniform(0.3, 0.9)),
            'preisach.asymmetry': 0.0,
        }

    return draw


def _saturation(rng: Generator, x: float, seen: Mapping[str, float]) -> Overrides:
    level = seen['amplitude'] * (1.0 - min(0.06 * x, 0.45))
    far, sides = 2.0 * seen['amplitude'], rng.integers(0, 3)
    return {
        'amplifier.clip_high': level if sides != 1 else far,
        'amplifier.clip_low': -level if sides != 2 else -far,
    }


def _creep(rng: Generator, x: float, seen: Mapping[str, float]) -> Overrides:
    gains = rng.permutation([0.03, 0.02, 0.02]) * x * rng.permutation([1.0, 1.0, 0.0])
    return {f'creep.gain_{j + 1}': float(gain) for j, gain in enumerate(gains)}


def _rate(rng: Generator, x: float, seen: Mapping[str, float]) -> Overrides:
    """Return the logarithmic or the power law; the vocabulary has a block for each."""
    growth, reference = min(0.06 * x, 0.3), 4.0
    if rng.random() < 0.5:
        return {'rate_dependence.widening': growth, 'rate_dependence.reference': reference}
    power, fastest = float(rng.uniform(0.15, 1.0)), seen['rise'] / reference
    # as much at the fastest drive as by the logarithm
    widening = growth * np.log1p(fastest) / fastest**power
    return {
        'rate_dependence.widening': float(widening),
        'rate_dependence.exponent': power,
        'rate_dependence.reference': reference,
        'rate_dependence.memory': share(rng, 1e-3, 2e-2),
    }


def _drift(rng: Generator, x: float, seen: Mapping[str, float]) -> Overrides:
    which = rng.integers(0, 2)
    return {
        'drift.rate': sign(rng) * 1e-7 * x * float(which == 0),
        'drift.warming': sign(rng) * 2e-6 * x * float(which == 1),
        'drift.warming_time': share(rng, 3.0, 60.0),
    }


def _curve(rng: Generator, x: float, seen: Mapping[str, float]) -> Overrides:
    which = rng.integers(0, 3)
    return {
        'sensor.quadratic': sign(rng) * 80.0 * x * float(which != 0),
        'sensor.cubic': sign(rng) * 1e6 * x * float(which != 1),
    }


def _hum(rng: Generator, x: float, seen: Mapping[str, float]) -> Overrides:
    return {
        'mains.amplitude': 5e-7 * x,
        'mains.frequency': float(rng.choice([50.0, 60.0, round(rng.uniform(20.0, 300.0), 2)])),
        'mains.third': float(rng.choice([0.0, 0.1])),
    }


def _second_mode(rng: Generator, x: float, seen: Mapping[str, float]) -> Overrides:
    return {
        'mode_2.frequency': share(rng, 60.0, 0.4 * seen['rate']),
        'mode_2.damping_ratio': share(rng, 0.01, 0.06),
        'mode_2.share': sign(rng) * min(0.08 * x, 0.6),
    }


def _simple(key: str, unit: float, most: float = np.inf, either: bool = False) -> Any:
    """Return a draw of one number that grows with the size of the effect."""

    def draw(rng: Generator, x: float, seen: Mapping[str, float]) -> Overrides:
        return {key: (sign(rng) if either else 1.0) * min(unit * x, most)}

    return draw


ANY = ('static', 'off_centre', 'mode', 'play')
SMOOTH = ('static', 'mode')

KNOBS: dict[str, Knob] = {
    'transport_delay': Knob(ANY, ('transport_delay',), _simple('amplifier.delay', 2e-3, 0.02)),
    'amplifier_lag': Knob(
        ANY, ('amplifier_lag',), _simple('amplifier.lag_time_constant', 1e-3, 0.02)
    ),
    'saturation': Knob(ANY, ('saturation',), _saturation),
    'slew_limit': Knob(
        ANY,
        ('slew_limit',),
        lambda rng, x, seen: {'amplifier.slew_rate': seen['rise'] / (1.0 + 0.3 * x)},
    ),
    'rate_dependence': Knob(SMOOTH, ('rate_dependence',), _rate),
    'electrostriction': Knob(
        ANY, ('electrostriction',), _simple('electrostriction.coefficient', 0.03, 0.3, True)
    ),
    'asymmetry': Knob(SMOOTH, ('asymmetry',), _simple('bouc_wen.asymmetry', 0.08, 0.3, True)),
    'gain_decay': Knob(
        ANY,
        ('gain_decay',),
        lambda rng, x, seen: {
            'depolarisation.loss': min(0.1 * x, 0.6),
            'depolarisation.time_constant': share(rng, 3.0, 40.0),
        },
    ),
    'backlash': Knob(
        ('static', 'off_centre', 'mode'), ('friction',), _simple('backlash.half_width', 1e-6), 30.0
    ),
    'hysteresis_exponent': Knob(
        ('static', 'mode'),
        ('hysteresis_exponent',),
        lambda rng, x, seen: {'bouc_wen.exponent': 1.0 + min(0.7 * x, 4.0)},
    ),
    'play': Knob(('static', 'mode'), ('nonlocal_memory',), _law('play')),
    'preisach': Knob(('static', 'mode'), ('nonlocal_memory',), _law('preisach')),
    'resonance': Knob(('static',), ('resonance',), lambda rng, x, seen: mode(rng)),
    'second_mode': Knob(('mode', 'static'), ('resonance',), _second_mode),
    'stiffness': Knob(('mode',), ('stiffness',), _simple('structure.cubic', 6e6, 6e7, True)),
    'friction': Knob(
        ('mode',),
        ('friction',),
        lambda rng, x, seen: {
            'friction.coulomb': 6e-7 * x,
            'friction.presliding': share(rng, 1e-6, 5e-6),
        },
    ),
    'bouc_wen': Knob(('linear',), ('hysteresis',), _law('bouc_wen')),
    'restoring_hysteresis': Knob(
        ('linear',), ('hysteresis',), _simple('restoring.share', 0.2, 0.7)
    ),
    'creep': Knob(ANY, ('creep',), _creep),
    'log_creep': Knob(
        ANY,
        ('creep',),
        lambda rng, x, seen: {
            'log_creep.gain': 0.015 * x,
            'log_creep.start': share(rng, 0.02, 0.3),
        },
    ),
    'drift': Knob(ANY, ('drift',), _drift),
    'sensor_nonlinearity': Knob(ANY, ('sensor_nonlinearity',), _curve),
    'mains_hum': Knob(ANY, ('mains_hum',), _hum),
    'floor_vibration': Knob(
        ANY,
        ('mains_hum',),
        lambda rng, x, seen: {
            'vibration.amplitude': 3e-7 * x,
            'vibration.frequency': round(float(rng.uniform(6.0, 45.0)), 2),
        },
    ),
    'sensor_bandwidth': Knob(
        ANY, ('amplifier_lag',), lambda rng, x, seen: {'sensor.bandwidth': 300.0 / x}
    ),
}
"""Effects inside the vocabulary."""

EXOTIC: dict[str, Knob] = {
    'amplitude_dead_time': Knob(ANY, (), _simple('amplifier.delay_per_volt', 2e-3, 0.02)),
    'sensor_clipping': Knob(
        ANY, (), lambda rng, x, seen: {'sensor.range': seen['reach'] * (1 - min(0.08 * x, 0.5))}
    ),
    'rate_limit': Knob(
        ANY, (), lambda rng, x, seen: {'sensor.rate_limit': seen['speed'] / (1.0 + 0.3 * x)}
    ),
    'jitter': Knob(ANY, (), _simple('sensor.jitter', 5e-5), 40.0),
    'dropouts': Knob(ANY, (), _simple('sensor.dropout_probability', 5e-3, 0.3), 60.0),
    'noise_bursts': Knob(ANY, (), _simple('sensor.burst_rms', 2e-6)),
    'modulated_tone': Knob(
        ANY,
        (),
        lambda rng, x, seen: {
            'modulated_tone.amplitude': 1e-6 * x,
            'modulated_tone.frequency': round(float(rng.uniform(60.0, 300.0)), 2),
            'modulated_tone.modulation': share(rng, 0.3, 2.0),
        },
    ),
    'switching': Knob(ANY, (), _simple('switching.step', 1.5e-6)),
    'amplitude_damping': Knob(('mode',), (), _simple('structure.quadratic_damping', 200.0), 50.0),
    'parametric_excitation': Knob(
        ('mode',),
        (),
        lambda rng, x, seen: {
            'structure.pump_depth': min(0.15 * x, 0.45),
            'structure.pump_frequency': round(float(rng.uniform(15.0, 70.0)), 2),
        },
    ),
}
"""Effects outside it: the right answer is unknown."""


@dataclass(frozen=True)
class Hidden:
    """One set: everything needed to make it again, and the answer."""

    key: str  # what it is called in the results; single
    kind: str  # pair
    design: str  # null or unknown; careful or poor
    world: World  # the actuator with everything that is hidden
    effects: tuple[str, ...]  # what is hidden, in the words of the simulator
    names: tuple[tuple[str, ...], ...]  # by which names of the vocabulary each may be called
    specs: tuple[Mapping[str, Any], ...]
    rate: float  # [Hz]
    noise_db: float  # [dB]
    seed: int  # of the noise
    floors: tuple[float, ...] = field(default=())  # size of each effect, estimated [noise floors]


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
