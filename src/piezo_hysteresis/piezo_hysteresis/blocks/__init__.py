"""The blocks of models, one file each, with their compiled kernels.

Every module of this package that defines ``BLOCK`` (or several, ``BLOCKS``) is registered
automatically; its ``EFFECTS`` define how discovery may add the block to a model.
"""

from __future__ import annotations

import importlib
import pkgutil

from piezo_hysteresis.blocks.base import Block, Parameter, Slot
from piezo_hysteresis.blocks.effect import Effect
from piezo_hysteresis.blocks.parallel import SEPARATOR, parallel_block
from piezo_hysteresis.common.wording import choices
from piezo_hysteresis.errors import ModelError

__all__ = ['BLOCKS', 'EFFECTS', 'Block', 'Effect', 'Parameter', 'Slot', 'named_block']


def _register() -> tuple[dict[str, Block], tuple[Effect, ...]]:
    blocks: dict[str, Block] = {}
    effects: list[Effect] = []
    for module in sorted(pkgutil.iter_modules(__path__), key=lambda each: each.name):
        content = vars(importlib.import_module(f'{__name__}.{module.name}'))
        single = (content['BLOCK'],) if 'BLOCK' in content else ()
        for block in (*single, *content.get('BLOCKS', ())):
            if block.name in blocks:
                raise ModelError(
                    f'two blocks are called {block.name}; rename the one in {module.name}.py'
                )
            blocks[block.name] = block
        effects.extend(content.get('EFFECTS', ()))
    return blocks, tuple(effects)


BLOCKS, EFFECTS = _register()


def named_block(name: str) -> Block:
    """Return the registered block called `name`, or parallel blocks, ``first|second``.

    Raises
    ------
    ModelError
        If there is no such block.
    """
    if SEPARATOR in name:
        return parallel_block(*(named_block(each) for each in name.split(SEPARATOR)))
    if name not in BLOCKS:
        raise ModelError(f'there is no block {name}{choices(name, BLOCKS)}')
    return BLOCKS[name]
