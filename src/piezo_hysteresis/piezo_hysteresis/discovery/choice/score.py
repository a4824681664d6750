"""Held-out error of a selected model."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class HeldOutScore:
    """Error of the selected model on the held-out rest of a record.

    Attributes
    ----------
    record : str
        Name of the record.
    free_run_rms : float
        Free-run error after the cut [m].
    nrmse_percent : float
        Free-run error relative to the standard deviation of the displacement [%].
    """

    record: str
    free_run_rms: float
    nrmse_percent: float
