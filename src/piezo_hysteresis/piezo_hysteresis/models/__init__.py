"""Named chains of blocks: classical, modified, extended, enhanced, second order, ..."""

from piezo_hysteresis.models.chain import Model, State
from piezo_hysteresis.models.named import NAMES, named

__all__ = ['NAMES', 'Model', 'State', 'named']
