"""Named chains of blocks: classical, modified, extended, enhanced, second order, ..."""

from piezo_hysteresis.blocks.parameter_shift import PARAMETER_SHIFT
from piezo_hysteresis.common.recipes import NAMES, RECIPES
from piezo_hysteresis.models.chain import Model, State
from piezo_hysteresis.models.correlation import Correlation
from piezo_hysteresis.models.discrepancy import Condition, Discrepancy, Missed
from piezo_hysteresis.models.effects import (
    EFFECT_NAMES,
    Candidate,
    add_effect,
    applicable,
    candidates,
    described,
    for_range,
    shifted,
)
from piezo_hysteresis.models.modelfile import ModelFile, Provenance
from piezo_hysteresis.models.named import name_of, named

__all__ = [
    'EFFECT_NAMES',
    'NAMES',
    'PARAMETER_SHIFT',
    'RECIPES',
    'Candidate',
    'Condition',
    'Correlation',
    'Discrepancy',
    'Missed',
    'Model',
    'ModelFile',
    'Provenance',
    'State',
    'add_effect',
    'applicable',
    'candidates',
    'described',
    'for_range',
    'name_of',
    'named',
    'shifted',
]
