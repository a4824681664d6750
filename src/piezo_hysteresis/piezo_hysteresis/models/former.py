"""Model files of former versions: blocks that are one with another block today.

A chain once passed one number per tick, and blocks that move between the ticks had variants for
what stood before or behind them. They are read as the block whose physics they meant.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from typing import Any

from piezo_hysteresis.blocks import BLOCKS, Block, named_block
from piezo_hysteresis.blocks.base import Former
from piezo_hysteresis.models.chain import Model


class FormerModelWarning(UserWarning):
    """A model of a former version has been read as one of today."""


_FORMER: dict[str, tuple[Block, Former]] = {
    former.name: (block, former) for block in BLOCKS.values() for former in block.formers
}


def of_today(chain: Sequence[str], rows: Mapping[str, Any]) -> tuple[list[str], dict[str, Any]]:
    """Return chain and parameters with blocks of former versions translated, and say so.

    Parameters
    ----------
    chain : sequence of str
        Names of blocks.
    rows : mapping
        What belongs to each parameter, by its name in the model.
    """
    if not set(chain) & set(_FORMER):
        return list(chain), dict(rows)
    counts: dict[str, int] = {}
    moved: list[tuple[str, list[str]]] = []
    known: set[str] = set()
    for name in chain:
        block, former = _FORMER[name] if name in _FORMER else (named_block(name), None)
        now = block.name
        own = [q.name if former is None else former.names[q.name] for q in block.parameters]
        own = [_numbered(each, counts) for each in own]
        known |= set(own)
        known |= {_numbered(each, counts) for each in (former.dropped if former else ())}
        moved.insert(0 if former is not None and former.first else len(moved), (now, own))
    model = Model('', tuple(named_block(name) for name, _ in moved))
    before = [name for _, own in moved for name in own]
    after = model.parameter_names
    translated = {new: rows[old] for new, old in zip(after, before, strict=True) if old in rows}
    stray = {name: row for name, row in rows.items() if name not in known}
    text = ', '.join(f'{name} as {_FORMER[name][0].name}' for name in chain if name in _FORMER)
    warnings.warn(
        f'the model is of a former version and read anew: {text}; fit it again to be exact',
        FormerModelWarning,
        stacklevel=4,
    )
    return [name for name, _ in moved], {**translated, **stray}


def _numbered(name: str, counts: dict[str, int]) -> str:
    count = counts[name] = counts.get(name, 0) + 1
    return name if count == 1 else f'{name}_{count}'
