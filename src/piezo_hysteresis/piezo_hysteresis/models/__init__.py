"""Named chains of blocks: classical, modified, extended, enhanced, second order, ..."""

from piezo_hysteresis.models.chain import Model, State
from piezo_hysteresis.models.modelfile import ModelFile, Provenance
from piezo_hysteresis.models.named import NAMES, named
from piezo_hysteresis.models.scaling import for_range

__all__ = ['NAMES', 'Model', 'ModelFile', 'Provenance', 'State', 'for_range', 'named']
