"""What verbs may be told of records: how they begin, and where their zeros lie."""

from piezo_hysteresis.identification.circumstances import ZEROS
from piezo_hysteresis.identification.record_start import STARTS

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
