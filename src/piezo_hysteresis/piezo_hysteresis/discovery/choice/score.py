"""What a chosen model leaves of what it has not seen."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class HeldOutScore:
    """What the chosen model leaves of the rest of a record, which it was not fitted to.

    Attributes
    ----------
    record : str
        Name.
    free_run_rms : float
        Free-run error behind the cut [m].
    nrmse_percent : float
        100 times that over the standard deviation of the displacement there.
    """

    record: str
    free_run_rms: float
    nrmse_percent: float
