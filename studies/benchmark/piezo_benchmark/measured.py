"""Effects hidden in records of two measured actuators; the records are not part of the package.

The folder holds ``p885_stack/train_1Hz_sine.csv``, ``p885_stack/test_growing_amplitude.csv``
(repository yan9a/DiscreteBacklashOperator, MIT) and ``piezo_150v_1hz/piezo_150V_1Hz.csv``
(repository chandratue/SmartHysteresis, MIT), with columns time [s], voltage [V],
displacement [um].
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.random import Generator

from piezo_benchmark.effects import Parameters
from piezo_benchmark.fits import centred, fitted
from piezo_benchmark.tasks import EQUATIONS, Baseline, Records, Task, Truth
from piezo_benchmark.worlds import Array, Scale, after_core, low_pass, respond

VARIABLE = 'PIEZO_BENCHMARK_DATA'
FILES = {
    'p885': ('p885_stack/train_1Hz_sine.csv', 'p885_stack/test_growing_amplitude.csv'),
    '150v': ('piezo_150v_1hz/piezo_150V_1Hz.csv',),
}
#: Effects that can be put into a displacement that was already measured.
NAMES = (
    'transport_delay', 'amplifier_lag', 'sensor_curve', 'tone', 'drift', 'falling_gain', 'creep',
)  # fmt: skip
SAMPLES, WARM_UP = 1900, 200
#: Resolution of the displacement [m]; a dither of one step hides whether it was changed later.
STEPS = {'p885': 4e-9, '150v': 8e-9}
AT_REST = {'p885': 7e-8, '150v': 5e-8}  # noise [m] rms, as stated with the records


def folder(given: Path | None) -> Path | None:
    """Return the folder of the measured records, by argument or by the environment."""
    if given is not None:
        return given
    return Path(os.environ[VARIABLE]) if VARIABLE in os.environ else None


def available(data: Path | None) -> bool:
    """Return whether every file is there."""
    files = [file for part in FILES.values() for file in part]
    return data is not None and all((data / file).is_file() for file in files)


@lru_cache(maxsize=8)
def _read(file: Path, every: int) -> Array:
    table = np.loadtxt(file, delimiter=',', skiprows=1)
    count = table.shape[0] // every
    return np.asarray(table[: count * every].reshape(count, every, 3).mean(1))


def _pieces(random: Generator, actuator: str, data: Path) -> tuple[float, list[list[Array]]]:
    """Return the sampling time [s] and pieces of reference, records, held-out (samples, 3)."""
    if actuator == '150v':
        table = _read(data / FILES[actuator][0], 5)
        first = int(random.integers(3900, 4050))
        whole = [table[first + k * 1950 :][:SAMPLES] for k in range(3)]
        return 1e-3, [[whole[0]], [whole[1]], [whole[2]]]
    sine, growing = (_read(data / file, 1) for file in FILES[actuator])
    a, b = int(random.integers(0, 100)), int(random.integers(0, 100))
    sines = [sine[a + k * 1950 :][:SAMPLES] for k in range(4)]
    others = [growing[b + k * 1950 :][:SAMPLES] for k in range(7)]
    return 5e-3, [
        [sines[0], others[0], others[2], others[4]],
        [sines[1], sines[2], others[1], others[5]],
        [sines[3], others[3]],
    ]


def _drawn(random: Generator, name: str, dt: float) -> Parameters:
    """Return an effect of random size, from a quarter to the whole of what is stated here."""
    size = float(np.exp(random.uniform(np.log(0.25), 0.0)))
    sign = float(random.choice([-1, 1]))
    if name == 'transport_delay':
        return {'delay': max(round(8 * size), 3) * dt}
    if name == 'amplifier_lag':
        return {'lag_time': 8 * size * dt}
    if name == 'sensor_curve':
        even = random.random() < 0.5
        return {'even': 0.05 * size * even, 'odd': 0.1 * size * (not even)}
    if name == 'tone':
        phase = random.uniform(0, 2 * np.pi)
        parts = {'sine': 0.03 * size * np.cos(phase), 'cosine': 0.03 * size * np.sin(phase)}
        return {**parts, 'frequency': (0.06 + 0.19 * random.random()) / dt}
    if name == 'drift':
        return {'drift': 0.15 * size * sign}
    if name == 'falling_gain':
        return {'loss': 0.16 * size}
    span = SAMPLES * dt
    return {'share': 0.15 * size, 'time': float(random.uniform(0.05, 0.4)) * span}


def changed(y: Array, scale: Scale, effects: dict[str, Parameters]) -> Array:
    """Put effects into displacements about their middle [m]."""
    rest = {name: e for name, e in effects.items() if name != 'amplifier_lag'}
    if 'amplifier_lag' in effects:
        y = low_pass(y, effects['amplifier_lag']['lag_time'], scale.dt, True)
    return after_core(y, np.zeros_like(y), rest, scale, None)


def one(seed: Sequence[int], kind: str, place: int, data: Path) -> tuple[Task, Truth]:
    """Draw one task of measured records and its truth."""
    first, second = (np.random.default_rng([*seed, k]) for k in range(2))
    actuator = str(first.choice(sorted(FILES)))
    dt, parts = _pieces(first, actuator, data)
    voltages = [np.array([p[:, 1] for p in part]).T for part in parts]
    plain = [1e-6 * np.array([p[:, 2] for p in part]).T for part in parts]
    plain = [y + STEPS[actuator] * first.uniform(-0.5, 0.5, y.shape) for y in plain]
    middle = float(np.mean(plain[0]))
    plain = [y - middle for y in plain]
    volts, metres = (float(np.ptp(x)) / 2 for x in (voltages[0], plain[0]))
    scale = Scale(volts, metres, dt, SAMPLES * dt, True)
    effects: dict[str, Parameters] = {}
    if kind == 'single':
        name = NAMES[place % len(NAMES)]
        effects[name] = _drawn(second, name, dt)
    records, held_out = (changed(y, scale, effects) for y in plain[1:])
    per_volt = metres / volts
    near = {f'w{j}': 0.04 * per_volt for j in range(1, 10)} | {'w0': 0.7 * per_volt}
    fit = fitted('play_bank', voltages[0], plain[0], scale, WARM_UP, near)
    answer = respond('play_bank', fit.values, voltages[0], scale, {})
    offset = float(np.mean((plain[0] - answer)[WARM_UP:]))
    deviations = {key[1]: value for key, value in fit.deviations.items()}
    base = Baseline(
        'play_bank', EQUATIONS['play_bank'], {**fit.values, 'offset': offset}, deviations
    )
    names = [
        tuple(f'{part}_{k}' for k in range(v.shape[1]))
        for part, v in zip(('reference', 'records', 'held_out'), voltages, strict=True)
    ]
    runs = [base.run(v, scale) for v in voltages]
    task = Task(
        '', 'measured', scale, WARM_UP, base,
        Records(names[1], voltages[1], records, runs[1]),
        Records(names[2], voltages[2], None, runs[2]),
        Records(names[0], voltages[0], plain[0], runs[0]),
    )  # fmt: skip
    control = float(np.sqrt(np.mean(centred(plain[2] - runs[2], WARM_UP) ** 2)))
    noise = float(np.sqrt(np.mean(centred(plain[1] - runs[1], WARM_UP) ** 2)))
    truth = Truth(
        '', 'measured', kind, tuple(effects), effects, held_out, control, records - plain[1],
        noise,
        AT_REST[actuator] * second.standard_normal(records.shape), dict(fit.values),
    )  # fmt: skip
    return task, truth
