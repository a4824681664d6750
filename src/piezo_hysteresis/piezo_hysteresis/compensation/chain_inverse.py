"""A numeric inverse for any chain of blocks, block by block from the reading to the voltage."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Block, Slot
from piezo_hysteresis.blocks.nonlinear_mode import rubbed
from piezo_hysteresis.compensation.base import Limits
from piezo_hysteresis.compensation.block_inverse import BlockInverse
from piezo_hysteresis.compensation.inverse import InverseLink
from piezo_hysteresis.compensation.physical import structure_coefficients
from piezo_hysteresis.compensation.structure_inverse import (
    CORNERS,
    STATE_SIZE,
    carry_ahead,
    lift_droop,
)
from piezo_hysteresis.errors import CompensationError
from piezo_hysteresis.models.chain import Model

# Blocks that move the structure: inverted on the derivatives of the reference.
_DYNAMIC = ('mode', 'mass_spring', 'resonance', 'nonlinear_mode', 'mode_pair', 'eased_mode')
_DELAYS = ('transport_delay', 'delayed_motion')


class _Spring(NamedTuple):
    """What a nonlinear mode has beyond a linear one, as `nonlinear_mode` names it."""

    cubic: float = 0.0
    friction: float = 0.0
    presliding: float = 1e-6
    breakaway: float = 1.0
    stribeck: float = 1e-3


@dataclass
class _Stages:
    """A chain taken apart for its inverse, from the voltage to the reading.

    Attributes
    ----------
    dt : float
        Sampling interval [s].
    front, back : list of BlockInverse
        Blocks before and behind the dynamic structure.
    k1, k2, lead : float
        Structure [s], [s^2] and lead [s].
    rest : float
        Reading at rest [m].
    spring : _Spring
        Cubic stiffness and friction of a nonlinear mode.
    bristle, moved : float
        Memory of its friction, and the displacement it belongs to [m].
    """

    dt: float
    front: list[BlockInverse] = field(default_factory=list)
    back: list[BlockInverse] = field(default_factory=list)
    k1: float = 0.0
    k2: float = 0.0
    lead: float = 0.0
    rest: float = 0.0
    spring: _Spring = field(default_factory=_Spring)
    bristle: float = 0.0
    moved: float = 0.0

    def restoring_force(self, x: float) -> float:
        """Answer what a nonlinear spring and friction add to the target at `x` [m]."""
        cubic, friction, presliding, breakaway, stribeck = self.spring
        stretch = cubic * x * x
        if stretch < 0.0:
            stretch = 0.8 * stretch / (0.8 - stretch)
        if friction > 0.0 and x != self.moved:
            move = x - self.moved
            self.bristle = rubbed(self.bristle, move, self.dt, presliding, breakaway, stribeck)
        self.moved = x
        return stretch * x + friction * self.bristle

    @property
    def solvers(self) -> list[BlockInverse]:
        """Every block, from the voltage to the reading."""
        return [*self.front, *self.back]


def _take_apart(model: Model, packed: FloatArray, dt: float, scale: float) -> _Stages:
    stages = _Stages(dt)
    first = 0
    for block in model.blocks:
        own = packed[first : first + len(block.parameters)].copy()
        first += len(block.parameters)
        if block.slot is Slot.ADDED:
            continue
        if block.name in _DELAYS:
            stages.lead += float(own[0])
        elif block.name in _DYNAMIC:
            share, k1, k2 = _structure(block, own)
            stages.k1 += share * k1
            stages.k2 += share * k2
            stages.lead += share * 0.5 * dt
            if block.name == 'eased_mode' and own[2] > 0.0:
                # dt / expm1(dt / ease) in a form that does not overflow for a fast ease
                steps = dt / float(own[2])
                stages.lead += float(own[2]) + dt * math.exp(-steps) / math.expm1(-steps)
            if block.name == 'nonlinear_mode':
                stages.spring = _Spring(*own[2:].tolist())
        else:
            solver = BlockInverse(block, own, dt, 1e-4 * scale)
            if not (math.isfinite(solver.first_slope) and solver.first_slope > 0.0):
                raise CompensationError(
                    f'block {block.name} does not rise with its input at rest (slope '
                    f'{solver.first_slope:g}), so the model has no inverse; identify with bounds '
                    'that keep it rising'
                )
            behind = stages.k2 > 0.0 or block.slot in (Slot.SLOW, Slot.SENSOR)
            (stages.back if behind else stages.front).append(solver)
            stages.rest = solver.trial(stages.rest)
            scale *= solver.first_slope
    return stages


def _structure(block: Block, own: FloatArray) -> tuple[float, float, float]:
    """Return the share that a dynamic block carries and its k1 and k2.

    Several blocks count by the sum of these, each with the half sample that its hold takes: exact
    for one, right to second order in frequency over natural frequency for more.
    """
    values = [float(value) for value in own]
    if block.name == 'mode_pair':
        share = values[4]
        both = [
            structure_coefficients({'natural_frequency': f, 'damping_ratio': damping})
            for f, damping in (values[:2], values[2:4])
        ]
        k1, k2 = ((1.0 - share) * a + share * b for a, b in zip(*both, strict=True))
        return 1.0, k1, k2
    if block.name in ('resonance', 'nonlinear_mode', 'eased_mode'):
        k1, k2 = structure_coefficients(
            {'natural_frequency': values[0], 'damping_ratio': values[1]}
        )
        return (values[2] if block.name == 'resonance' else 1.0), k1, k2
    names = (parameter.name for parameter in block.parameters)
    return 1.0, *structure_coefficients(dict(zip(names, values, strict=True)))


class ChainInverse(InverseLink):
    """Feedforward for any model that answers a rising voltage with a rising displacement.

    From the reading back to the voltage: sensor and slow blocks and the hysteresis are solved
    numerically, sample by sample; modes are inverted on the reference's derivatives; a delay is
    a lead. Added tones are left alone: no model of the voltage takes them away, but
    `HarmonicAttenuation` does.

    Parameters
    ----------
    model : Model
        The chain.
    values : mapping of str to float
        Its parameters, SI units.
    dt : float
        Sampling interval [s].
    scale : float
        Typical voltage [V], for slopes.
    limits, start, transition
        As in `InverseLink`.

    Raises
    ------
    CompensationError
        If a block falls or stands still where its input rises.
    """

    memory_size = 2 + STATE_SIZE

    def __init__(
        self,
        model: Model,
        values: Mapping[str, float],
        dt: float,
        *,
        scale: float = 1.0,
        limits: Limits | None = None,
        start: float = 0.5,
        transition: float = 0.2,
    ) -> None:
        self._model = model
        self._scale = scale
        self._stages = self._fresh = _Stages(dt)
        super().__init__(values, dt, limits=limits, start=start, transition=transition)

    def reset(self) -> None:
        """Forget everything but the parameters."""
        self._stages = _take_apart(self._model, self._packed, self.dt, self._scale)
        self._offset = self._stages.rest
        super().reset()

    def set_parameters(self, parameters: Mapping[str, float]) -> None:
        """Change parameters while running; the output goes over smoothly, the memory is kept."""
        super().set_parameters(parameters)
        self._offset = self._stages.rest

    def respond(
        self,
        displacement: FloatArray,
        velocity: FloatArray | None = None,
        acceleration: FloatArray | None = None,
    ) -> FloatArray:
        """Answer the voltage [V] to a whole reference from rest; see `InverseLink.respond`."""
        running = self._stages
        self._stages = _take_apart(self._model, self._packed, self.dt, self._scale)
        try:
            return super().respond(displacement, velocity, acceleration)
        finally:
            self._stages = running

    def _pack(self, parameters: Mapping[str, float]) -> FloatArray:
        packed = self._model.pack(parameters)
        self._fresh = _take_apart(self._model, packed, self.dt, self._scale)
        return packed

    def _carry_over(self, old: FloatArray, new: FloatArray) -> None:
        self._fresh.bristle, self._fresh.moved = self._stages.bristle, self._stages.moved
        for before, after in zip(self._stages.solvers, self._fresh.solvers, strict=True):
            after.take_over(before)
        self._stages = self._fresh

    def _run(self, reference: FloatArray, voltage: FloatArray, memory: FloatArray) -> None:
        stages = self._stages
        ahead = np.empty((3, 1))
        for k in range(voltage.size):
            carry_ahead(reference[:, k : k + 1], ahead, memory[2:], stages.lead, self.dt)
            d, v, a = (float(value) for value in ahead[:, 0])
            d += stages.rest
            for solver in reversed(stages.back):
                d = solver.solve(d)
                slope, bend = solver.shape(d)
                solver.commit(d)
                v /= slope or solver.first_slope
                a = (a - bend * v * v) / (slope or solver.first_slope)
            place = voltage[k : k + 1]
            place[0] = d + stages.k1 * v + stages.k2 * a
            if stages.lead > 0.0:
                lift_droop(place, memory[2:])
            u = float(place[0]) + stages.restoring_force(d)
            for solver in reversed(stages.front):
                u = solver.solve(u)
            if u > self._high or u < self._low:
                u = min(max(u, self._low), self._high)
                memory[1] += 1.0
            voltage[k] = u
            for solver in stages.front:
                u = solver.commit(u)
        memory[0] = sum(solver.clamped for solver in stages.solvers)

    def counters(self) -> dict[str, int]:
        """Return what went wrong so far; ``corners`` tell of a reference that is not smooth."""
        return {**super().counters(), 'corners': int(self._memory[2 + CORNERS])}
