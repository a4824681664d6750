"""A model: a chain of blocks, one after another, with one flat list of parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.blocks.base import Block, Parameter, Slot
from piezo_hysteresis.errors import ModelError

State = list[FloatArray]

_ORDER = {slot: place for place, slot in enumerate(Slot)}


@dataclass(frozen=True)
class Model:
    """An immutable chain of blocks; free run is feed-forward.

    Parameter names are unique over all registered blocks; a block that stands in the chain a
    second time has ``_2`` behind its names.

    Attributes
    ----------
    name : str
        What commands and files call it.
    blocks : tuple of Block
        From the voltage to the displacement, ordered by slot.
    """

    name: str
    blocks: tuple[Block, ...]

    def __post_init__(self) -> None:
        places = [_ORDER[block.slot] for block in self.blocks]
        if places != sorted(places):
            chain = ' -> '.join(f'{block.name} ({block.slot})' for block in self.blocks)
            raise ModelError(
                f'model {self.name}: blocks stand out of order: {chain}; order them '
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
        """Every parameter of the chain, with its unique name."""
        return tuple(
            replace(parameter, name=name)
            for block, row in zip(self.blocks, self._names, strict=True)
            for parameter, name in zip(block.parameters, row, strict=True)
        )

    @cached_property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of `parameters`, in the order of packed values."""
        return tuple(parameter.name for parameter in self.parameters)

    def defaults(self) -> dict[str, float]:
        """Return every parameter at its default."""
        return {parameter.name: parameter.default for parameter in self.parameters}

    def pack(self, values: Mapping[str, float]) -> FloatArray:
        """Order `values` for `respond`, checking bounds and combinations.

        Raises
        ------
        ModelError
            If a name is unknown or a value impossible.
        """
        stray = sorted(set(values) - set(self.parameter_names))
        if stray:
            raise ModelError(
                f'model {self.name} has no parameter {", ".join(stray)}; it has '
                f'{", ".join(self.parameter_names)}'
            )
        packed = []
        for block, row in zip(self.blocks, self._names, strict=True):
            own = {
                parameter.name: values[name]
                for parameter, name in zip(block.parameters, row, strict=True)
                if name in values
            }
            packed.append(block.pack(own))
        return np.concatenate(packed) if packed else np.empty(0)

    def unpack(self, packed: FloatArray) -> dict[str, float]:
        """Name the numbers of `packed`."""
        return dict(zip(self.parameter_names, (float(v) for v in packed), strict=True))

    def initial_state(self, dt: float) -> State:
        """Return the memory of every block at rest."""
        return [block.initial_state(dt) for block in self.blocks]

    def respond(
        self,
        voltage: FloatArray,
        packed: FloatArray,
        dt: float,
        *,
        state: State | None = None,
        frequency: float = 0.0,
    ) -> FloatArray:
        """Free run: answer the displacement [m] to `voltage` [V].

        Parameters
        ----------
        voltage : ndarray, shape (n,)
            Commanded input [V].
        packed : ndarray, shape (p,)
            Parameters from `pack`; not checked again.
        dt : float
            Sampling interval [s].
        state : list of ndarray, optional
            Memory to go on from, updated in place; at rest where it is not given.
        frequency : float
            Fundamental frequency of the excitation [Hz], for blocks that depend on it.
        """
        state = self.initial_state(dt) if state is None else state
        signal = np.ascontiguousarray(voltage, dtype=np.float64)
        first = 0
        for block, memory in zip(self.blocks, state, strict=True):
            last = first + len(block.parameters)
            signal = block.respond(
                signal, packed[first:last], dt, state=memory, frequency=frequency
            )
            first = last
        return signal

    def with_block(self, block: Block, name: str = '') -> Model:
        """Return the chain with `block` added behind the others of its slot."""
        blocks = sorted([*self.blocks, block], key=lambda each: _ORDER[each.slot])
        return Model(name or f'{self.name}+{block.name}', tuple(blocks))

    def without_block(self, block_name: str) -> Model:
        """Return the chain without the last block called `block_name`."""
        kept = list(self.blocks)
        for place in reversed(range(len(kept))):
            if kept[place].name == block_name:
                del kept[place]
                return Model(self.name, tuple(kept))
        raise ModelError(f'model {self.name} has no block {block_name}')
