"""Options of verbs about records: how they begin, and where their zeros lie."""

from piezo_hysteresis.identification.initial_conditions.record_start import STARTS
from piezo_hysteresis.identification.initial_conditions.revision import ZEROS

__all__ = ['STARTS', 'START_HELP', 'ZEROS', 'ZERO_HELP']

START_HELP = (
    'how records begin: at rest at 0 V with a step (step), at rest at their first voltage (rest), '
    'in their own steady cycle (settled), in a state to be estimated (estimate), or as the data '
    'say (auto)'
)
ZERO_HELP = (
    'zero of the displacement: one for all records (common), one for each (record), or as the '
    'data say (auto)'
)
