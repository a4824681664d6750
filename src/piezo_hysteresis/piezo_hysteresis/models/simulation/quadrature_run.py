"""A run of blocks integrated by Gauss quadrature within each tick, see `quadrature`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Approach, Between
from piezo_hysteresis.blocks.transport_delay import in_ticks, shift
from piezo_hysteresis.models.simulation.quadrature import (
    SLOW,
    NodeValues,
    Response,
    approaches,
    gauss_of,
    integrate,
    response_of,
)
from piezo_hysteresis.models.simulation.state_layout import Layout, PlacedBlock, systems_of
from piezo_hysteresis.models.simulation.state_space import fastest

_AT_ONCE = 1 << 11  # ticks that are integrated at a time


@dataclass(frozen=True)
class QuadratureRun:
    """A monotonic approach, static blocks or memories after it, and linear blocks at the end."""

    first: PlacedBlock  # block that approaches a held input monotonically
    middle: tuple[PlacedBlock, ...]  # blocks after it
    behind: tuple[PlacedBlock, ...]  # the linear blocks at the end
    delays: int  # number of parameters of delays before theirs
    ahead: bool  # whether the output is sampled at the end of the tick and not at its start

    @classmethod
    def of(cls, moving: tuple[PlacedBlock, ...], delays: int, ahead: bool) -> QuadratureRun | None:
        """Return the run of the blocks `moving`, None if they have another structure."""
        last = len(moving)
        while last and moving[last - 1].block.system is not None:
            last -= 1
        if last in (0, len(moving)) or moving[0].block.approach is None:
            return None
        kinds = [part.block.between for part in moving[1:last]]
        memories = [part.block for part in moving[1:last] if part.block.between is Between.PATH]
        if len(memories) > 1 or any(block.along is not None for block in memories):
            return None
        if not set(kinds) <= {Between.INSTANT, Between.PATH}:
            return None
        return cls(moving[0], moving[1:last], moving[last:], delays, ahead)

    def fits(self, p: FloatArray, dt: float) -> bool:
        """Return whether the linear blocks are slow enough for quadrature."""
        return dt * fastest(systems_of(self.behind, p)) <= SLOW

    def respond(
        self, signal: FloatArray, p: FloatArray, dt: float, *, state: FloatArray, layout: Layout
    ) -> FloatArray:
        """Return the output for a held input, one value per tick, updating `state` in place."""
        memories = layout.memories[1 : 1 + len(self.middle)]
        behind = slice(layout.memories[1 + len(self.middle)].start, layout.size)
        output = np.empty_like(signal)
        for begin in range(0, signal.size, _AT_ONCE):
            chunk = slice(begin, begin + _AT_ONCE)
            nodes = self.node_values(signal[chunk], p, dt, state=state, layout=layout)
            flat = nodes.values.ravel()
            for part, place in zip(self.middle, memories, strict=True):
                flat = part.block.respond(flat, p[part.span], dt, state=state[place])
            own = (state[None, behind], state[:1])
            output[chunk] = self.integrated(flat[None], nodes, p, dt, memory=own)[0]
        return output

    def node_values(
        self, signal: FloatArray, p: FloatArray, dt: float, *, state: FloatArray, layout: Layout
    ) -> NodeValues:
        """Return the approach to a held signal at the nodes of each tick; `state` in place."""
        approach, places, weights = self.approach(p, dt)
        whole, part = in_ticks(float(p[: self.delays].sum()), dt)
        old = new = signal
        if self.delays:
            new = np.empty_like(signal)
            shift(signal, new, state[layout.ring], whole)
            old = np.concatenate([state[1:2], new[:-1]])
            state[1] = new[-1]
        pieces = 2 if part > 0.0 else 1
        values = np.empty((signal.size, pieces, places.size + 1))
        lasts = np.empty((signal.size, pieces))
        approaches(old, new, part, state[layout.memories[0]], approach, dt, places, values, lasts)
        return NodeValues(values, lasts, part, places, weights)

    def integrated(
        self,
        rows: FloatArray,  # (signals, values of `nodes`)
        nodes: NodeValues,
        p: FloatArray,  # [s]
        dt: float,  # [s]
        *,
        memory: tuple[FloatArray, FloatArray] | None = None,
    ) -> FloatArray:
        """Return the output of the linear blocks for signals at `nodes`, shape (signals, n)."""
        response = self.response(p, dt)
        if memory is None:
            memory = np.zeros((len(rows), response.row.size)), np.zeros(len(rows))
        output = np.empty((len(rows), nodes.lasts.shape[0]))
        values = rows.reshape(len(rows), *nodes.values.shape)
        integrate(
            values, nodes.lasts, nodes.part, nodes.places, nodes.weights, output, memory[0],
            memory[1], response.phi, response.impulse, response.integral, response.row,
            response.direct, self.ahead,
        )  # fmt: skip
        return output

    def approach(self, p: FloatArray, dt: float) -> tuple[Approach, FloatArray, FloatArray]:
        """Return the approach and its Gauss points, cached for the last parameters."""
        key = (p.tobytes(), dt)
        known: tuple[object, tuple[Approach, FloatArray, FloatArray]] | None
        known = self.__dict__.get('_last_approach')
        if known is None or known[0] != key:
            assert self.first.block.approach is not None
            approach = self.first.block.approach(p[self.first.span])
            known = key, (approach, *gauss_of(approach, systems_of(self.behind, p), dt))
            self.__dict__['_last_approach'] = known
        return known[1]

    def response(self, p: FloatArray, dt: float) -> Response:
        """Return the response of the linear blocks, cached for the last parameters."""
        key = (p.tobytes(), dt)
        known: tuple[object, Response] | None = self.__dict__.get('_last_response')
        if known is None or known[0] != key:
            known = key, response_of(systems_of(self.behind, p), dt)
            self.__dict__['_last_response'] = known
        return known[1]
