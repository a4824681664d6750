"""Response of a chain and its derivatives with respect to chosen parameters, block by block."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeGuard

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Between, Block, Parameter
from piezo_hysteresis.models import Model
from piezo_hysteresis.models.simulation.block_sensitivities import At, side_by_side, through
from piezo_hysteresis.models.simulation.plan import LinearStage, PathStage, Stage, TickStage
from piezo_hysteresis.models.simulation.state_layout import PlacedBlock
from piezo_hysteresis.models.simulation.substep_sensitivities import carried

_MOST_VALUES = 2_000_000  # derivatives times samples that are held along the way of each tick
_STEP = 1e-6  # relative step of numerical differences; sqrt of the rounding, times some


def sensitivities(
    model: Model,
    packed: FloatArray,
    free: Sequence[str],
    voltage: FloatArray,
    dt: float,
    frequency: float = 0.0,
    start: float = 0.0,
) -> tuple[FloatArray, FloatArray]:
    """Return the free run from rest and its derivatives.

    Blocks are differentiated by the generated derivative of their kernel. Delays, and linear runs
    by their own parameters, are differenced.

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

    Returns
    -------
    displacement : ndarray, shape (n,)
        Free run [m].
    rows : ndarray, shape (len(free), n)
        Row j is the derivative by ``free[j]`` [m per unit of the parameter].
    """
    signal = np.ascontiguousarray(voltage, dtype=np.float64)
    tangent = np.empty((0, signal.size))
    columns: list[str] = []
    clock = _Clock(dt, frequency, start)
    for stage in model.stages:
        p = packed[stage.columns]
        places = np.arange(packed.size)[stage.columns]
        own = [model.parameters[place] for place in places]
        if isinstance(stage, TickStage):
            signal, tangent = _alone(stage, own, p, free, signal, tangent, clock)
        else:
            numbers = [j for j, parameter in enumerate(own) if parameter.name in free]
            carry = (
                _by_quadrature if _is_quadrature(stage, p, signal, tangent, clock) else _by_path
            )
            signal, tangent = carry(stage, own, p, numbers, signal, tangent, clock)
        columns += [each.name for each in own if each.name in free]
    order = [columns.index(name) for name in free]
    return signal, tangent if order == list(range(len(order))) else tangent[order]


@dataclass(frozen=True)
class _Clock:
    dt: float
    frequency: float
    start: float


def _alone(
    stage: TickStage,
    own: Sequence[Parameter],
    p: FloatArray,
    free: Sequence[str],
    signal: FloatArray,
    tangent: FloatArray,
    clock: _Clock,
) -> tuple[FloatArray, FloatArray]:
    """Carry tangents through one block, or several that stand side by side."""
    columns = [j for j, parameter in enumerate(own) if parameter.name in free]
    if moves_by_ticks(stage):
        return _differenced(stage, own, p, columns, signal, tangent, clock)
    state = stage.initial_state(clock.dt, clock.start)
    moved = np.zeros((len(tangent) + len(columns), state.size))
    each, at = partial(_through, signal, tangent, clock), At(stage.block, p, columns)
    return side_by_side(each, at, len(tangent), state, moved, clock.dt)


def _is_quadrature(
    stage: Stage, p: FloatArray, signal: FloatArray, tangent: FloatArray, clock: _Clock
) -> bool:
    """Return whether the memory of a run is differentiated on its own, and not the whole run."""
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
    """Carry tangents through a run by quadrature.

    A memory is differentiated at the nodes by its own kernel, and the linear blocks behind it
    integrate the derivatives as they integrate the signal. Approach, delay and linear blocks
    themselves are differenced.
    """
    assert isinstance(stage, PathStage)
    run, dt = stage.run.by_quadrature, clock.dt
    assert run is not None
    state = stage.initial_state(dt, clock.start)
    nodes = run.node_values(signal, p, dt, state=state, layout=stage.run.layout(dt))
    flat, rows = nodes.values.ravel(), np.empty((0, nodes.values.size))
    places: list[int] = []
    free = [own[j].name for j in columns]
    for part in run.middle:
        inside = TickStage(part.block, part.span, ahead=True)
        mine = [(j, own[j]) for j in range(part.span.start, part.span.stop)]
        flat, rows = _alone(inside, [q for _, q in mine], p[part.span], free, flat, rows, clock)
        places += [j for j, q in mine if q.name in free]
    answers = run.integrated(np.vstack([flat, rows]), nodes, p, dt)
    known = dict(zip(places, answers[1:], strict=True))
    behind = {j for part in run.behind for j in range(part.span.start, part.span.stop)}
    for j in behind & set(columns):
        moved = p.copy()
        moved[j] += parameter_step(stage, own[j], p[j], dt)
        answer = run.integrated(flat[None], nodes, moved, dt)[0]
        known[j] = (answer - answers[0]) / (moved[j] - p[j])
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
    """Carry tangents along a path; delays, linear runs and runs without steps are differenced."""
    if not isinstance(stage, PathStage):
        return _differenced(stage, own, p, columns, signal, tangent, clock)
    if stage.run.steps(p, clock.dt) == 0 or stage.run.order(p) > 0.0:
        return _differenced(stage, own, p, columns, signal, tangent, clock)
    around = {j: _around(stage, own[j], float(p[j]), clock.dt) for j in columns}
    late = [j for j in columns if j < stage.run.delays]
    for j in late:
        del around[j]
    output, rows = carried(
        stage.run, signal, tangent, p, around, clock.dt, start=clock.start,
        frequency=clock.frequency,
    )  # fmt: skip
    if not late:
        return output, rows
    nothing = tangent[:0]
    _, others = _differenced(stage, own, p, late, signal, nothing, clock, output)
    # delays stand first among the parameters of a run
    return output, np.vstack([rows[: len(tangent)], others, rows[len(tangent) :]])


def _around(stage: Stage, parameter: Parameter, value: float, dt: float) -> tuple[float, float]:
    """Return a parameter a little less and a little more, itself where a bound is in the way."""
    step = abs(parameter_step(stage, parameter, value, dt))
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
    block, incoming = at.block, len(tangent)
    linear = block.system is not None
    kernel: Any = block.kernel
    times: tuple[float, ...] = (clock.dt, clock.frequency)
    if kernel is None:
        kernel, times = block.along, (*times, 1)  # the same, a point per tick
    if not linear or not incoming:
        return through(kernel, signal, tangent, at, state, moved, *times)
    output, rows = through(kernel, signal, tangent[:0], at, state, moved[incoming:], *times)
    carried_on = _as_linear(block).carried(tangent, at.values, clock.dt)
    return output, np.vstack([carried_on, rows])


def _as_linear(block: Block) -> LinearStage:
    """Return the stage that a linear block is alone: it carries four derivatives side by side."""
    known: LinearStage | None = block.__dict__.get('_as_linear')
    if known is None:
        places = np.arange(len(block.parameters))
        part = PlacedBlock(block, slice(0, places.size))
        known = LinearStage((part,), places, 0, ahead=not block.inertia)
        block.__dict__['_as_linear'] = known  # as long as the block: each fit scales its own
    return known


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
    """Carry tangents through a stage by differences of the stage alone, its `output` if known."""
    # on one grid, so that a difference is that of the parameter alone
    grid = {'steps': stage.run.steps(p, clock.dt)} if isinstance(stage, PathStage) else {}

    def run(x: FloatArray, values: FloatArray) -> FloatArray:
        state = stage.initial_state(clock.dt, clock.start)
        return stage.respond(x, values, clock.dt, state=state, frequency=clock.frequency, **grid)

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
        moved[j] += parameter_step(stage, own[j], p[j], clock.dt)
        result[place] = (run(signal, moved) - output) / (moved[j] - p[j])
    return output, result


def moves_by_ticks(stage: Stage) -> TypeGuard[TickStage]:
    """Return whether a stage only holds, so that a delay moves what it holds by whole ticks."""
    return isinstance(stage, TickStage) and stage.block.between is Between.DELAY


def parameter_step(stage: Stage, parameter: Parameter, value: float, dt: float) -> float:
    """Return by how much a parameter of a stage is moved for a difference, within its bounds."""
    if moves_by_ticks(stage):
        return dt if value + dt <= parameter.high else -dt
    step = _STEP * max(abs(value), 0.1 * parameter.scale)
    return -step if value + step > parameter.high else step
