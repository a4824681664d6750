"""The named models: what the papers call their models, as chains of blocks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from piezo_hysteresis.blocks import named_block
from piezo_hysteresis.errors import ModelError
from piezo_hysteresis.models.chain import Model


@dataclass(frozen=True)
class Recipe:
    """How a named model is put together.

    Attributes
    ----------
    blocks : tuple of str
        Names of its blocks, in order.
    description : str
        One sentence.
    source : str
        Paper and equation.
    held : mapping of str to float
        Parameters that are not free.
    """

    blocks: tuple[str, ...]
    description: str
    source: str
    held: Mapping[str, float] = field(default_factory=dict)


_SYMMETRIC = {'A0': 0.0}

RECIPES: dict[str, Recipe] = {
    'linear_mode': Recipe(
        ('gain', 'mode', 'offset'),
        'No hysteresis: a gain, one mode and an offset.',
        '002 (3) without h',
    ),
    'classical': Recipe(
        ('bouc_wen_exact', 'offset'),
        'Bouc-Wen hysteresis centred on the origin, exact step.',
        '001 (18), 003 (1)',
        _SYMMETRIC,
    ),
    'modified': Recipe(
        ('bouc_wen_exact', 'offset'),
        'Bouc-Wen hysteresis off centre (A0 free), exact step.',
        '000 (1), (2); 001 (3)',
    ),
    'extended': Recipe(
        ('bouc_wen', 'autoregressive', 'offset'),
        'Off-centre Bouc-Wen hysteresis by Euler step and an autoregression, as printed.',
        '000 (3), 001 (7)',
    ),
    'classical_euler': Recipe(
        ('bouc_wen', 'offset'),
        'The classical model by the printed Euler step.',
        '001 (18), 003 (1)',
        _SYMMETRIC,
    ),
    'modified_euler': Recipe(
        ('bouc_wen', 'offset'),
        'The modified model by the printed Euler step.',
        '000 (2), (3)',
    ),
}

NAMES: tuple[str, ...] = tuple(RECIPES)


def named(name: str) -> Model:
    """Return the model called `name`, one of `NAMES`.

    Raises
    ------
    ModelError
        If there is no such model.
    """
    if name not in RECIPES:
        raise ModelError(f'there is no model {name}; choose one of {", ".join(NAMES)}')
    recipe = RECIPES[name]
    return Model(name, tuple(named_block(each) for each in recipe.blocks), recipe.held)
