"""Feedforward of several axes, tick by tick: voltages of all from references of all.

The transfer functions of the modes are inverted as a series in velocity and acceleration, which
are known of a reference; the plays and powers of voltage and elongation are inverted exactly.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from piezo_hysteresis.arrays import ComplexArray, FloatArray
from piezo_hysteresis.axes.modal_model import RATE_UNIT, ModalModel
from piezo_hysteresis.blocks._plays import play
from piezo_hysteresis.compensation.link import ReferencePoint
from piezo_hysteresis.errors import ModelError
from piezo_hysteresis.jit import inline_jit, jit, scratch
from piezo_hysteresis.numerics.linalg import failing_as

# Powers of s of the inverse: displacement, velocity and acceleration.
ORDERS = 3
# Points of the circle on which the series is found, and its radius, of the lowest mode.
_POINTS, _RADIUS = 32, 0.1
# Turns in which the memory that moves the displacement directly is found.
_TURNS = 4
# Doublings and halvings of the span in which a voltage is sought, and its relative width.
_STEPS, _NARROW = 60, 1e-13


class DecouplingNumbers(NamedTuple):
    """A modal model as the kernel reads it."""

    drive: FloatArray  # driving voltage, [V/m], [V s/m], [V s^2/m] (3, inputs, outputs)
    strain: FloatArray  # elongation, the same
    rows: FloatArray  # displacement that a memory makes [m/V] (memories, inputs, outputs)
    products: FloatArray  # displacement of products of elongations (pairs, outputs) [m/V^2]
    widths: FloatArray  # of the plays of the voltage [V] (plays,)
    powers: FloatArray  # of the voltage (powers,)
    weights: FloatArray  # (plays + powers, inputs)
    strain_widths: FloatArray  # of the plays of the elongation [V] (strain plays,)
    strain_weights: FloatArray  # (strain plays, inputs)
    square: FloatArray  # of the elongation [1/V] (inputs,)
    cube: FloatArray  # [1/V^2] (inputs,)

    @property
    def memory_size(self) -> int:
        """Length of the memory of the kernel: voltages, plays and powers, plays of elongations."""
        inputs = self.square.size
        return int(inputs * (1 + self.weights.shape[0] + self.strain_widths.size) + 1)


def decoupling_numbers(model: ModalModel) -> DecouplingNumbers:
    """Return the numbers of a model at the level of its identification, without its joints."""
    layout, found = model.layout, model.parameters
    inputs, outputs, modes = layout.inputs, layout.outputs, layout.modes
    omega, _ = model.modes_at(np.array([model.full_level]))
    radius = _RADIUS * float(omega.min())
    s = radius * np.exp(2j * np.pi * np.arange(_POINTS) / _POINTS)
    through, compliance = transfers(model, s)
    with failing_as(ModelError('the model has no inverse: its axes do not move independently')):
        drive = np.asarray(np.linalg.pinv(through), complex)
    direct = model.output[2 * modes + layout.parts :]
    pairs, all_pairs = (n * (n + 1) // 2 * layout.products for n in (inputs, layout.parts))
    return DecouplingNumbers(
        _series(drive, radius), _series(compliance @ drive, radius),
        np.ascontiguousarray(direct[all_pairs:].reshape(layout.memories, inputs, outputs)),
        np.ascontiguousarray(direct[:pairs].reshape(pairs, outputs)),
        np.asarray(layout.voltage_plays, float), np.asarray(layout.powers, float),
        np.ascontiguousarray(found['voltage_weights']),
        np.asarray(layout.elongation_plays, float),
        np.ascontiguousarray(found['elongation_weights'][:, :inputs]),
        np.array(found['square'][:inputs]), np.array(found['cube'][:inputs]),
    )  # fmt: skip


def transfers(model: ModalModel, s: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
    """Return displacement [m/V] and elongation for the driving voltage, at the full level."""
    # s [rad/s] (points,) -> (points, outputs, inputs), (points, inputs, inputs)
    found, modes, inputs = model.parameters, model.layout.modes, model.layout.inputs
    omega, damping = (each[0] for each in model.modes_at(np.array([model.full_level])))
    shape, rate_shape = found['shape'][:inputs], found['rate_shape'][:inputs]
    at = s[:, None]
    inverse = 1.0 / (at**2 + 2.0 * damping * omega * at + omega**2)
    by_rate = omega * (at + 2.0 * damping * omega) * inverse
    driven = (omega**2 * inverse)[:, :, None] * shape.T
    driven = driven + by_rate[:, :, None] * rate_shape.T  # (points, modes, inputs)
    reading = model.output[:modes] + RATE_UNIT * at[:, :, None] * model.output[modes : 2 * modes]
    through = np.einsum('lki,lko->loi', driven, reading)
    through = through + model.output[2 * modes : 2 * modes + inputs].T
    late = np.exp(-s * found['delay'][0])[:, None, None]
    return np.asarray(late * through), np.asarray(shape @ driven)


def _series(values: ComplexArray, radius: float) -> FloatArray:
    """Return the first coefficients of a power series from its values on a circle."""
    found = np.fft.fft(values, axis=0)[:ORDERS].real / len(values)
    return np.ascontiguousarray(found / radius ** np.arange(ORDERS)[:, None, None])


@inline_jit
def forced_by(
    u: float, i: int, widths: FloatArray, powers: FloatArray, weights: FloatArray,
    state: FloatArray,
) -> float:  # fmt: skip
    """Return the driving voltage that the voltage `u` of axis `i` makes [V].

    `state` are the plays, (plays inputs,) flat: a view of another shape needs code of numba, which
    a library without Python does not have.
    """
    inputs = weights.shape[1]
    total = u
    for j in range(widths.size):
        total += weights[j, i] * play(u, state[j * inputs + i], widths[j])
    for j in range(powers.size):
        total += weights[widths.size + j, i] * power_of(u, powers[j])
    return total


@inline_jit
def power_of(u: float, power: float) -> float:
    """Return a whole power, by products: the same bits on every machine."""
    total = 1.0
    for _ in range(int(power)):
        total *= u
    return total


@inline_jit
def voltage_for(
    forced: float, start: float, i: int, widths: FloatArray, powers: FloatArray,
    weights: FloatArray, state: FloatArray,
) -> float:  # fmt: skip
    """Return the voltage nearest to `start` that makes `forced`; not a number if none does."""
    gap = forced_by(start, i, widths, powers, weights, state) - forced
    if abs(gap) <= _NARROW * (1.0 + abs(forced)):
        return start
    step, near, far, found = abs(gap), start, start, False
    for _ in range(_STEPS):
        far = start - math.copysign(step, gap)
        if (forced_by(far, i, widths, powers, weights, state) - forced) * gap <= 0.0:
            found = True
            break
        near = far
        step *= 2.0
    if not found:
        return math.nan
    for _ in range(_STEPS):
        middle = 0.5 * (near + far)
        if (forced_by(middle, i, widths, powers, weights, state) - forced) * gap > 0.0:
            near = middle
        else:
            far = middle
        if abs(far - near) <= _NARROW * (1.0 + abs(far)):
            break
    return far


@jit
def decouple(
    points: FloatArray,  # displacement, velocity, acceleration [m ...] (outputs, 3)
    drive: FloatArray, strain: FloatArray, rows: FloatArray, products: FloatArray,
    widths: FloatArray, powers: FloatArray, weights: FloatArray, strain_widths: FloatArray,
    strain_weights: FloatArray, square: FloatArray, cube: FloatArray,
    memory: FloatArray,  # (memory_size,)
    answer: FloatArray,  # [V] (inputs,)
) -> None:  # fmt: skip
    """Fill the voltages of one tick, see `DecouplingNumbers`.

    Where there is none, the memory stays, the last voltages are the answer, and it is counted.
    """
    inputs, outputs, plays = drive.shape[1], drive.shape[2], widths.size
    memories = weights.shape[0]
    kept = inputs * (1 + memories)
    last = memory[:inputs]
    state, strains = memory[inputs:kept], memory[kept : memory.size - 1]
    found, seen = scratch((memories + 1, inputs)), scratch((ORDERS, outputs))
    e = scratch(inputs)
    for o in range(outputs):
        for d in range(1, ORDERS):
            seen[d, o] = points[o, d]
    for i in range(inputs):
        answer[i], e[i] = last[i], 0.0
        for j in range(memories):
            found[j, i] = state[j * inputs + i]
    sound = True
    for turn in range(_TURNS):
        for o in range(outputs):
            left = points[o, 0]
            for j in range(memories):
                for i in range(inputs):
                    left -= rows[j, i, o] * found[j, i]
            if turn > 0 and products.shape[0] > 0:
                pair = 0
                for i in range(inputs):
                    for k in range(i + 1):
                        left -= products[pair, o] * e[i] * e[k]
                        pair += 1
            seen[0, o] = left
        for i in range(inputs):
            forced, stretched = 0.0, 0.0
            for d in range(ORDERS):
                for o in range(outputs):
                    forced += drive[d, i, o] * seen[d, o]
                    stretched += strain[d, i, o] * seen[d, o]
            e[i] = stretched
            forced -= (
                square[i] * stretched * stretched + cube[i] * stretched * stretched * stretched
            )
            for j in range(strain_widths.size):
                forced -= strain_weights[j, i] * play(
                    stretched, strains[j * inputs + i], strain_widths[j]
                )
            u = voltage_for(forced, answer[i], i, widths, powers, weights, state)
            if not math.isfinite(u):
                sound = False
                break
            answer[i] = u
            for j in range(plays):
                found[j, i] = play(u, state[j * inputs + i], widths[j])
            for j in range(powers.size):
                found[plays + j, i] = power_of(u, powers[j])
        if not sound:
            break
    for i in range(inputs):
        if not sound:
            answer[i] = last[i]
            continue
        last[i] = answer[i]
        for j in range(memories):
            state[j * inputs + i] = found[j, i]
        for j in range(strain_widths.size):
            strains[j * inputs + i] = play(e[i], strains[j * inputs + i], strain_widths[j])
    if not sound:
        memory[memory.size - 1] += 1.0


class Decoupling:
    """The feedforward of a modal model, from rest at 0 V."""

    def __init__(self, model: ModalModel) -> None:
        self.numbers = decoupling_numbers(model)
        self.memory = np.zeros(self.numbers.memory_size)
        self._points = np.zeros((model.layout.outputs, ORDERS))
        self._answer = np.zeros(model.layout.inputs)

    def step(self, points: Sequence[ReferencePoint]) -> FloatArray:
        """Return the voltages of one tick for the references of all axes, shape (inputs,) [V]."""
        for row, point in zip(self._points, points, strict=True):
            row[0], row[1], row[2] = point.displacement, point.velocity, point.acceleration
        decouple(self._points, *self.numbers, self.memory, self._answer)
        return self._answer

    def reset(self) -> None:
        """Return to rest at 0 V."""
        self.memory[:] = 0.0

    def counters(self) -> dict[str, int]:
        """Return at how many ticks there was no voltage for the references."""
        return {'no_inverse': int(self.memory[-1])}
