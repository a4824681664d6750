"""Stages of a chain as compiled kernels, see `models.simulation.plan`.

Every piece is ``run(x, y, state, p, frequency)`` on arrays: `p` are the current parameters of the
whole chain, `state` is that of the piece. Quantities that a stage computes from its parameters in
advance (the exponential of a mode, the steps of a path) are constants of the piece.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Block
from piezo_hysteresis.blocks.transport_delay import ring_size, shift
from piezo_hysteresis.jit import leaf, scratch
from piezo_hysteresis.models.simulation.compiled import kernel_of
from piezo_hysteresis.models.simulation.plan import LinearStage, Stage, TickStage
from piezo_hysteresis.models.simulation.state_space import run_held

Run = Callable[[FloatArray, FloatArray, FloatArray, FloatArray, float], None]
#: The same for one block on its own parameters: ``run(x, y, state, p, frequency)``.
Alone = Run


class Piece(NamedTuple):
    """A compiled stage."""

    run: Run  # see above
    start: FloatArray  # its state at rest
    live: tuple[int, ...]  # indices of the parameters that are read in every step


def piece_of(stage: Stage, packed: FloatArray, dt: float) -> Piece:
    """Return the piece of a stage for the parameters `packed` of the chain."""
    from piezo_hysteresis.export.path_pieces import path_run

    start = stage.initial_state(dt, 0.0)
    if isinstance(stage, TickStage):
        first, last = stage.columns.start, stage.columns.stop
        return Piece(
            on_columns(of_block(stage.block, dt), first, last), start, tuple(range(first, last))
        )
    own = np.ascontiguousarray(packed[stage.columns])
    if isinstance(stage, LinearStage):
        return Piece(_held(stage, own, dt), start, ())
    return Piece(path_run(stage.run, own, dt), start, ())  # type: ignore[attr-defined]


def in_series(pieces: Sequence[Piece]) -> Piece:
    """Return the series connection of several pieces as one piece."""
    whole = pieces[0]
    for piece in pieces[1:]:
        whole = Piece(
            _then(whole.run, piece.run, whole.start.size),
            np.concatenate([whole.start, piece.start]),
            (*whole.live, *piece.live),
        )
    return whole


def _then(before: Run, behind: Run, size: int) -> Run:
    @leaf
    def run(
        x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, frequency: float
    ) -> None:
        between = scratch(x.size)
        before(x, between, state[:size], p, frequency)
        behind(between, y, state[size:], p, frequency)

    return run


def on_columns(alone: Alone, first: int, last: int) -> Run:
    """Return a run on the parameters first..last of the chain."""

    @leaf
    def run(
        x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, frequency: float
    ) -> None:
        alone(x, y, state, p[first:last], frequency)

    return run


def of_block(block: Block, dt: float, points: int = 0) -> Alone:
    """Return a block on its own parameters, along a path of `points` values if supported."""
    kernel = kernel_of(block, dt, points)

    @leaf
    def run(
        x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, frequency: float
    ) -> None:
        kernel(x, y, state, p, dt, frequency)

    return run


def late(run: Run, ticks: int, ring: slice) -> Run:
    """Return the run with an input delayed by `ticks`; its ring buffer is in the state."""
    first, last = ring.start, ring.stop

    @leaf
    def delayed(
        x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, frequency: float
    ) -> None:
        old = scratch(x.size)
        shift(x, old, state[first:last], ticks)
        run(old, y, state, p, frequency)

    return delayed


def _held(stage: LinearStage, own: FloatArray, dt: float) -> Run:
    whole, hold = stage.hold(own, dt)
    ring = stage.delays * ring_size(dt) + 1 if stage.delays else 0
    phi, gamma, row, gain = hold

    @leaf
    def run(
        x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, frequency: float
    ) -> None:
        run_held(x, y, state[ring:], phi, gamma, row, gain)

    return late(run, whole, slice(0, ring)) if ring else run
