"""The same loop as nodes, as one node, offline in Python, and as an exported library.

All four track the same sine on the same simulated actuator at 1 kHz, each at full speed, with
the same inverse, attenuation and limits, so that their errors are equal if nothing differs.
"""

from __future__ import annotations

import ctypes
import json
import math
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.cli.main import main as verb
from piezo_hysteresis.compensation.controllers import Controllers
from piezo_hysteresis.compensation.harmonics.harmonic_attenuation import AttenuationSettings
from piezo_hysteresis.compensation.link import Limits
from piezo_hysteresis.compensation.offline_loop import ProcessPlant, closed_loop, simulated
from piezo_hysteresis.models import ModelFile
from piezo_hysteresis.waveforms import Sine
from piezo_hysteresis.waveforms.waveform import Samples

RATE, PRESET, LIMITS = 1000.0, 'fdk_pzba_00030', Limits(-1.2, 1.2, 2000.0)
ORDERS = (0, 1, 3)
# Fewer samples than a live loop needs to warm up: then only what needs no ROS.
SHORTEST = 1000
# Times that a loop without ROS is run; the fastest counts.
RUNS = 5


class Row(NamedTuple):
    """How a loop went."""

    name: str  # what runs it
    rate: float  # samples per second
    cpu: float  # CPU time per sample, the plant included [us]
    rms: float | None  # of the tracking error in the second half [m]


def wanted(ticks: int) -> Samples:
    """Return the reference that all of them track."""
    from bench.loop import AMPLITUDE, EASED, FREQUENCY

    when = np.arange(ticks, dtype=np.float64) / RATE
    return Sine(AMPLITUDE, FREQUENCY, ticks / RATE, ramp=EASED).sample(when)


def rms(error: FloatArray) -> float:
    """Return the rms of the second half."""
    return float(np.sqrt(np.mean(error[error.size // 2 :] ** 2)))


def plant() -> ProcessPlant:
    """Return the actuator, in a process of its own."""
    from bench.loop import SEED

    return simulated(PRESET, RATE, SEED)


def live(model: ModelFile, path: Path, ticks: int) -> list[Row]:
    """Run four processes, then control_loop and simulator."""
    from bench import loop

    gain = controllers(model).mode()
    assert gain is not None
    attenuation: dict[str, Any] = {
        'method': 'afc', 'orders': list(ORDERS), 'plant.gain': gain.gain,
        'plant.natural_frequency': gain.natural_frequency,
        'plant.damping_ratio': gain.damping_ratio,
    }  # fmt: skip
    links: dict[str, dict[str, Any]] = {'feedforward': {}, 'attenuation': attenuation}
    rows = []
    for name, together in (('four nodes', False), ('`control_loop`', True)):
        run = loop.loop(links, ticks, path, together=together)
        rate = 1.0 / float(np.median(np.diff(run.times[loop.WARM_UP :])))
        rows.append(Row(name, rate, 1e6 * run.cpu, rms(run.errors)))
    return rows


def controllers(model: ModelFile) -> Controllers:
    """Return the settings of the chain."""
    return Controllers(1.0 / RATE, LIMITS, model, attenuation=AttenuationSettings(orders=ORDERS))


def offline(model: ModelFile, ticks: int) -> Row:
    """Run what `compensate` does."""
    samples, actuator, links = wanted(ticks), plant(), controllers(model).links(by_mode=True)

    def run() -> FloatArray:
        for link in links:
            link.reset()
        actuator.reset()
        return closed_loop(samples, links, actuator, LIMITS, 1.0 / RATE).error

    try:
        return _timed('`compensate`', run, ticks)
    finally:
        actuator.close()


def _timed(name: str, run: Callable[[], FloatArray], ticks: int) -> Row:
    """Return the fastest of some runs; the first one compiles."""
    best, used = math.inf, math.inf
    for _ in range(RUNS):
        started, before = time.perf_counter(), time.process_time()
        error = run()
        best = min(best, time.perf_counter() - started)
        used = min(used, time.process_time() - before)
    return Row(name, ticks / best, 1e6 * used / ticks, rms(error))


def library(model: Path, folder: Path, ticks: int, steps: int) -> list[Row]:
    """Run the library against the same actuator, and in C against its own plant."""
    words = ['--rate', repr(RATE), '--set', f'attenuation.orders={list(ORDERS)}']
    if verb(['export', str(model), '--out', str(folder), *words]):
        raise SystemExit('the export failed')
    shared = folder / 'piezo.so'
    whole = ('-Wl,--whole-archive', folder / 'libpiezo.a', '-Wl,--no-whole-archive')
    subprocess.run(['gcc', '-shared', '-o', shared, *whole, '-lm'], check=True)
    actuator, samples = plant(), wanted(ticks)
    try:
        row = _timed(
            'library, called from Python', lambda: _stepped(shared, actuator, samples), ticks
        )
    finally:
        actuator.close()
    subprocess.run(['make', '-s', '-C', folder, 'bench'], check=True)
    done = subprocess.run(
        [folder / 'bench', '0', str(steps)], check=True, capture_output=True, text=True
    )
    each = json.loads(done.stdout)['loop_ns']
    return [row, Row('library, in C with its own plant', 1e9 / each, 1e-3 * each, None)]


def _stepped(shared: Path, actuator: ProcessPlant, samples: Samples) -> FloatArray:
    """Answer the errors of a library against an actuator."""
    found = ctypes.CDLL(str(shared))
    room = (ctypes.c_double * 100_000)()
    numbers, given, voltage = (
        (ctypes.c_double * 1000)(),
        (ctypes.c_double * 7)(),
        ctypes.c_double(),
    )
    if found.piezo_defaults(numbers) or found.piezo_init(room, numbers):
        raise SystemExit('the library does not begin')
    actuator.reset()
    columns = (
        samples.value, samples.velocity, samples.acceleration, samples.frequency, samples.phase,
    )  # fmt: skip
    errors = np.empty(samples.value.size)
    last = 0.0
    for k, row in enumerate(zip(*(column.tolist() for column in columns), strict=True)):
        given[:] = [*row, last, 1.0]
        if found.piezo_step(room, given, ctypes.byref(voltage)) < 0:
            raise SystemExit('the library refused a step')
        last = actuator.exchange(voltage.value)
        errors[k] = last - row[0]
    return errors
