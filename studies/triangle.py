"""Triangles on ordinary stages: how much of the error the defaults leave, by the sensor noise.

Every stage is recorded as a user would, identified, and tracked in lock-step with the limits and
settings that follow from its model. The first stage is the one that settings were chosen on, the
others are only examined. A period is a whole number of ticks.

    python studies/triangle.py [--stages 5] [--seconds 8]
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

if not __package__:
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np

import piezo_hysteresis as ph
from bench.quick import parsed
from piezo_hysteresis.compensation.controllers import Controllers
from piezo_hysteresis.compensation.harmonics.lines import AttenuationSettings
from piezo_hysteresis.compensation.offline_loop import closed_loop, tracking_metrics
from piezo_hysteresis.compensation.operating_limits import operating_limits
from piezo_hysteresis.waveforms import Triangle
from studies.goals import Goals
from studies.ordinary_stage import CALIBRATION, Draw, Stage, drawn, records

# Largest error that is left, as a multiple of the sensor noise, and periods of the mode in one
# of the triangle.
GOAL, SLOWER = 2.5, 16.0
MODEL = 'prandtl_ishlinskii+mode'


@dataclass(frozen=True)
class Tracked:
    """Rms errors of one stage [m]: gain alone, inverse, and inverse with attenuation."""

    gain: float
    inverse: float
    attenuated: float


def track(draw: Draw, seed: int, seconds: float, recorded: float) -> Tracked:
    """Identify a stage and track a triangle over two thirds of its range."""
    with tempfile.TemporaryDirectory() as folder:
        data = records(draw, Path(folder) / 'train', seed, recorded)
        found = ph.identify(data, model=MODEL)
    model, dt = found.model, 1.0 / draw.rate
    limits = operating_limits(model).limits
    ticks = draw.rate / (draw.mode / SLOWER)  # a whole number, or corners fall between ticks
    wave = Triangle(
        0.33 * draw.stroke, seconds, offset=0.45 * draw.stroke, frequency=draw.rate / round(ticks)
    )
    samples = wave.sample(np.arange(round(seconds * draw.rate), dtype=np.float64) * dt)
    chosen = Controllers(dt, limits, model, attenuation=AttenuationSettings())
    errors = []
    for links in ([chosen.straight()], [chosen.inverse()], chosen.links()):
        run = closed_loop(samples, links, Stage(draw, seed + 100), limits, dt)
        errors.append(tracking_metrics(run, 0.5 * seconds).rms)
    return Tracked(*errors)


def main() -> int:
    """Print a row for each stage."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--stages', type=int, default=5, help='stages that are only examined')
    parser.add_argument('--first', type=int, default=11, help='seed of the first of them')
    parser.add_argument('--seconds', type=float, default=8.0, help='length of a triangle [s]')
    parser.add_argument('--recorded', type=float, default=1.0, help='length of a record [s]')
    asked = parsed(parser, stages=0, seconds=2.0, recorded=0.5)
    goals = Goals()
    goals.heading('Triangles, rms error over the second half [nm]')
    stages = [
        (0, CALIBRATION),
        *((k, drawn(k)) for k in range(asked.first, asked.first + asked.stages)),
    ]
    for seed, draw in stages:
        row = track(draw, seed, asked.seconds, asked.recorded)
        goals.note(
            f'{draw.low:.4g} to {draw.high:.4g} V, {1e6 * draw.stroke:.3g} µm, '
            f'{draw.rate:.0f} Hz, mode {draw.mode:.0f} Hz ({draw.damping:.3f}), '
            f'noise {1e9 * draw.noise:.2g}: '
            f'gain {1e9 * row.gain:.3g}, inverse {1e9 * row.inverse:.3g}, '
            f'attenuated {1e9 * row.attenuated:.3g}'
        )
        if not asked.quick:
            what = f'stage {seed}, multiple of the noise'
            goals.check(what, row.attenuated / draw.noise, GOAL, '')
    return goals.finish()


if __name__ == '__main__':
    raise SystemExit(main())
