"""Attenuation of periodic errors of several axes by the matrix of gains.

Each axis has lines at multiples of the frequency of its reference. The errors of all axes in a
line change the voltages of all by the inverse of the matrix of gains at its frequency, which is
adaptive feedforward cancellation of each line in all axes together.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.axes.axes_record import AxesRecord
from piezo_hysteresis.axes.axes_tracking import WEAK
from piezo_hysteresis.axes.modal_fit import ModalDerivatives
from piezo_hysteresis.axes.modal_model import ModalModel, drive_of
from piezo_hysteresis.compensation.coupled.matrix_settings import MatrixSettings
from piezo_hysteresis.compensation.link import (
    ACCELERATION,
    COUNTS,
    DISPLACEMENT,
    FREQUENCY,
    GIVEN_SIZE,
    PHASE,
    POINT_SIZE,
    READ_DISPLACEMENT,
    VELOCITY,
    WATCH_SIZE,
    Measured,
    ReferencePoint,
    frozen_ticks,
    partner_of,
    reset_watch,
    write_given,
)
from piezo_hysteresis.errors import ModelError
from piezo_hysteresis.jit import inline_jit, jit, scratch
from piezo_hysteresis.numerics.linalg import failing_as

# Samples of the period in which the gains are found.
_PERIOD = 4096
# A window whose error, relative to the reference, has more than this times the power before the
# correction takes it back: one of the wrong sign reaches it before it does harm.
_HARM = 6.25
# All lines together learn at most at this share of the rate at which a mode decays: each is a
# resonator in a loop with the mode, and at the mode their gains add up (9 lines of 20 Hz by 0.3 a
# period swing a mode of 240 Hz with 3 % of damping).
_OF_DECAY = 0.25
# What becomes of the steps after that, and the least.
_LESS, _LEAST = 0.1, 1e-3

# Places in the settings.
DT, FROZEN, STEP, LARGEST, SPACING, WITH_MEAN, FASTEST = range(7)
SETTINGS_SIZE = 7
# Place of the displacement in a point and a measurement.
_READING = POINT_SIZE + READ_DISPLACEMENT
# Places in the guard.
_TICKS, _SQUARES, _SIZES, _BASE, _SHARE, _BACKED_OFF, _BOUNDED = range(7)
GUARD_SIZE = 7


def gains_of(model: ModalModel, lines: int = _PERIOD) -> tuple[FloatArray, float]:
    """Return the inverse of the matrix of gains by frequency, and its spacing [Hz].

    [V/m] (frequencies, inputs, outputs, 2), from 0 Hz to the highest mode; the plays have the gain
    that they have at the level of the identification.
    """
    layout, n = model.layout, np.arange(lines)
    waves = [np.sin(2.0 * np.pi * (i + 1) * n / lines) for i in range(layout.inputs)]
    voltage = math.sqrt(2.0) * model.full_level * np.stack(waves, 1)
    record = AxesRecord('gains', model.dt, voltage, np.zeros((lines, layout.outputs)), 1)
    drive = drive_of(record, layout)
    spacing = 1.0 / (lines * model.dt)
    top = float(np.exp(model.parameters['log_omega'].max()) / (2.0 * np.pi))
    with failing_as(ModelError('the model has no inverse: its axes do not move independently')):
        response = ModalDerivatives(model, drive, model.signals(drive)).response()
        inverse = np.linalg.pinv(response[: max(2, int(top / spacing))], WEAK)
    whole = np.concatenate([inverse[:1].real, inverse])
    return np.ascontiguousarray(np.stack([whole.real, whole.imag], -1)), spacing


def static_gains(model: ModalModel) -> FloatArray:
    """Return how far each axis moves with its own voltage, shape (axes,) [m/V]."""
    with failing_as(ModelError('the model has no inverse: its axes do not move independently')):
        return np.asarray(np.linalg.inv(gains_of(model)[0][0, :, :, 0]).diagonal())


@inline_jit
def gain_between(
    frequency: float, gains: FloatArray, spacing: float, answer: FloatArray
) -> None:  # answer (inputs outputs 2,) flat
    """Fill the inverse of the matrix of gains at a frequency, 0 beyond the last one."""
    place = frequency / spacing
    k = int(place)
    part = place - k
    inside = frequency > 0.0 and k + 1 < gains.shape[0]
    for i in range(gains.shape[1]):
        for o in range(gains.shape[2]):
            for c in range(2):
                value = 0.0
                if inside:
                    value = gains[k, i, o, c] + part * (gains[k + 1, i, o, c] - gains[k, i, o, c])
                answer[(i * gains.shape[2] + o) * 2 + c] = value


@inline_jit
def clear_lines(lines: FloatArray, guard: FloatArray) -> None:
    """Put every correction to 0 and measure the error without one again."""
    for k in range(lines.size):
        lines[k] = 0.0
    guard[_TICKS] = guard[_SQUARES] = guard[_SIZES] = guard[_BASE] = 0.0


@jit
def reset_matrix(
    watch: FloatArray, lines: FloatArray, known: FloatArray, guard: FloatArray
) -> None:
    """Reset everything but the settings."""
    for o in range(watch.size // WATCH_SIZE):
        reset_watch(watch[o * WATCH_SIZE : (o + 1) * WATCH_SIZE])
    clear_lines(lines, guard)
    for k in range(known.size):  # a frequency below 0 is none
        known[k] = -1.0
    guard[_SHARE], guard[_BACKED_OFF], guard[_BOUNDED] = 1.0, 0.0, 0.0


@inline_jit
def judge_window(
    errors: float, sizes: float, slowest: float, lines: FloatArray, guard: FloatArray, dt: float
) -> None:
    """Add the squares of one tick; take the corrections back where they did harm."""
    guard[_TICKS] += 1.0
    guard[_SQUARES] += errors
    guard[_SIZES] += sizes
    if guard[_TICKS] * dt * slowest < 1.0:
        return
    ratio = guard[_SQUARES] / guard[_SIZES] if guard[_SIZES] > 0.0 else 0.0
    guard[_TICKS] = guard[_SQUARES] = guard[_SIZES] = 0.0
    if guard[_BASE] == 0.0:
        guard[_BASE] = ratio
    elif ratio > _HARM * guard[_BASE]:
        clear_lines(lines, guard)
        guard[_SHARE] = max(_LESS * guard[_SHARE], _LEAST)
        guard[_BACKED_OFF] += 1.0


@jit
def attenuate(
    given: FloatArray,  # a point and a measurement of each axis (outputs, 9)
    settings: FloatArray,  # (SETTINGS_SIZE,)
    orders: FloatArray,  # without 0 (orders,)
    gains: FloatArray,  # see `gains_of`
    watch: FloatArray,  # (outputs WATCH_SIZE,)
    lines: FloatArray,  # of 1 + outputs orders, (inputs, 2) each, flat; the first is the mean
    known: FloatArray,  # of each line its frequency and its gains (inputs, outputs, 2), flat
    guard: FloatArray,  # (GUARD_SIZE,)
    answer: FloatArray,  # [V] (inputs,)
) -> None:
    """Subtract the correction of one tick from `answer`, and learn from the last errors."""
    outputs, inputs, count, dt = given.shape[0], answer.size, orders.size, settings[DT]
    room = 1 + 2 * inputs * outputs
    seen, slowest, errors, sizes = 0, math.inf, 0.0, 0.0
    places = scratch(outputs)
    for o in range(outputs):
        own = watch[o * WATCH_SIZE : (o + 1) * WATCH_SIZE]
        places[o] = partner_of(given[o, :POINT_SIZE], given[o, POINT_SIZE:], own, settings[FROZEN])
        places[o] += o * WATCH_SIZE if places[o] >= 0.0 else 0.0
        seen += places[o] >= 0.0
    # Errors of all axes at one tick, or nothing is learnt.
    for o in range(1, outputs):
        if given[o, POINT_SIZE] != given[0, POINT_SIZE]:
            seen = 0
    if seen == outputs:
        for o in range(outputs):
            at = int(places[o])
            error = given[o, _READING] - watch[at + DISPLACEMENT]
            frequency = watch[at + FREQUENCY]
            errors += error * error
            if frequency > 0.0:
                slowest = min(slowest, frequency)
                omega = 2.0 * math.pi * frequency
                speed, bend = watch[at + VELOCITY], watch[at + ACCELERATION]
                sizes += (speed / omega) ** 2 + (bend / (omega * omega)) ** 2
    if seen == outputs and slowest < math.inf:
        judge_window(errors, sizes, slowest, lines, guard, dt)
        learns = guard[_BASE] > 0.0
        for line in range(1 + outputs * count):
            axis, order = (line - 1) // count if line > 0 else 0, 0.0
            frequency, turn = slowest, 0.0
            if line > 0:
                order = orders[(line - 1) % count]
                frequency = watch[int(places[axis]) + FREQUENCY]
                turn = order * watch[int(places[axis]) + PHASE]
            elif settings[WITH_MEAN] == 0.0:
                continue
            inverse = known[line * room + 1 : (line + 1) * room]
            if known[line * room] != order * frequency:
                known[line * room] = order * frequency
                if line > 0:
                    gain_between(order * frequency, gains, settings[SPACING], inverse)
                else:
                    for i in range(inputs):
                        for o in range(outputs):
                            at = 2 * (i * outputs + o)
                            inverse[at], inverse[at + 1] = gains[0, i, o, 0], 0.0
            if not learns or frequency <= 0.0:
                continue
            pace = min(settings[STEP] * frequency, settings[FASTEST])
            weight = guard[_SHARE] * pace * dt
            weight *= 2.0 if line > 0 else 1.0
            cosine, sine = math.cos(turn), math.sin(turn)
            for i in range(inputs):
                real, imaginary = 0.0, 0.0
                for o in range(outputs):
                    error = given[o, _READING] - watch[int(places[o]) + DISPLACEMENT]
                    real += inverse[2 * (i * outputs + o)] * error
                    imaginary += inverse[2 * (i * outputs + o) + 1] * error
                # times exp(-i turn): what the error was at phase 0
                at = 2 * (line * inputs + i)
                x = lines[at] + weight * (real * cosine + imaginary * sine)
                y = lines[at + 1] + weight * (imaginary * cosine - real * sine)
                size = math.hypot(x, y)
                if size > settings[LARGEST]:
                    x, y = x * settings[LARGEST] / size, y * settings[LARGEST] / size
                    guard[_BOUNDED] += 1.0
                lines[at], lines[at + 1] = x, y
    for line in range(1 + outputs * count):
        turn = 0.0
        if line > 0:
            axis = (line - 1) // count
            if given[axis, FREQUENCY] <= 0.0:
                continue
            turn = orders[(line - 1) % count] * given[axis, PHASE]
        cosine, sine = math.cos(turn), math.sin(turn)
        for i in range(inputs):
            at = 2 * (line * inputs + i)
            answer[i] -= lines[at] * cosine - lines[at + 1] * sine


class MatrixAttenuation:
    """Attenuates periodic errors of all axes.

    A tick at which a sensor answers nothing, no number, or the same as before, teaches nothing:
    the correction that was learnt continues. `span` is the range of the voltage [V].
    """

    def __init__(self, model: ModalModel, settings: MatrixSettings, span: float) -> None:
        layout, orders = model.layout, [each for each in settings.orders if each > 0]
        self.orders = np.array(orders, float)
        self.gains, spacing = gains_of(model)
        largest = settings.largest_correction or 5.0 / 24.0 * span
        count = 1 + layout.outputs * len(orders)
        omega, damping = model.modes_at(np.array([model.full_level]))
        fastest = _OF_DECAY * float((omega * damping).min()) / count
        self.settings = np.array([
            model.dt, frozen_ticks(model.dt), settings.step, largest, spacing,
            float(0 in settings.orders), fastest,
        ])  # fmt: skip
        self.watch = np.zeros(layout.outputs * WATCH_SIZE)
        self.lines = np.zeros(count * layout.inputs * 2)
        self.known = np.zeros(count * (1 + 2 * layout.inputs * layout.outputs))
        self.guard = np.zeros(GUARD_SIZE)
        self._given = np.zeros((layout.outputs, GIVEN_SIZE))
        self.reset()

    def step(
        self,
        points: Sequence[ReferencePoint],
        received: FloatArray,  # [V] (inputs,)
        measured: Sequence[Measured | None],
    ) -> None:
        """Subtract the correction of one tick from the voltages `received`, in place."""
        for row, point, read in zip(self._given, points, measured, strict=True):
            write_given(row, point, read)
        attenuate(
            self._given, self.settings, self.orders, self.gains, self.watch,
            self.lines, self.known, self.guard, received,
        )  # fmt: skip

    def reset(self) -> None:
        """Reset everything but the settings."""
        reset_matrix(self.watch, self.lines, self.known, self.guard)

    def counters(self) -> dict[str, int]:
        """Return what was counted: corrections taken back or bounded, readings not used."""
        own = {'backed_off': int(self.guard[_BACKED_OFF]), 'bounded': int(self.guard[_BOUNDED])}
        unused = self.watch.reshape(-1, WATCH_SIZE)[:, : len(COUNTS)].sum(0)
        return own | {name: int(count) for name, count in zip(COUNTS, unused, strict=True)}
