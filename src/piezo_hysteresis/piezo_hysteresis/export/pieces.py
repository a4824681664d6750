"""Stages of a chain as compiled kernels, see `models.simulation.plan`.

Every piece is ``run(x, y, state, p, frequency)`` on arrays: `p` are the current parameters of the
whole chain, `state` is that of the piece. Quantities that a stage computes from its parameters in
advance (the exponential of a mode, the steps of a path) are constants of the piece.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Block, InterSample
from piezo_hysteresis.blocks.transport_delay import ring_size, shift
from piezo_hysteresis.common.parameter_table import ParameterSpec
from piezo_hysteresis.compensation.link import OK
from piezo_hysteresis.export.compensator import NOT_FINITE
from piezo_hysteresis.export.header import (
    UNINITIALISED,
    Component,
    Field,
    checking,
    component,
    of_model,
)
from piezo_hysteresis.jit import inline_jit, scratch
from piezo_hysteresis.models.chain import Model
from piezo_hysteresis.models.simulation.compiled import kernel_of
from piezo_hysteresis.models.simulation.plan import LinearStage, Stage, TickStage
from piezo_hysteresis.models.simulation.state_space import LinearStep, run_held, run_path
from piezo_hysteresis.models.simulation.substep_run import (
    PathPiece,
    PathRun,
    joined,
    read,
    with_turns,
    without_turns,
)


def path_run(run: PathRun, own: FloatArray, dt: float) -> Run:
    """Return a path run for its parameters `own`."""
    steps, layout = run.steps(own, dt), run.layout(dt)
    order, points = run.order(own), 3 * steps
    timing = run.timing(own, dt, order > 0.0)
    whole: Run | None = None
    made = run.made(own, dt, steps)
    for piece, step in zip(run.pieces(layout), made, strict=True):
        one = _at(_followed(piece, step, own, dt, points, timing.ahead), piece.memory)
        whole = one if whole is None else _then(whole, one)
    assert whole is not None
    part = timing.part
    past, past_end = layout.past.start, layout.past.stop

    @inline_jit
    def follow(
        x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, frequency: float
    ) -> None:
        path, answer = scratch(points), scratch(points)
        for k in range(x.size):
            if order > 0.0:
                joined(x[k : k + 1], path, state[past:past_end], order)
            else:
                for i in range(points):
                    path[i] = x[k]
            whole(path, answer, state, p, frequency)
            if part == 1.0:
                y[k] = answer[points - 1]
            elif part == 0.0:
                y[k] = state[0]
            else:
                read(answer, y[k : k + 1], points, part)
            state[0] = answer[points - 1]

    return late(follow, timing.ticks, layout.ring) if run.delays else follow


def _then(before: Run, behind: Run) -> Run:
    """Return two runs in series, each with its indices in the state."""

    @inline_jit
    def run(
        x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, frequency: float
    ) -> None:
        between = scratch(x.size)
        before(x, between, state, p, frequency)
        behind(between, y, state, p, frequency)

    return run


def _at(alone: Alone, memory: slice) -> Run:
    first, last = memory.start, memory.stop

    @inline_jit
    def run(
        x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, frequency: float
    ) -> None:
        alone(x, y, state[first:last], p, frequency)

    return run


def _with(alone: Alone, own: FloatArray) -> Alone:
    """Return a block with constant parameters."""
    values = np.ascontiguousarray(own)

    @inline_jit
    def run(
        x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, frequency: float
    ) -> None:
        alone(x, y, state, values, frequency)

    return run


def _followed(
    piece: PathPiece,
    step: LinearStep | None,
    own: FloatArray,
    dt: float,
    points: int,
    ahead: float,
) -> Alone:
    if step is not None:
        phi, gamma, rows, gains = step

        @inline_jit
        def linear(
            x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, frequency: float
        ) -> None:
            run_path(x, y, state, phi, gamma, rows, gains)

        return linear
    ((block, span),) = piece.parts
    if block.between is InterSample.CLOCK:
        return _with(_with_time(block, dt, points // 3, ahead), own[span])
    plain = _with(of_block(block, dt, points), own[span])
    if piece.turns and block.between is InterSample.PATH and block.path_kernel is None:
        return _turning(plain)
    return plain


def _turning(run: Alone) -> Alone:
    """Return a memory that is also evaluated at the extrema of its path."""

    @inline_jit
    def follow(
        x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, frequency: float
    ) -> None:
        count = x.size // 3
        wide, answer, turned = scratch(4 * count), scratch(4 * count), scratch(count)
        with_turns(x, wide, turned)
        run(wide, answer, state, p, frequency)
        without_turns(answer, turned, y)

    return follow


def _with_time(block: Block, dt: float, steps: int, ahead: float) -> Alone:
    """Return a time-dependent block along a path."""
    count, run = block.initial_state(dt).size - 1, of_block(block, dt / steps)

    @inline_jit
    def follow(
        x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, frequency: float
    ) -> None:
        memory = scratch(state.size)
        part, answer = scratch(steps), scratch(steps)
        for place in range(3):
            for i in range(state.size):
                memory[i] = state[i]
            memory[count] = (state[count] + ahead) * steps + 0.5 * place
            for i in range(steps):
                part[i] = x[3 * i + place]
            run(part, answer, memory, p, frequency)
            for i in range(steps):
                y[3 * i + place] = answer[i]
        state[count] += 1.0

    return follow


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
        first, size = whole.start.size, whole.start.size + piece.start.size
        whole = Piece(
            _then(_at(whole.run, slice(0, first)), _at(piece.run, slice(first, size))),
            np.concatenate([whole.start, piece.start]),
            (*whole.live, *piece.live),
        )
    return whole


def on_columns(alone: Alone, first: int, last: int) -> Run:
    """Return a run on the parameters first..last of the chain."""

    @inline_jit
    def run(
        x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, frequency: float
    ) -> None:
        alone(x, y, state, p[first:last], frequency)

    return run


def of_block(block: Block, dt: float, points: int = 0) -> Alone:
    """Return a block on its own parameters, along a path of `points` values if supported."""
    kernel = kernel_of(block, dt, points)

    @inline_jit
    def run(
        x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, frequency: float
    ) -> None:
        kernel(x, y, state, p, dt, frequency)

    return run


def late(run: Run, ticks: int, ring: slice) -> Run:
    """Return the run with an input delayed by `ticks`; its ring buffer is in the state."""
    first, last = ring.start, ring.stop

    @inline_jit
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
    phi, gamma, rows, gains = hold

    @inline_jit
    def run(
        x: FloatArray, y: FloatArray, state: FloatArray, p: FloatArray, frequency: float
    ) -> None:
        run_held(x, y, state[ring:], phi, gamma, rows, gains)

    return late(run, whole, slice(0, ring)) if ring else run


# Indices in the memory: mark of initialisation, last voltage; parameters and state
# follow.
_MARK, _VOLTAGE = range(2)
HEAD = 2

_FREQUENCY = Field(
    ParameterSpec(
        'drive_frequency', 0.0,
        'Fundamental of the drive, for blocks that depend on it; 0 where there is none.',
        'Hz', 0.0, 1e9,
    ),
    0.0,
)  # fmt: skip


def plant_of(model: Model, packed: FloatArray, dt: float, mark: float) -> Component:
    """Return the free run of `model` at one sampling interval [s].

    Its ``step(s, voltage, displacement)`` returns 0, or 16 if the voltage is not finite and the
    last one is held.
    """
    whole = in_series([piece_of(stage, packed, dt) for stage in model.stages])
    fields = (_FREQUENCY, *of_model(model, packed, whole.live))
    values, states = len(fields), whole.start.size
    first = HEAD + values
    rest = whole.start if states else np.zeros(1)

    @inline_jit
    def take(given: FloatArray, s: FloatArray, begins: bool) -> int:
        for k in range(values):
            s[HEAD + k] = given[k]
        return OK

    @inline_jit
    def reset(s: FloatArray) -> None:
        s[_VOLTAGE] = 0.0
        for k in range(states):
            s[first + k] = rest[k]

    rows = (('head', HEAD), ('parameters', values), ('memory', states))
    step, start = _stepping(whole.run, first, states, mark), np.zeros(first + states)
    return component(step, checking(fields), take, reset, start, mark, fields, rows)


def _stepping(
    run: Any, first: int, states: int, mark: float
) -> Callable[[FloatArray, float, FloatArray], int]:
    @inline_jit
    def step(s: FloatArray, voltage: float, displacement: FloatArray) -> int:
        if s[_MARK] != mark:
            displacement[0] = 0.0
            return UNINITIALISED
        code = OK
        if not np.isfinite(voltage):
            voltage, code = s[_VOLTAGE], NOT_FINITE
        s[_VOLTAGE] = voltage
        x = scratch(1)
        x[0] = voltage
        run(x, displacement, s[first : first + states], s[HEAD + 1 : first], s[HEAD])
        return code

    return step
