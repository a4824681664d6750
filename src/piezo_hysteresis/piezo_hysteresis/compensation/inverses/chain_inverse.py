"""A numeric inverse for any chain of blocks, block by block from the reading to the voltage."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Between, Block, Restoring, Slot, System
from piezo_hysteresis.compensation.base import Limits
from piezo_hysteresis.compensation.inverses.base import InverseLink
from piezo_hysteresis.compensation.inverses.block_inverse import BlockInverse, JoinedInverse
from piezo_hysteresis.compensation.inverses.physical import structure_coefficients
from piezo_hysteresis.compensation.inverses.structure_inverse import (
    CORNERS,
    STATE_SIZE,
    carry_ahead,
    lift_droop,
)
from piezo_hysteresis.errors import CompensationError
from piezo_hysteresis.models.chain import Model
from piezo_hysteresis.numerics.linalg import solve_square


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
    restoring : Restoring or None
        What acts back on a mode beside its linear spring.
    values : mapping of str to float
        Parameters of that block.
    memory, moved : float
        Memory of that force, and the displacement it belongs to [m].
    """

    dt: float
    front: list[BlockInverse] = field(default_factory=list)
    back: list[BlockInverse] = field(default_factory=list)
    k1: float = 0.0
    k2: float = 0.0
    lead: float = 0.0
    rest: float = 0.0
    restoring: Restoring | None = None
    values: Mapping[str, float] = field(default_factory=dict)
    memory: float = 0.0
    moved: float = 0.0

    def restoring_force(self, x: float) -> float:
        """Return what acts back on the mode, to be added to the target at `x` [m]."""
        if self.restoring is None:
            return 0.0
        force, self.memory = self.restoring(self.values, x, self.moved, self.memory, self.dt)
        self.moved = x
        return force

    @property
    def solvers(self) -> list[BlockInverse]:
        """Every block, from the voltage to the reading."""
        return [*self.front, *self.back]


def _take_apart(model: Model, packed: FloatArray, dt: float, scale: float) -> _Stages:
    stages = _Stages(dt)
    inertia = any(block.inertia for block in model.blocks)
    first = 0
    for block in model.blocks:
        own = packed[first : first + len(block.parameters)].copy()
        first += len(block.parameters)
        if block.slot is Slot.ADDED:
            continue
        values = dict(zip((q.name for q in block.parameters), own.tolist(), strict=True))
        if block.between is Between.DELAY:
            stages.lead += sum(values.values())
        elif block.slot is Slot.STRUCTURE and block.between in (Between.LINEAR, Between.INNER):
            # read at the start of the tick that the voltage is held over, or at its end
            held = 0.5 * dt if inertia else -0.5 * dt
            _take_structure(stages, block, own, values, held)
        else:
            behind = stages.k2 > 0.0 or block.slot in (Slot.SLOW, Slot.SENSOR)
            moves = behind and inertia and block.between is Between.LINEAR
            solver = (JoinedInverse if moves else BlockInverse)(block, own, dt, 1e-4 * scale)
            if not (math.isfinite(solver.first_slope) and solver.first_slope > 0.0):
                raise CompensationError(
                    f'block {block.name} does not rise with its input at rest (slope '
                    f'{solver.first_slope:g}), so the model has no inverse; identify with bounds '
                    'that keep it rising'
                )
            if inertia and block.way is not None and block.system is not None:
                stages.lead += _end_before_mean(block.system(own), dt)
            (stages.back if behind else stages.front).append(solver)
            stages.rest = solver.trial(stages.rest)
            scale *= solver.first_slope
    return stages


def _take_structure(
    stages: _Stages, block: Block, own: FloatArray, values: Mapping[str, float], held: float
) -> None:
    """Count a block that moves the structure; it is inverted on the reference's derivatives.

    Several count by the sum of their coefficients: exact for one, right to second order in
    frequency over natural frequency for more. `held` is the lead that the hold asks for [s].
    """
    if block.restoring is not None:
        stages.restoring, stages.values = block.restoring, values
    # what goes past a mode, straight through, is not held up
    share = 1.0 - block.system(own).d if block.system is not None and not block.inertia else 1.0
    k1, k2 = _inverse_of(block, own, values)
    stages.k1 += k1
    stages.k2 += k2
    stages.lead += share * held


def _end_before_mean(lag: System, dt: float) -> float:
    """Return how far the end of a tick is ahead of the mean that a structure sees of a lag [s].

    Where the end of the tick is made to be the target, the mean over the hold comes that much
    early.
    """
    rate = -float(lag.a[0, 0])
    # dt / (exp(rate dt) - 1) in a form that does not overflow for a fast lag
    return 1.0 / rate + dt * math.exp(-rate * dt) / math.expm1(-rate * dt)


def _inverse_of(block: Block, own: FloatArray, values: Mapping[str, float]) -> tuple[float, float]:
    """Return k1 [s] and k2 [s^2] of ``v = y + k1 y' + k2 y''`` for slow motion of a block."""
    if block.system is None:
        return structure_coefficients(values)
    a, b, c, d = block.system(own)
    # moments of the response: gain, and its first two derivatives by i omega, over the gain
    once = solve_square(a, b).values
    twice = solve_square(a, once).values
    thrice = solve_square(a, twice).values
    gain = d - float(c @ once)
    first, second = -float(c @ twice) / gain, -float(c @ thrice) / gain
    return -first, first * first - second


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
        self._fresh.memory, self._fresh.moved = self._stages.memory, self._stages.moved
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
