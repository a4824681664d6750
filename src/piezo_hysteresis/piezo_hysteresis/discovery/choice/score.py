"""Held-out error of a selected model."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class HeldOutScore:
    """Error of the selected model on the held-out rest of a record."""

    record: str  # name of the record
    free_run_rms: float  # free-run error after the cut [m]
    nrmse_percent: float  # [%]
