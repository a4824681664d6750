"""The complete actuator chain, sample by sample, in one compiled kernel.

Within one sampling interval time runs on a dyadic grid: steps have the length ``dt / 2**level``
and start at multiples of their own length, so that the propagators of all steps are precomputed.
If no signal changes, a whole interval is one exact step.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from piezo_hysteresis.kernels.compile import inline_jit, jit
from piezo_sim.parts import amplifier, drive, sensor, slow, structure

LEVELS = 14
GRID = 1 << LEVELS  # units of time per sampling interval

NO_FAULT, SENSOR_DROPOUT, STUCK_SENSOR, AMPLIFIER_TRIP = 0, 1, 2, 3
TRIP_TIME = 0.02  # time constant of the discharge after a trip [s]


@inline_jit
def _fault(s: Any) -> int:
    if s.fault == NO_FAULT:
        return NO_FAULT
    if s.fault_ticks == 0:
        s.fault = NO_FAULT
    elif s.fault_ticks > 0:
        s.fault_ticks -= 1
    return int(s.fault)


@jit
def displacement(d: Any, s: Any) -> float:
    """Return the present true displacement [m]."""
    total = s.slow + s.jump + s.coupled + d.static_share * s.drive
    if d.dynamic:
        for i in range(structure.MODES):
            total += s.x[i]
    return float(total)


@inline_jit
def _velocity(d: Any, s: Any) -> float:
    total = 0.0
    for i in range(structure.MODES):
        total += s.v[i]
    return total


@inline_jit
def _measure(p: Any, d: Any, s: Any, fault: int, dt: float) -> float:
    seen = s.filtered if p.sensor.bandwidth > 0.0 else displacement(d, s)
    before = s.reading
    reading = sensor.read(p, s, seen, dt)
    if fault == STUCK_SENSOR:
        s.reading = before
        return float(before)
    return math.nan if fault == SENSOR_DROPOUT else float(reading)


@inline_jit
def _accept(p: Any, s: Any, command: float) -> None:
    q = p.amplifier
    if not (q.range_low <= command <= q.range_high):  # also rejects NaN
        s.refused += 1
        return
    if q.resolution > 0.0:
        command = min(
            max(np.rint(command / q.resolution) * q.resolution, q.range_low), q.range_high
        )
    s.command = command


@inline_jit
def _filter(d: Any, s: Any, level: int, start: tuple[float, float, float]) -> None:
    """Advance the low-pass of the sensor.

    The displacement in a step is a cubic Hermite polynomial.
    """
    end, h = displacement(d, s), d.step[level]
    static = d.static_share * s.drive
    moving = 0.5 * (start[0] - start[2] + end - static) + h / 8.0 * (start[1] - _velocity(d, s))
    middle = moving + d.static_share * s.drive_middle
    f = d.filter[level]
    s.filtered = f[0] * s.filtered + f[1] * start[0] + f[2] * middle + f[3] * end


@inline_jit
def _level(p: Any, d: Any, s: Any, position: int, end: int, moving: bool) -> int:
    """Return the coarsest level that is compatible with grid, signals and coming events."""
    level = int(d.level_moving if moving else d.level_still)
    if d.nonlinear:
        quick = structure.rate_of_change(p, d, s) * d.step[0]
        while level < LEVELS and quick > d.stride * (1 << level):
            level += 1
        if d.memory:
            ahead = structure.reversal(p, d, s, (s.tick + position / GRID) * d.step[0])
            finest = min(LEVELS, level + 4)
            while level < finest and 0.0 < ahead < d.step[level]:
                level += 1
    while level < LEVELS:
        length = GRID >> level
        if position & (length - 1) == 0 and position + length <= end:
            break
        level += 1
    return level


@inline_jit
def _before_corner(
    p: Any, d: Any, s: Any, level: int, target: float, tau: float, slew: float
) -> int:
    """Return the level whose step ends before a corner of voltage or strain.

    A corner inside the finest step causes an error of second order in that step.
    """
    ahead = amplifier.corner(s.voltage, target, tau, slew)
    while level < d.level_corner and 0.0 < ahead < d.step[level]:
        level += 1
    while level < d.level_corner:
        end = amplifier.toward(s.voltage, target, d.step[level], tau, slew)
        if drive.kink(p, d, s, end) == end:
            break
        level += 1
    return level


@inline_jit
def _advance(p: Any, d: Any, s: Any, first: int, last: int, target: float, dt: float) -> None:
    """Advance the plant from grid time `first` to `last` with a constant target [V]."""
    tau, slew = p.amplifier.lag_time_constant, p.amplifier.slew_rate
    if s.fault == AMPLIFIER_TRIP:
        tau = max(tau, TRIP_TIME)
    if tau == 0.0 and slew >= amplifier.FAR:
        s.voltage = target
        s.drive = drive.follow(p, d, s, target)
    position = first
    unit = dt / GRID
    while position < last:
        moving = s.voltage != target
        level = _level(p, d, s, position, last, moving)
        if moving:
            level = _before_corner(p, d, s, level, target, tau, slew)
        h = d.step[level]
        w0 = wh = w1 = s.drive
        if moving:
            start = s.voltage
            wh = drive.follow(p, d, s, amplifier.toward(start, target, 0.5 * h, tau, slew))
            s.voltage = amplifier.toward(start, target, h, tau, slew)
            if abs(s.voltage - target) < 1e-11 * (1e-3 + abs(target)):
                s.voltage = target
            w1 = drive.follow(p, d, s, s.voltage)
        before = (displacement(d, s), _velocity(d, s), d.static_share * s.drive)
        s.drive_middle, s.drive = wh, w1
        if d.dynamic:
            structure.step(p, d, s, level, w0, wh, w1, s.tick * dt + position * unit)
        if p.sensor.bandwidth > 0.0:
            _filter(d, s, level, before)
        s.drive_mean += (w0 + 4.0 * wh + w1) / 6.0 / (1 << level)
        position += GRID >> level


@inline_jit
def _interval(p: Any, d: Any, s: Any, history: Any, fault: int, dt: float) -> None:
    """Advance the plant over one sampling interval."""
    if drive.start_interval(p, s, dt):
        s.drive = drive.follow(p, d, s, s.voltage)
    size = history.size
    history[s.tick % size] = s.command
    delay = p.amplifier.delay + p.amplifier.delay_per_volt * abs(s.command)
    units = min(int(delay / dt * GRID + 0.5), (size - 2) * GRID)
    whole_ticks, split = units >> LEVELS, units & (GRID - 1)
    s.drive_mean = 0.0
    for part in range(2):
        first, last = (0, split) if part == 0 else (split, GRID)
        back = whole_ticks + 1 if part == 0 else whole_ticks
        if last > first:
            target = history[(s.tick + size - back) % size]
            target = min(max(target, p.amplifier.clip_low), p.amplifier.clip_high)
            if fault == AMPLIFIER_TRIP:
                target = 0.0
            _advance(p, d, s, first, last, target, dt)
    slow.advance(p, d, s, s.drive_mean, dt)
    if p.switching.step != 0.0:
        if abs(s.voltage) >= p.switching.threshold:
            s.jump = p.switching.step if s.voltage > 0.0 else 0.0
    else:
        s.jump = 0.0


@jit
def run(
    commands: Any, readings: Any, parameters: Any, derived: Any, state: Any, history: Any
) -> None:
    """Measure, then act, for every command: the kernel of `Plant`."""
    p, d, s = parameters[0], derived[0], state[0]
    dt = d.step[0]
    for k in range(commands.size):
        fault = _fault(s)
        readings[k] = _measure(p, d, s, fault, dt)
        _accept(p, s, commands[k])
        _interval(p, d, s, history, fault, dt)
        s.tick += 1


@jit
def settle(parameters: Any, derived: Any, state: Any) -> None:
    """Set the drive to the present hysteresis memory, without a change of the voltage."""
    p, d, s = parameters[0], derived[0], state[0]
    s.drive = drive.follow(p, d, s, s.voltage)
