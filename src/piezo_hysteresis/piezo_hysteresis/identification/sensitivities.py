"""Response of a chain and its derivatives with respect to chosen parameters, block by block."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple, TypeGuard

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Block, InterSample, Parameter
from piezo_hysteresis.models import Model
from piezo_hysteresis.models.simulation.plan import (
    LinearStage,
    PathStage,
    Stage,
    TickStage,
    as_linear,
)
from piezo_hysteresis.models.simulation.state_layout import StateJump
from piezo_hysteresis.models.simulation.substep_sensitivities import (
    BlockPoint,
    PathTangents,
    propagate_derivatives,
    sum_parallel,
)

# Results of a first stage that are kept, more than the memories that a scan combines with a mode,
# and the largest number of derivatives of each.
_KEPT, _KEPT_VALUES = 4, 500_000
_STEP = 1e-6  # relative step of numerical differences, above sqrt of the rounding


class StateOffset(NamedTuple):
    """Offset of one initial state from its value after the lead-in."""

    stage: int  # stage of the chain
    place: int  # index of the state in it
    amount: float  # offset that is added at the first sample of the record


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


class SensitivityRun:
    """The free run of a chain from rest and its derivatives, block by block of samples.

    Blocks are differentiated by the generated derivative of their kernel. Linear runs are
    differenced by their own parameters. A delay of a held voltage moves it by whole ticks; the
    whole response is differenced from a tick less to a tick more, since a step of the voltage
    affects the residual on one side only.
    """

    def __init__(
        self,
        model: Model,
        packed: FloatArray,  # (p,)
        free: Sequence[str],
        dt: float,  # [s]
        frequency: float = 0.0,  # [Hz]
        start: float = 0.0,  # [s]
        *,
        origin: int = 0,
        offsets: Sequence[StateOffset] = (),
        first: FirstStage | None = None,
    ) -> None:
        held = delays_by_ticks(model)
        columns: list[str] = []
        self._first, self._done = first, 0
        self._stages: list[tuple[_Alone | _ByPath | _Differenced, StateJump]] = []
        for k, stage in enumerate(model.stages):
            amounts = np.zeros(stage.initial_state(dt, start).size)
            for each in offsets:
                if each.stage == k:
                    amounts[each.place] += each.amount
            p, incoming = packed[stage.columns], len(columns)
            own = [model.parameters[place] for place in np.arange(packed.size)[stage.columns]]
            numbers = [j for j, q in enumerate(own) if q.name in free and q.name not in held]
            columns += [own[j].name for j in numbers]
            part = _Part(stage, own, p, numbers, incoming, dt, frequency, start)
            jump = StateJump(origin if np.any(amounts) else 0, amounts)
            self._stages.append((_carrier(part), jump))
            if k == 0:
                self._key = (p.tobytes(), *columns)
        self._apart = {
            name: [
                (float(each[model.parameter_names.index(name)]), SensitivityRun(
                    model, each, (), dt, frequency, start, origin=origin, offsets=offsets,
                ))
                for each in _a_tick_apart(model, packed, name, dt)
            ]
            for name in free
            if name in held
        }  # fmt: skip
        self._order = [[*columns, *self._apart].index(name) for name in free]

    def advance(self, voltage: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the displacement of the next samples and its derivatives."""
        # voltage [V] (n,) -> displacement [m] (n,), rows [j] (len(free)
        signal = np.ascontiguousarray(voltage, dtype=np.float64)
        tangent = np.empty((0, signal.size))
        for k, (carrier, jump) in enumerate(self._stages):
            kept = self._first if k == 0 else None
            if kept is not None and self._key in kept:
                signal, tangent = kept[self._key]
                continue
            here = StateJump(jump.sample - self._done, jump.amounts)
            signal, tangent = carrier.go(signal, tangent, here)
            if kept is not None:
                kept.keep(self._key, (signal, tangent))
        for (low, before), (high, after) in self._apart.values():
            change = after.advance(voltage)[0] - before.advance(voltage)[0]
            tangent = np.vstack([tangent, change / (high - low)])
        self._done += signal.size
        if self._order == list(range(len(self._order))):
            return signal, tangent
        return signal, tangent[self._order]


def sensitivities(
    model: Model,
    packed: FloatArray,
    free: Sequence[str],
    voltage: FloatArray,
    dt: float,
    frequency: float = 0.0,
    start: float = 0.0,
    **given: Any,
) -> tuple[FloatArray, FloatArray]:
    """Return the free run from rest and its derivatives in one block, see `SensitivityRun`."""
    return SensitivityRun(model, packed, free, dt, frequency, start, **given).advance(voltage)


class _Part(NamedTuple):
    """A stage with its parameters, those to differentiate by, and the rows from upstream."""

    stage: Stage
    own: Sequence[Parameter]
    p: FloatArray
    columns: Sequence[int]
    incoming: int
    dt: float
    frequency: float
    start: float

    def state(self) -> FloatArray:
        """Return the state of the stage at rest."""
        return self.stage.initial_state(self.dt, self.start)


def _carrier(part: _Part) -> _Alone | _ByPath | _Differenced:
    """Return what propagates a signal and its derivatives through a stage, with their states."""
    stage = part.stage
    if isinstance(stage, TickStage) and not moves_by_ticks(stage):
        return _Alone(part, stage)
    return _ByPath(part, stage) if isinstance(stage, PathStage) else _Differenced(part)


class _Alone:
    """One block, or several in parallel."""

    def __init__(self, part: _Part, stage: TickStage) -> None:
        self._part, self._at = part, BlockPoint(stage.block, part.p, list(part.columns))
        self._state = part.state()
        # derivatives from upstream through a linear block are independent of its state
        linear = stage.block.system is not None and part.incoming > 0
        self._linear = as_linear(stage.block) if linear else None
        if self._linear is not None:
            still = self._linear.initial_state(part.dt, 0.0)
            self._carried = np.tile(still, (part.incoming, 1))
        self._rows = 0 if linear else part.incoming
        self._moved = np.zeros((self._rows + len(part.columns), self._state.size))

    def go(
        self, signal: FloatArray, tangent: FloatArray, jump: StateJump
    ) -> tuple[FloatArray, FloatArray]:
        """Return signal and derivatives after the stage, those by its own parameters last."""
        found, dt = [], self._part.dt
        incoming = tangent[: self._rows]
        for chunk in jump.chunks(signal.size, signal.size, self._state):
            each = partial(_through, signal[chunk], incoming[:, chunk], dt, self._part.frequency)
            found.append(sum_parallel(each, self._at, len(incoming), self._state, self._moved, dt))
        output, rows = (
            found[0]
            if len(found) == 1
            else (
                np.concatenate([y for y, _ in found]),
                np.concatenate([r for _, r in found], axis=1),
            )
        )
        if self._linear is None:
            return output, rows
        on = self._linear.carried(tangent, self._at.values, dt, self._carried)
        return output, np.vstack([on, rows])


class _ByPath:
    """A run by the derivatives along its path; its delays are differenced."""

    def __init__(self, part: _Part, stage: PathStage) -> None:
        p = part.p
        late = [j for j in part.columns if j < stage.run.delays]  # its first parameters
        around = {j: _around(part.own[j], float(p[j])) for j in part.columns if j not in late}
        self._tangents = PathTangents(
            stage.run, p, around, part.dt, start=part.start, frequency=part.frequency,
            incoming=part.incoming,
        )  # fmt: skip
        self._late = _Differenced(part._replace(columns=late, incoming=0)) if late else None

    def go(
        self, signal: FloatArray, tangent: FloatArray, jump: StateJump
    ) -> tuple[FloatArray, FloatArray]:
        """Return signal and derivatives after the stage, those by its own parameters last."""
        output, rows = self._tangents.go(signal, tangent, jump)
        if self._late is None:
            return output, rows
        _, others = self._late.go(signal, tangent[:0], jump, output)
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
    dt: float,
    frequency: float,
    at: BlockPoint,
    state: FloatArray,
    moved: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    block = at.block
    kernel: Any = block.kernel
    times: tuple[float, ...] = (dt, frequency)
    if kernel is None:
        kernel, times = block.path_kernel, (*times, 1)  # the same, with one point per tick
    return propagate_derivatives(kernel, signal, tangent, at, state, moved, *times)


class _Differenced:
    """A stage that is linear in its input, by differences of its own parameters."""

    def __init__(self, part: _Part) -> None:
        self._part, stage, dt = part, part.stage, part.dt
        # on one grid, so that the difference is caused by the parameter alone
        self._grid = {'steps': stage.run.steps(part.p, dt)} if isinstance(stage, PathStage) else {}
        self._moved = [(part.p, part.state())]
        for j in part.columns:
            values = part.p.copy()
            values[j] += parameter_step(part.own[j], part.p[j])
            self._moved.append((values, part.state()))
        self._carried = np.tile(self._moved[0][1], (part.incoming, 1))

    def go(
        self,
        signal: FloatArray,
        tangent: FloatArray,
        jump: StateJump,
        output: FloatArray | None = None,
    ) -> tuple[FloatArray, FloatArray]:
        """Return signal and derivatives after the stage, with its `output` if known."""
        part, incoming = self._part, len(tangent)
        (p, state), *moved = self._moved
        output = self._run(signal, p, state, jump) if output is None else output
        result = np.empty((incoming + len(moved), signal.size))
        if incoming:
            result[:incoming] = self._along(tangent)
        for row, j, (values, memory) in zip(result[incoming:], part.columns, moved, strict=True):
            row[:] = (self._run(signal, values, memory, jump) - output) / (values[j] - p[j])
        return output, result

    def _along(self, tangent: FloatArray) -> FloatArray:
        """Return the derivatives from upstream."""
        part, stage, dt = self._part, self._part.stage, self._part.dt
        if isinstance(stage, LinearStage):
            return stage.carried(tangent, part.p, dt, self._carried)
        assert isinstance(stage, TickStage)  # a delay
        result = np.empty_like(tangent)
        for row, column, state in zip(result, tangent, self._carried, strict=True):
            row[:] = stage.respond(
                np.ascontiguousarray(column), part.p, dt, state=state, frequency=0.0
            )
        return result

    def _run(
        self, signal: FloatArray, values: FloatArray, state: FloatArray, jump: StateJump
    ) -> FloatArray:
        part = self._part
        return np.concatenate(
            [
                part.stage.respond(
                    signal[chunk], values, part.dt, state=state, frequency=part.frequency,
                    **self._grid,
                )
                for chunk in jump.chunks(signal.size, signal.size, state)
            ]
        )  # fmt: skip


def moves_by_ticks(stage: Stage) -> TypeGuard[TickStage]:
    """Return whether a stage keeps a held signal, so that a delay moves it by whole ticks."""
    return isinstance(stage, TickStage) and stage.block.between is InterSample.DELAY


def delays_by_ticks(model: Model) -> set[str]:
    """Return the names of the delays that move a held signal by whole ticks.

    Creep passes a held signal on at once and adds to it, so a delay before it also moves most of
    the response by whole ticks; a mode or a lag does not.
    """
    names: set[str] = set()
    for stage in model.stages:
        passes = isinstance(stage, LinearStage) and all(
            _feedthrough(part.block) != 0.0 for part in stage.parts[stage.delays :]
        )
        if passes or moves_by_ticks(stage):
            delays = (block for block in stage.blocks if block.between is InterSample.DELAY)
            names.update(each.name for block in delays for each in block.parameters)
    return names


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
