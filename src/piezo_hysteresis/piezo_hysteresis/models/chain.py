"""A model: a chain of blocks in series, with one flat list of parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Block, InterSample, InverseRole, Parameter, Slot
from piezo_hysteresis.blocks.parallel import parallel_block, parts_of
from piezo_hysteresis.common.cached_property import cached_property
from piezo_hysteresis.common.wording import near
from piezo_hysteresis.errors import ModelError
from piezo_hysteresis.models.simulation.plan import Stage, stages_of

State = list[FloatArray]

_ORDER = {slot: place for place, slot in enumerate(Slot)}


@dataclass(frozen=True)
class Model:
    """An immutable chain of blocks; free run is feed-forward.

    Parameter names are unique over all registered blocks; a second instance of a block in the
    chain has the suffix ``_2``.

    Attributes
    ----------
    name : str
        Name in commands and files.
    blocks : tuple of Block
        From the voltage to the displacement, ordered by slot.
    held : mapping of str to float
        Parameters that are not free: their bounds coincide at this value (``A0`` of the classical
        model, the range that the thresholds of a play bank refer to). They are not fitted.
    """

    name: str
    blocks: tuple[Block, ...]
    held: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        stray = sorted(set(self.held) - {name for row in self._names for name in row})
        if stray:
            raise ModelError(f'model {self.name} holds {", ".join(stray)} which it does not have')
        places = [_ORDER[block.slot] for block in self.blocks]
        if places != sorted(places):
            chain = ' -> '.join(f'{block.name} ({block.slot})' for block in self.blocks)
            raise ModelError(
                f'model {self.name}: the blocks are out of order: {chain}; order them '
                f'{" -> ".join(Slot)}'
            )

    @cached_property
    def _names(self) -> list[list[str]]:
        seen: dict[str, int] = {}
        names = []
        for block in self.blocks:
            row = []
            for parameter in block.parameters:
                count = seen[parameter.name] = seen.get(parameter.name, 0) + 1
                row.append(parameter.name if count == 1 else f'{parameter.name}_{count}')
            names.append(row)
        return names

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Every parameter of the chain, with its unique name; held ones have equal bounds."""
        return tuple(
            replace(parameter, name=name)
            if name not in self.held
            else replace(
                parameter,
                name=name,
                default=self.held[name],
                low=self.held[name],
                high=self.held[name],
            )
            for block, row in zip(self.blocks, self._names, strict=True)
            for parameter, name in zip(block.parameters, row, strict=True)
        )

    @cached_property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of `parameters`, in the order of packed values."""
        return tuple(parameter.name for parameter in self.parameters)

    @cached_property
    def free_names(self) -> tuple[str, ...]:
        """Names of the parameters that a fit may change."""
        return tuple(parameter.name for parameter in self.parameters if not parameter.held)

    @property
    def zero_names(self) -> frozenset[str]:
        """Names of the parameters that move the zero of the displacement only."""
        zeros = (self.names_of(block) for block in self.blocks if block.role is InverseRole.ZERO)
        return frozenset(name for names in zeros for name in names.values())

    @property
    def has_fixed_rate(self) -> bool:
        """Whether a block is a recursion from tick to tick, valid at its sampling rate only."""
        return any(block.between is InterSample.TICK for block in self.blocks)

    @property
    def answers_at_once(self) -> bool:
        """Whether the output at a tick includes the voltage of that tick.

        The output of a chain with inertia is that at the tick, before its voltage acts, like a
        measurement. The output of any other chain is that at the end of the tick, just before the
        next voltage acts: it corresponds to the measurement of the next tick. This depends only on
        the blocks, so that no parameter value shifts the clock.
        """
        return not any(block.inertia for block in self.blocks)

    def defaults(self) -> dict[str, float]:
        """Return every parameter at its default, held ones at their held values."""
        return {parameter.name: parameter.default for parameter in self.parameters}

    def pack(self, values: Mapping[str, float], *, checked: bool = True) -> FloatArray:
        """Order `values` for `respond`, checking bounds and combinations.

        Parameters
        ----------
        values : mapping of str to float
            Parameters by name; missing ones take their default.
        checked : bool
            False skips bounds and combinations, for intermediate estimates.

        Raises
        ------
        ModelError
            If a name is unknown or a value impossible.
        """
        stray = sorted(set(values) - set(self.parameter_names))
        if stray:
            raise ModelError(
                f'model {self.name} has no parameter {", ".join(stray)}'
                f'{near(stray[0], self.parameter_names)}; it has '
                f'{", ".join(self.parameter_names)}'
            )
        every = {**self.defaults(), **values}
        if not checked:
            return np.array([float(every[name]) for name in self.parameter_names])
        for name, value in self.held.items():
            if every[name] != value:
                raise ModelError(
                    f'model {self.name} holds {name} at {value:g}, got {every[name]:g}; leave it '
                    'out, or free it with Model.free'
                )
        packed = [
            block.pack(
                {q.name: every[name] for q, name in zip(block.parameters, row, strict=True)}
            )
            for block, row in zip(self.blocks, self._names, strict=True)
        ]
        return np.concatenate(packed) if packed else np.empty(0)

    def fastest_rate(self, packed: FloatArray) -> float:
        """Return the fastest rate of the blocks that integrate a mode in small steps [1/s].

        Parameters
        ----------
        packed : ndarray, shape (p,)
            Parameters as `pack` orders them.
        """
        first, rate = 0, 0.0
        for block in self.blocks:
            last = first + len(block.parameters)
            if block.mode is not None:
                rate = max(rate, float(block.mode.pace(packed[first:last])))
            first = last
        return rate

    def unpack(self, packed: FloatArray) -> dict[str, float]:
        """Name the numbers of `packed`."""
        return dict(zip(self.parameter_names, packed.tolist(), strict=True))

    def names_of(self, block: Block) -> dict[str, str]:
        """Return the model's names of the parameters of `block`, the last one if it is repeated.

        Raises
        ------
        ModelError
            If the model has no such block.
        """
        for each, row in zip(reversed(self.blocks), reversed(self._names), strict=True):
            names = {q.name: name for q, name in zip(each.parameters, row, strict=True)}
            if block.name in (each.name, *(part.name for part in parts_of(each))):
                return {q.name: names[q.name] for q in block.parameters}
        raise ModelError(f'model {self.name} has no block {block.name}')

    def initial_state(self, dt: float, start: float = 0.0) -> State:
        """Return the state of every stage at rest; `start` is the time of the first sample [s]."""
        return [stage.initial_state(dt, start) for stage in self.stages]

    @cached_property
    def stages(self) -> tuple[Stage, ...]:
        """Simulation stages of the chain: one per block if every signal in between is held."""
        return stages_of(self.blocks)

    def respond(
        self,
        voltage: FloatArray,
        packed: FloatArray,
        dt: float,
        *,
        state: State | None = None,
        frequency: float = 0.0,
        first: int = 0,
    ) -> FloatArray:
        """Free run: return the displacement [m] for `voltage` [V] with zero-order hold.

        The output of a chain with inertia is that at the tick, before its voltage acts; without
        inertia at the end of the tick, just before the next voltage acts (see `answers_at_once`).

        Parameters
        ----------
        voltage : ndarray, shape (n,)
            Commanded input [V].
        packed : ndarray, shape (p,)
            Parameters from `pack`; not checked again.
        dt : float
            Sampling interval [s].
        state : list of ndarray, optional
            Initial state, updated in place; default at rest.
        frequency : float
            Fundamental frequency of the excitation [Hz], for blocks that depend on it.
        first : int
            First stage to run; `voltage` is then its input.
        """
        state = self.initial_state(dt) if state is None else state
        signal = np.ascontiguousarray(voltage, dtype=np.float64)
        for stage, memory in zip(self.stages[first:], state[first:], strict=True):
            signal = stage.respond(
                signal, packed[stage.columns], dt, state=memory, frequency=frequency
            )
        return signal

    def hold(self, **values: float) -> Model:
        """Return the model with these parameters held at these values."""
        return replace(self, held={**self.held, **values})

    def free(self, *names: str) -> Model:
        """Return the model with these parameters free."""
        return replace(self, held={k: v for k, v in self.held.items() if k not in names})

    @property
    def block_names(self) -> tuple[str, ...]:
        """Names of all blocks, with parallel blocks listed separately."""
        return tuple(part.name for block in self.blocks for part in parts_of(block))

    def with_block(self, block: Block, name: str = '', *, first: bool = False) -> Model:
        """Return the chain with `block` added after (or before) the others of its slot.

        A block in parallel with the hysteresis is joined to the last block of its slot.

        Raises
        ------
        ModelError
            If the model has no block for a parallel connection.
        """
        name = name or f'{self.name}+{block.name}'
        if block.in_parallel:
            places = [i for i, each in enumerate(self.blocks) if each.slot is block.slot]
            if not places:
                raise ModelError(f'model {self.name} has no {block.slot} for {block.name} to join')
            chain = list(self.blocks)
            chain[places[-1]] = parallel_block(chain[places[-1]], block)
        else:
            chain = [block, *self.blocks] if first else [*self.blocks, block]
            chain.sort(key=lambda each: _ORDER[each.slot])
        return Model(name, tuple(chain), self.held)

    def without(self, block: Block) -> Model:
        """Return the chain without one of its blocks."""
        rest = tuple(each for each in self.blocks if each is not block)
        own = set(self.names_of(block).values())
        held = {name: value for name, value in self.held.items() if name not in own}
        return Model(f'{self.name}-{block.name}', rest, held)

    def with_replaced(self, block_name: str, block: Block, name: str = '') -> Model:
        """Return the chain with `block` instead of the first one called `block_name`.

        Raises
        ------
        ModelError
            If the model has no such block.
        """
        for place, each in enumerate(self.blocks):
            parts = list(parts_of(each))
            names = [part.name for part in parts]
            if block_name in names:
                parts[names.index(block_name)] = block
                chain = list(self.blocks)
                chain[place] = parallel_block(*parts)
                chain.sort(key=lambda one: _ORDER[one.slot])
                return Model(name or self.name, tuple(chain))._holding(self.held)
        raise ModelError(f'model {self.name} has no block {block_name}')

    def without_block(self, block_name: str) -> Model:
        """Return the chain without the last block called `block_name`.

        Raises
        ------
        ModelError
            If the model has no such block.
        """
        for place in reversed(range(len(self.blocks))):
            parts = list(parts_of(self.blocks[place]))
            names = [part.name for part in parts]
            if block_name in names:
                del parts[names.index(block_name)]
                kept = [parallel_block(*parts)] if parts else []
                chain = (*self.blocks[:place], *kept, *self.blocks[place + 1 :])
                return Model(self.name, chain)._holding(self.held)
        raise ModelError(f'model {self.name} has no block {block_name}')

    def _holding(self, held: Mapping[str, float]) -> Model:
        known = set(self.parameter_names)
        return replace(self, held={k: v for k, v in held.items() if k in known})
