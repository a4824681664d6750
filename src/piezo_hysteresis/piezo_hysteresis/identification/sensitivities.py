"""Response of a chain and its derivatives with respect to chosen parameters, block by block."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple, TypeGuard

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Between, Block, Parameter
from piezo_hysteresis.models import Model
from piezo_hysteresis.models.simulation.block_sensitivities import At, side_by_side, through
from piezo_hysteresis.models.simulation.plan import (
    LinearStage,
    PathStage,
    Stage,
    TickStage,
    as_linear,
)
from piezo_hysteresis.models.simulation.state_layout import StateJump
from piezo_hysteresis.models.simulation.substep_sensitivities import carried

_MOST_VALUES = 2_000_000  # derivatives times samples stored along the path of each tick
# Results of a first stage that are kept, more than the memories that a scan combines with a mode,
# and the largest number of derivatives of each.
_KEPT, _KEPT_VALUES = 4, 500_000
_STEP = 1e-6  # relative step of numerical differences, above sqrt of the rounding


class StateOffset(NamedTuple):
    """Offset of one initial state from its value after the lead-in.

    Attributes
    ----------
    stage, place : int
        Stage of the chain, and index of the state in it.
    amount : float
        Offset that is added at the first sample of the record.
    """

    stage: int
    place: int
    amount: float


class FirstStage(dict[tuple[object, ...], tuple[FloatArray, FloatArray]]):
    """The last few results of the first stage of a chain, by its parameters and its unknowns.

    A scan of the dynamics behind a memory simulates the memory once.
    """

    def keep(self, key: tuple[object, ...], found: tuple[FloatArray, FloatArray]) -> None:
        """Replace the oldest result, unless the new one is large."""
        if found[1].size <= _KEPT_VALUES and key not in self:
            if len(self) == _KEPT:
                del self[next(iter(self))]
            self[key] = found


def sensitivities(
    model: Model,
    packed: FloatArray,
    free: Sequence[str],
    voltage: FloatArray,
    dt: float,
    frequency: float = 0.0,
    start: float = 0.0,
    *,
    origin: int = 0,
    offsets: Sequence[StateOffset] = (),
    first: FirstStage | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Return the free run from rest and its derivatives.

    Blocks are differentiated by the generated derivative of their kernel. Linear runs are
    differenced by their own parameters. A delay of a held voltage moves it by whole ticks; the
    whole response is differenced from a tick less to a tick more, since a step of the voltage
    affects the residual on one side only.

    Parameters
    ----------
    model : Model
        Any chain.
    packed : ndarray, shape (p,)
        Parameters as `Model.pack` orders them.
    free : sequence of str
        Parameters to differentiate by.
    voltage : ndarray, shape (n,)
        Input from rest [V].
    dt, frequency, start : float
        Sampling interval [s], fundamental frequency of the drive [Hz], time of the first sample
        [s].
    origin : int
        Sample before which `offsets` are added to states.
    offsets : sequence of StateOffset
        Empty for a run from rest.
    first : FirstStage, optional
        Known results of the first stage for the same input, which are extended.

    Returns
    -------
    displacement : ndarray, shape (n,)
        Free run [m].
    rows : ndarray, shape (len(free), n)
        Row j is the derivative by ``free[j]`` [m per unit of the parameter].
    """
    given: dict[str, Any] = {'origin': origin, 'offsets': offsets, 'first': first}
    held = delays_by_ticks(model)
    if any(name in held for name in free):
        others = [name for name in free if name not in held]
        signal, tangent = sensitivities(
            model, packed, others, voltage, dt, frequency, start, **given
        )
        rows = dict(zip(others, tangent, strict=True))
        for name in set(free) - rows.keys():
            two = _a_tick_apart(model, packed, name, dt)
            before, after = (
                sensitivities(model, each, (), voltage, dt, frequency, start, **given)[0]
                for each in two
            )
            rows[name] = (after - before) / np.sum(two[1] - two[0])
        return signal, np.array([rows[name] for name in free])
    signal = np.ascontiguousarray(voltage, dtype=np.float64)
    tangent = np.empty((0, signal.size))
    columns: list[str] = []
    for k, stage in enumerate(model.stages):
        amounts = np.zeros(stage.initial_state(dt, start).size)
        for each in offsets:
            if each.stage == k:
                amounts[each.place] += each.amount
        jump = StateJump(origin if np.any(amounts) else 0, amounts)
        clock = _Clock(dt, frequency, start, jump)
        p = packed[stage.columns]
        places = np.arange(packed.size)[stage.columns]
        own = [model.parameters[place] for place in places]
        columns += [each.name for each in own if each.name in free]
        key = (p.tobytes(), *columns)
        if k == 0 and first is not None and key in first:
            signal, tangent = first[key]
        elif isinstance(stage, TickStage):
            signal, tangent = _alone(stage, own, p, free, signal, tangent, clock)
        else:
            numbers = [j for j, parameter in enumerate(own) if parameter.name in free]
            carry = (
                _by_quadrature if _is_quadrature(stage, p, signal, tangent, clock) else _by_path
            )
            signal, tangent = carry(stage, own, p, numbers, signal, tangent, clock)
        if k == 0 and first is not None:
            first.keep(key, (signal, tangent))
    order = [columns.index(name) for name in free]
    return signal, tangent if order == list(range(len(order))) else tangent[order]


@dataclass(frozen=True)
class _Clock:
    dt: float
    frequency: float
    start: float
    jump: StateJump


def _alone(
    stage: TickStage,
    own: Sequence[Parameter],
    p: FloatArray,
    free: Sequence[str],
    signal: FloatArray,
    tangent: FloatArray,
    clock: _Clock,
) -> tuple[FloatArray, FloatArray]:
    """Propagate tangents through one block, or several in parallel."""
    columns = [j for j, parameter in enumerate(own) if parameter.name in free]
    if moves_by_ticks(stage):
        return _differenced(stage, own, p, columns, signal, tangent, clock)
    if stage.block.system is not None and len(tangent):  # independent of its state
        carried_on = as_linear(stage.block).carried(tangent, p, clock.dt)
        output, rows = _alone(stage, own, p, free, signal, tangent[:0], clock)
        return output, np.vstack([carried_on, rows])
    state = stage.initial_state(clock.dt, clock.start)
    moved = np.zeros((len(tangent) + len(columns), state.size))
    at, found = At(stage.block, p, columns), []
    for chunk in clock.jump.chunks(signal.size, signal.size, state):
        each = partial(_through, signal[chunk], tangent[:, chunk], clock)
        found.append(side_by_side(each, at, len(tangent), state, moved, clock.dt))
    if len(found) == 1:
        return found[0]
    return np.concatenate([y for y, _ in found]), np.concatenate([r for _, r in found], axis=1)


def _is_quadrature(
    stage: Stage, p: FloatArray, signal: FloatArray, tangent: FloatArray, clock: _Clock
) -> bool:
    """Return whether the memory of a run is differentiated instead of the whole run."""
    if not isinstance(stage, PathStage) or tangent.shape[0] or stage.run.by_quadrature is None:
        return False
    own = sum(len(part.block.parameters) for part in stage.run.by_quadrature.middle)
    return stage.run.steps(p, clock.dt) == 0 and own * signal.size < _MOST_VALUES


def _by_quadrature(
    stage: Stage,
    own: Sequence[Parameter],
    p: FloatArray,
    columns: Sequence[int],
    signal: FloatArray,
    tangent: FloatArray,
    clock: _Clock,
) -> tuple[FloatArray, FloatArray]:
    """Propagate tangents through a run by quadrature.

    A memory is differentiated at the nodes by its own kernel, and the linear blocks after it
    integrate the derivatives like the signal. The parameters of approach, delay and linear blocks
    are differenced.
    """
    assert isinstance(stage, PathStage)
    run, dt, layout = stage.run.by_quadrature, clock.dt, stage.run.layout(clock.dt)
    assert run is not None
    state = stage.initial_state(dt, clock.start)
    middle: list[tuple[At, slice, FloatArray]] = []
    places: list[int] = []
    for part, place in zip(run.middle, layout.memories[1:], strict=False):
        mine = [j for j in columns if part.span.start <= j < part.span.stop]
        at = At(part.block, p[part.span], [j - part.span.start for j in mine])
        places += mine
        middle.append((at, place, np.zeros((len(places), state[place].size))))
    behind = slice(layout.memories[1 + len(middle)].start, layout.size)
    moving: list[tuple[int, FloatArray]] = []
    for j in columns:
        if j >= run.behind[0].span.start:
            moving.append((j, p.copy()))
            moving[-1][1][j] += parameter_step(own[j], p[j])
    lasting = [
        (np.zeros((count, state[behind].size)), np.zeros(count))
        for count in (1 + len(places), *[1] * len(moving))
    ]
    answers = np.empty((len(places) + 1 + len(moving), signal.size))
    for chunk in clock.jump.chunks(signal.size, signal.size, state):
        if chunk.start == clock.jump.sample:
            for states, inputs in lasting:
                states[0] += clock.jump.amounts[behind]
                inputs[0] += clock.jump.amounts[0]
        nodes = run.node_values(signal[chunk], p, dt, state=state, layout=layout)
        flat, rows = nodes.values.ravel(), np.empty((0, nodes.values.size))
        for at, place, moved in middle:
            each = partial(_through, flat, rows, clock)
            flat, rows = side_by_side(each, at, len(rows), state[place], moved, dt)
        together, *apart = lasting
        answers[: 1 + len(places), chunk] = run.integrated(
            np.vstack([flat, rows]), nodes, p, dt, memory=together
        )
        for row, (_, other), memory in zip(answers[1 + len(places) :], moving, apart, strict=True):
            row[chunk] = run.integrated(flat[None], nodes, other, dt, memory=memory)[0]
    known = dict(zip(places, answers[1:], strict=False))
    for row, (j, other) in zip(answers[1 + len(places) :], moving, strict=True):
        known[j] = (row - answers[0]) / (other[j] - p[j])
    rest = [j for j in columns if j not in known]
    _, others = _differenced(stage, own, p, rest, signal, tangent, clock)
    known |= dict(zip(rest, others, strict=True))
    result = np.empty((len(columns), signal.size))
    for row, j in enumerate(columns):
        result[row] = known[j]
    return answers[0], result


def _by_path(
    stage: Stage,
    own: Sequence[Parameter],
    p: FloatArray,
    columns: Sequence[int],
    signal: FloatArray,
    tangent: FloatArray,
    clock: _Clock,
) -> tuple[FloatArray, FloatArray]:
    """Propagate tangents along a path; delays, linear and stepless runs are differenced."""
    if not isinstance(stage, PathStage):
        return _differenced(stage, own, p, columns, signal, tangent, clock)
    if stage.run.steps(p, clock.dt) == 0 or stage.run.order(p) > 0.0:
        return _differenced(stage, own, p, columns, signal, tangent, clock)
    around = {j: _around(own[j], float(p[j])) for j in columns}
    late = [j for j in columns if j < stage.run.delays]
    for j in late:
        del around[j]
    output, rows = carried(
        stage.run, signal, tangent, p, around, clock.dt, start=clock.start,
        frequency=clock.frequency, jump=clock.jump,
    )  # fmt: skip
    if not late:
        return output, rows
    nothing = tangent[:0]
    _, others = _differenced(stage, own, p, late, signal, nothing, clock, output)
    # delays are the first parameters of a run
    return output, np.vstack([rows[: len(tangent)], others, rows[len(tangent) :]])


def _around(parameter: Parameter, value: float) -> tuple[float, float]:
    """Return a parameter minus and plus a small step, limited by its bounds."""
    step = abs(parameter_step(parameter, value))
    below, above = value - step, value + step
    return (
        below if below >= parameter.low else value,
        above if above <= parameter.high else value,
    )


def _through(
    signal: FloatArray,
    tangent: FloatArray,
    clock: _Clock,
    at: At,
    state: FloatArray,
    moved: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    block = at.block
    kernel: Any = block.kernel
    times: tuple[float, ...] = (clock.dt, clock.frequency)
    if kernel is None:
        kernel, times = block.along, (*times, 1)  # the same, with one point per tick
    return through(kernel, signal, tangent, at, state, moved, *times)


def _differenced(
    stage: Stage,
    own: Sequence[Parameter],
    p: FloatArray,
    columns: Sequence[int],
    signal: FloatArray,
    tangent: FloatArray,
    clock: _Clock,
    output: FloatArray | None = None,
) -> tuple[FloatArray, FloatArray]:
    """Propagate tangents through a stage by differences, with its `output` if known."""
    # on one grid, so that the difference is caused by the parameter alone
    grid = {'steps': stage.run.steps(p, clock.dt)} if isinstance(stage, PathStage) else {}

    def run(x: FloatArray, values: FloatArray) -> FloatArray:
        state = stage.initial_state(clock.dt, clock.start)
        return np.concatenate(
            [
                stage.respond(
                    x[chunk], values, clock.dt, state=state, frequency=clock.frequency, **grid
                )
                for chunk in clock.jump.chunks(x.size, x.size, state)
            ]
        )

    output = run(signal, p) if output is None else output
    incoming = tangent.shape[0]
    result = np.empty((incoming + len(columns), signal.size))
    span = float(np.max(np.abs(signal), initial=0.0)) or 1.0
    if isinstance(stage, LinearStage) and incoming:
        result[:incoming] = stage.carried(tangent, p, clock.dt)
    for j in range(0 if isinstance(stage, LinearStage) else incoming):
        column = tangent[j]
        size = float(np.max(np.abs(column), initial=0.0))
        if size == 0.0:
            result[j] = 0.0
            continue
        step = _STEP * span / size
        result[j] = (run(signal + step * column, p) - output) / step
    for place, j in enumerate(columns, start=incoming):
        moved = p.copy()
        moved[j] += parameter_step(own[j], p[j])
        result[place] = (run(signal, moved) - output) / (moved[j] - p[j])
    return output, result


def moves_by_ticks(stage: Stage) -> TypeGuard[TickStage]:
    """Return whether a stage keeps a held signal, so that a delay moves it by whole ticks."""
    return isinstance(stage, TickStage) and stage.block.between is Between.DELAY


def delays_by_ticks(model: Model) -> set[str]:
    """Return the names of the delays that move a held signal by whole ticks.

    Creep passes a held signal on at once and adds to it, so a delay before it also moves most of
    the response by whole ticks; a mode or a lag does not.
    """
    names: set[str] = set()
    for stage in model.stages:
        if moves_by_ticks(stage) or (isinstance(stage, LinearStage) and _passes_directly(stage)):
            delays = (block for block in stage.blocks if block.between is Between.DELAY)
            names.update(each.name for block in delays for each in block.parameters)
    return names


def _passes_directly(stage: LinearStage) -> bool:
    """Return whether the output of a stage contains its input at the same instant."""
    linear = stage.parts[stage.delays :]
    return all(_feedthrough(part.block) != 0.0 for part in linear)


def _feedthrough(block: Block) -> float:
    """Return the feedthrough of a linear block at the defaults of its parameters."""
    assert block.system is not None
    return block.system(np.array([each.default for each in block.parameters])).d


def _a_tick_apart(
    model: Model, packed: FloatArray, name: str, dt: float
) -> tuple[FloatArray, FloatArray]:
    """Return the parameters with a delay a tick less and a tick more, within its bounds."""
    place = model.parameter_names.index(name)
    bounds = model.parameters[place]
    before, after = packed.copy(), packed.copy()
    before[place] = max(packed[place] - dt, bounds.low)
    after[place] = min(packed[place] + dt, bounds.high)
    return before, after


def parameter_step(parameter: Parameter, value: float) -> float:
    """Return the step of a parameter for a difference, within its bounds."""
    step = _STEP * max(abs(value), 0.1 * parameter.scale)
    return -step if value + step > parameter.high else step
