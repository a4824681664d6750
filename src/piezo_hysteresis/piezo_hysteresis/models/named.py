"""Named models: the models of the papers, and others, as chains of blocks."""

from __future__ import annotations

import re

from piezo_hysteresis.blocks import named_block
from piezo_hysteresis.common.recipes import NAMES, RECIPES
from piezo_hysteresis.common.wording import choices
from piezo_hysteresis.errors import ModelError
from piezo_hysteresis.models.chain import Model

# --- models by purpose; no other package names blocks --------------------------------

#: The bank of plays that recursive methods identify.
BANK = 'prandtl_ishlinskii'
#: Hystereses that are compared if the model is selected from the data, the simplest first.
MEMORIES = ('modified', 'prandtl_ishlinskii_fine')
#: Added blocks for a comparison, in the usual order of relevance, with their names in tables.
LADDER = {
    'mode': 'one lightly damped mode',
    'sensor_nonlinearity': 'curve of the sensor',
    'amplifier_lag': 'lag of the amplifier',
    'creep': 'creep',
    'electrostriction': 'electrostriction (square law)',
}
#: Chains that a recursive method identifies.
ONLINE: dict[str, tuple[tuple[str, ...], ...]] = {
    'rls_ud': (RECIPES['classical'].blocks, RECIPES['bouc_wen_mode'].blocks),
    'pi_bank': (RECIPES[BANK].blocks, (BANK, 'mode', 'offset')),
}
#: Two parallel blocks, for the rehearsal of their kernels.
PARALLEL = ('bouc_wen_exact', 'electrostriction')
#: Chains that are simulated between the ticks, one for each method, for the rehearsal of kernels.
FOLLOWED = (
    ('transport_delay', 'bouc_wen_exact', 'mode', 'creep'),
    ('transport_delay', 'amplifier_lag', 'bouc_wen_exact', 'mode', 'backlash', 'sensor_lag'),
    ('amplifier_lag', 'bouc_wen_oscillator'),
    ('slew_limit', 'bouc_wen_exact', 'mode'),
)


#: What the literature calls a model in short.
_SHORT = {
    'pi': ('prandtl_ishlinskii',),
    'mpi': ('prandtl_ishlinskii',),
    'play': ('prandtl_ishlinskii',),
    'prandtl': ('prandtl_ishlinskii',),
    'bw': ('classical', 'bouc_wen_mode'),
    'bouc_wen': ('classical', 'bouc_wen_mode'),
    'boucwen': ('classical', 'bouc_wen_mode'),
    'linear': ('linear_mode',),
}


def named(name: str) -> Model:
    """Return the model called `name`: one of `NAMES`, with further blocks after a ``+``.

    Raises
    ------
    ModelError
        If there is no such model or block.
    """
    if not isinstance(name, str):
        raise ModelError(
            f'the name of a model is text such as classical, not of type {type(name).__name__}'
        )
    first, *blocks = (_plain(each) for each in name.split('+'))
    if first not in RECIPES:
        if meant := _SHORT.get(first):
            raise ModelError(f'there is no model {name}; did you mean {" or ".join(meant)}?')
        raise ModelError(f'there is no model {first}{choices(first, NAMES)}')
    recipe = RECIPES[first]
    model = Model(first, tuple(named_block(each) for each in recipe.blocks), recipe.held)
    for block in blocks:
        model = model.with_block(named_block(block))
    return model


def _plain(name: str) -> str:
    """Return a name in the spelling of the suite: 'Bouc-Wen mode' is bouc_wen_mode."""
    plain = re.sub(r'[\s\-]+', '_', name.strip())
    return plain if plain in RECIPES or '|' in plain else plain.lower()


def name_of(model: Model) -> str:
    """Return the name with which `named` returns this chain; empty if there is none.

    Of several names the one with the same held parameters has priority.
    """
    chain = [block.name for block in model.blocks]
    found: dict[str, bool] = {}
    for name in (model.name, *NAMES):
        try:
            other = named(name)
            more = [each for each in chain if each not in other.block_names]
            full = '+'.join((name, *more))
            other = named(full)
        except ModelError:
            continue
        if [block.name for block in other.blocks] == chain:
            found[full] = set(other.held) == set(model.held)
    return next((name for name, same in found.items() if same), next(iter(found), ''))
