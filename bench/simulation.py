"""What a simulated sample costs, per preset and per effect, against a bare compiled loop.

The bare loop is one line of compiled recursion over the same commands: what any simulation in
Python with a compiler costs at least. Then the sweep of the papers: 50 frequencies of 100 s at
1 kHz, simulated and written as a bag.

    python bench/simulation.py [--samples 200000] [--effects] [--no-bag]
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

if not __package__:
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numba
import numpy as np
import numpy.typing as npt

from bench.quick import parsed
from piezo_hysteresis.records import write_bag
from piezo_sim import Plant, preset_names
from piezo_sim.sweep import grid, simulate

FloatArray = npt.NDArray[np.float64]


@numba.njit
def bare(command: Any, reading: Any) -> None:
    """Run one line of recursion per sample."""
    y = 0.0
    for k in range(command.size):
        y = 0.9 * y + 0.1 * command[k]
        reading[k] = y


def nanoseconds(run: Callable[[], object], samples: int, repeats: int = 5) -> float:
    """Return the best time per sample [ns]; the first call compiles."""
    run()
    best = min(_timed(run) for _ in range(repeats))
    return best / samples * 1e9


def _timed(run: Callable[[], object]) -> float:
    started = time.perf_counter()
    run()
    return time.perf_counter() - started


def drive(plant: Plant, samples: int) -> FloatArray:
    """Return a sinusoid of 23 Hz at the usual amplitude of the actuator."""
    preset = plant.preset
    time_ = np.arange(samples) / plant.rate
    return preset.bias + preset.voltage * np.sin(2 * np.pi * 23.0 * time_)


def row(name: str, plant: Plant, samples: int, floor: float) -> None:
    """Print one line of the table."""
    command = np.clip(drive(plant, samples), *plant.command_range)
    cost = nanoseconds(lambda: plant.run(command), samples)
    pace = 1e9 / plant.rate / cost
    print(f'{name:28} {plant.rate:7.0f} {cost:9.0f} {cost / floor:9.0f} {pace:13.0f}')


def stepping(samples: int) -> None:
    """Print what one sample at a time costs from Python."""
    plant = Plant.from_preset('fdk_pzba_00030')
    command = drive(plant, samples).tolist()
    cost = nanoseconds(lambda: [plant.exchange(v) for v in command], samples, 3)
    print(f'\none `exchange` from Python: {cost:.0f} ns')


def sweep(seconds: float, bag: bool) -> None:
    """Print the time of the sweep of the papers."""
    specs = grid('sine', [float(f) for f in range(1, 51)], [1.0], {'duration': seconds})
    simulate('fdk_pzba_00030', specs[:1])
    started = time.perf_counter()
    records = simulate('fdk_pzba_00030', specs)
    simulated = time.perf_counter() - started
    samples = sum(len(record) for record in records)
    print(
        f'\nsweep of 50 x {seconds:g} s at 1 kHz, {samples} samples: {simulated:.2f} s simulated',
        end='',
    )
    if bag:
        with tempfile.TemporaryDirectory() as folder:
            written = _timed(lambda: write_bag(Path(folder) / 'sweep', records))
        print(f', {written:.2f} s written as a bag', end='')
    print(f'; {samples / 1000 / simulated:.0f} times faster than real time')


def main() -> int:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else '')
    parser.add_argument('--samples', type=int, default=200_000)
    parser.add_argument('--seconds', type=float, default=100.0, help='of each of 50 frequencies')
    parser.add_argument('--effects', action='store_true', help='every effect on its own, too')
    parser.add_argument('--no-bag', action='store_true', help='do not write the bag')
    options = parsed(parser, samples=2000, seconds=1.0)
    command = np.sin(2 * np.pi * 0.023 * np.arange(options.samples))
    reading = np.empty_like(command)
    floor = nanoseconds(lambda: bare(command, reading), options.samples)
    print(f'bare compiled loop: {floor:.2f} ns per sample\n')
    print(f'{"preset":28} {"rate Hz":>7} {"ns/sample":>9} {"x bare":>9} {"x real time":>13}')
    for name in preset_names():
        row(name, Plant.from_preset(name), options.samples, floor)
    if options.effects:
        print('\neffects, each with Bouc-Wen hysteresis and a mode of 200 Hz')
        for effect in Plant().effect_table:
            switches = {'effects.bouc_wen': True, 'effects.resonance': True}
            plant = Plant({**switches, f'effects.{effect.name}': True})
            row(effect.name, plant, min(options.samples, 20_000), floor)
    stepping(min(options.samples, 20_000))
    sweep(options.seconds, bag=not options.no_bag)
    return 0


if __name__ == '__main__':
    sys.exit(main())
