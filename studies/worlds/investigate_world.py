"""Actuators that change after their model was identified, for the study of `investigate`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from piezo_hysteresis.experiments.planned_experiment import PlannedExperiment
from piezo_hysteresis.identification.identify import identify
from piezo_hysteresis.models import ModelFile, named
from piezo_hysteresis.records import Record
from piezo_hysteresis.waveforms import Waveform
from piezo_sim.plant import Plant
from piezo_sim.sweep import grid, simulate
from studies.worlds.simulated_world import KNOBS, PRESET, Hidden, draw

# Time at rest between two experiments [s].
PAUSE = 0.3
# Motion before the first experiment, unknown to the investigation [s], in part of the range.
EARLIER, PART = 3.0, (0.3, 0.9)
# What is no change of an actuator but another law of its loop.
OTHER_LAWS = ('play', 'preisach', 'bouc_wen')
EFFECTS = tuple(name for name in KNOBS if name not in OTHER_LAWS)


@dataclass(frozen=True)
class Changed:
    """An actuator whose model was identified before something changed."""

    key: str  # what it is called in the results
    model: ModelFile  # of the actuator as it was, with what it misses
    effects: tuple[str, ...]  # what changed, in the words of the simulator
    names: tuple[tuple[str, ...], ...]  # by which names each may be called
    overrides: Mapping[str, float | bool]  # the actuator as it is
    rate: float  # ticks per second [Hz]
    seed: int  # of its noise

    def right(self, found: tuple[str, ...]) -> bool:
        """Return whether what was named is what changed, and nothing else."""
        if len(found) != len(self.names):
            return False
        return all(any(name in each for name in found) for each in self.names)


class Bench:
    """An actuator that runs experiments in sequence and keeps its state between them.

    It moved before the first experiment, and no record shows that motion.
    """

    def __init__(self, changed: Changed) -> None:
        self._plant = Plant.from_preset(PRESET, changed.rate, changed.seed, changed.overrides)
        self.seconds = self._clock = 0.0
        self.extremes = [0.0, 0.0, 0.0]
        self._plant.run(earlier_motion(changed.seed, changed.rate))

    def run(self, experiment: PlannedExperiment) -> Record:
        """Return the record of an experiment."""
        return self._measured(experiment.name, experiment.voltage(self._plant.rate))

    def measured(self, name: str, waveform: Waveform) -> Record:
        """Return the record of any waveform."""
        ticks = np.arange(round(waveform.duration * self._plant.rate)) / self._plant.rate
        return self._measured(name, waveform.sample(ticks).value)

    def _measured(self, name: str, voltage: np.ndarray) -> Record:
        rate = self._plant.rate
        if self._clock:
            self._plant.run(np.zeros(round(PAUSE * rate)))
            self._clock += PAUSE
        change = np.diff(voltage, prepend=0.0, append=0.0) * rate
        low, high, fastest = self.extremes
        self.extremes = [
            min(low, float(voltage.min())),
            max(high, float(voltage.max())),
            max(fastest, float(np.abs(change).max())),
        ]
        self.seconds += voltage.size / rate
        start, self._clock = self._clock, self._clock + voltage.size / rate
        return Record(name, 1.0 / rate, voltage, self._plant.run(voltage), start=start)


def earlier_motion(seed: int, rate: float) -> np.ndarray:
    """Return a sine that stops anywhere, and the rest after it [V]."""
    rng = np.random.default_rng([seed, 31])
    times = np.arange(round(EARLIER * rate)) / rate
    level, frequency = rng.uniform(*PART), rng.uniform(1.0, 10.0)
    motion = level * np.sin(2.0 * np.pi * frequency * times)
    down = np.linspace(motion[-1], 0.0, round(0.05 * rate))
    return np.concatenate([motion, down, np.zeros(round(PAUSE * rate))])


def changed(kind: str, index: int, seed: int) -> Changed:
    """Draw an actuator: ``single`` or ``null``; the model is that of before it changed."""
    drawn = _drawn(kind, index, seed)
    before = {**drawn.world.overrides, **{f'effects.{name}': False for name in drawn.effects}}
    specs = grid('sine', [1.0, 5.0, 20.0, 50.0, 100.0], [1.0, 0.5], {'duration': 2.5, 'ramp': 0.2})
    records = simulate(PRESET, specs, before, drawn.seed, drawn.rate, actuator='bench')
    model = identify(records, named(drawn.world.baseline)).model
    return Changed(
        f'{kind}-{seed}-{index}',
        model,
        drawn.effects,
        drawn.names,
        drawn.world.overrides,
        drawn.rate,
        drawn.seed + 1,
    )


def _drawn(kind: str, index: int, seed: int) -> Hidden:
    if kind != 'single':
        return draw(kind, index, seed)
    # the table of effects is gone through in a random order, without those of other laws; where
    # it is gone through again, the actuators are others
    order = np.random.default_rng([seed, 26]).permutation(len(EFFECTS))
    name = EFFECTS[int(order[index % len(EFFECTS)])]
    return draw(kind, list(KNOBS).index(name), seed + index // len(EFFECTS))
