"""State of a simulated controller: servo, wave generator, data recorder, errors and actuator.

One axis; with the servo off, wave generator and ``SVA`` set its voltage, with the servo on its
position. Time follows the clock of the computer in servo ticks.
"""

from __future__ import annotations

import copy
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from piezo_sim.plant import FloatArray, Plant

#: Points of a wave table and of a record table.
MOST_POINTS = 1 << 17
_AT_ONCE = 1 << 15  # largest number of ticks per simulation call
_LOOP = 20  # ticks per step of the closed loop
_GAIN = 0.01  # share of the error that the closed loop takes away in a step
_ON_TARGET = 2e-3  # share of the travel within which an axis is on target
_IDLE = 2.0  # longest simulated part of a time without client and wave [s]


class GcsError(Exception):
    """A rejected command; ``ERR?`` returns its number."""

    def __init__(self, number: int) -> None:
        super().__init__(str(number))
        self.number = number


#: Error numbers of rejected commands, as in the manuals.
SYNTAX, UNKNOWN, SERVO, LIMITS, STOPPED, AXIS, RANGE, PARAMETER = 1, 2, 5, 7, 10, 15, 17, 54

#: Recordable quantities: commanded position, position, output voltage.
TARGET, POSITION, OUTPUT = 1, 2, 7


@dataclass
class Generator:
    """State of the wave generator."""

    table: int = 0  # active wave table, 0 for none
    cycles: int = 0  # number of repetitions; 0 for unlimited
    divider: int = 1  # servo ticks per point
    is_straight: bool = False  # whether the output moves in a straight line from point to point
    offset: float = 0.0  # added to every point [V]
    first: int = -1  # tick of its start, -1 if stopped


@dataclass
class DataRecorder:
    """State of the data recorder: two tables, recorded from the start of the generator."""

    options: dict[int, int] = field(default_factory=lambda: {1: POSITION, 2: OUTPUT})
    divider: int = 1  # servo ticks per sample
    first: int = -1  # tick of the first sample, -1 before any
    samples: dict[int, list[FloatArray]] = field(default_factory=dict)  # recorded values
    _counts: dict[int, int] = field(default_factory=dict)

    def count(self, table: int) -> int:
        """Return the number of samples in a table."""
        return self._counts.get(table, 0)

    def append(self, table: int, values: FloatArray) -> None:
        """Add samples to a table."""
        self.samples.setdefault(table, []).append(values)
        self._counts[table] = self.count(table) + values.size

    def restart(self, tick: int) -> None:
        """Record from a tick on."""
        self.first, self.samples, self._counts = tick, {}, {}


class SimulatedController:
    """A controller and its actuator."""

    def __init__(
        self, plant: Plant, speed: float = 1.0, now: Callable[[], float] = time.monotonic
    ) -> None:  # now [s]
        self.plant, self.speed, self._now = plant, speed, now
        self.low = float(plant.parameters['amplifier.range_low'])
        self.high = float(plant.parameters['amplifier.range_high'])
        self.tables: dict[int, FloatArray] = {}
        self.generator, self.recorder = Generator(), DataRecorder()
        self.servo, self.error = False, 0
        self.voltage = self.position = 0.0
        self.target = 0.0  # in closed loop [m]
        self._set, self._tick, self._start, self._skipped = 0.0, 0, now(), 0

    @cached_property
    def travel(self) -> tuple[float, float]:
        """Lowest and highest position, by a slow way over the range of the voltage [m]."""
        way = np.interp(np.arange(12_000), [0, 4000, 12_000], [0.0, self.low, self.high])
        found = copy.deepcopy(self.plant).run(way)
        return float(found.min()), float(found.max())

    @property
    def is_on_target(self) -> bool:
        """Whether the position is that of the closed loop, or the loop is open."""
        if not self.servo:
            return True
        low, high = self.travel
        return abs(self.target - self.position) <= _ON_TARGET * (high - low)

    def switch_servo(self, is_on: bool) -> None:
        """Switch the servo; the voltage is held."""
        self.advance()
        if is_on and not self.servo:
            self.target = min(max(self.position, self.travel[0]), self.travel[1])
        self.servo, self._set = is_on, self.voltage

    def move(self, position: float) -> None:
        """Set the target of the closed loop [m], as ``MOV`` does."""
        if not self.servo:
            raise GcsError(SERVO)
        if not self.travel[0] <= position <= self.travel[1]:
            raise GcsError(LIMITS)
        self.advance()
        self.target = position

    def set_voltage(self, voltage: float) -> None:
        """Set the output voltage [V], as ``SVA`` does."""
        if self.servo:
            raise GcsError(SERVO)
        if not self.low <= voltage <= self.high:
            raise GcsError(LIMITS)
        self.advance()
        self._set = voltage

    def start(self) -> None:
        """Start the wave generator and the recorder."""
        wave = self.tables.get(self.generator.table)
        if wave is None:
            raise GcsError(RANGE)
        low, high = (1e6 * end for end in self.travel) if self.servo else (self.low, self.high)
        shifted = wave + self.generator.offset
        if shifted.min() < low or shifted.max() > high:
            raise GcsError(LIMITS)
        self.advance()
        self.generator.first = self._tick
        self.restart_recorder()

    def restart_recorder(self) -> None:
        """Record from the present tick on."""
        self.recorder.restart(self._tick)

    def stop(self) -> None:
        """Stop the wave generator; the voltage keeps its value."""
        self.advance()
        if self.generator.first >= 0:
            self._set = self.voltage
            self.generator.first = -1

    @property
    def is_running(self) -> bool:
        """Whether the wave generator is active."""
        self.advance()
        return self.generator.first >= 0

    def advance(self) -> None:
        """Simulate up to the present clock time."""
        due = self._due()
        while self._tick < due:
            idle = due - self._tick - round(_IDLE * self.plant.rate)
            if self.generator.first < 0 and idle > 0:
                self._skipped += idle
                due -= idle
            count = min(due - self._tick, _LOOP if self.servo else _AT_ONCE)
            commands = self._closed(count) if self.servo else self._commands(count)
            readings = self.plant.run(commands)
            self._record(commands, readings)
            self._tick += count
            self.voltage, self.position = float(commands[-1]), float(readings[-1])
            if self.generator.first >= 0 and self._tick >= self._end:
                self._set, self.generator.first = self.voltage, -1

    @property
    def _end(self) -> float:
        """Tick after the end of the wave."""
        made, wave = self.generator, self.tables[self.generator.table]
        if made.cycles == 0:
            return math.inf
        return made.first + made.cycles * wave.size * made.divider

    def _due(self) -> int:
        if math.isfinite(self.speed):
            passed = (self._now() - self._start) * self.speed
            return int(passed * self.plant.rate) - self._skipped
        if self.generator.first < 0:
            return self._tick + 1
        return int(min(self._end, self._tick + MOST_POINTS * self.generator.divider))

    def _commands(self, count: int) -> FloatArray:
        """Return the voltage of the next ticks [V]."""
        commands = np.full(count, self._set)
        made = self.generator
        if made.first >= 0:
            wave = self.tables[made.table] + made.offset
            ticks = np.arange(self._tick, self._tick + count)
            place, part = np.divmod(ticks - made.first, made.divider)
            commands = wave[place % wave.size]
            if made.is_straight:
                last = made.cycles * wave.size - 1 if made.cycles else np.inf
                following = wave[np.minimum(place + 1, last).astype(int) % wave.size]
                commands = commands + (following - commands) * (part / made.divider)
            commands[ticks >= self._end] = wave[-1]
        return commands

    def _closed(self, count: int) -> FloatArray:
        """Return the voltage of the next ticks in closed loop, where a wave is in um [V]."""
        if self.generator.first >= 0:
            self.target = 1e-6 * float(self._commands(1)[0])
        gain = (self.high - self.low) / (self.travel[1] - self.travel[0])
        unlimited = self._set + _GAIN * gain * (self.target - self.position)
        self._set = min(max(unlimited, self.low), self.high)
        return np.full(count, self._set)

    def _record(self, commands: FloatArray, readings: FloatArray) -> None:
        if self.recorder.first < 0:
            return
        ticks = np.arange(self._tick, self._tick + commands.size) - self.recorder.first
        kept = ticks % self.recorder.divider == 0
        for table, option in self.recorder.options.items():
            room = MOST_POINTS - self.recorder.count(table)
            if room <= 0:
                continue
            source = {
                POSITION: 1e6 * readings,
                TARGET: np.full(commands.size, 1e6 * self.target) if self.servo else commands,
            }.get(option, commands)
            self.recorder.append(table, source[kept][:room])
