"""How records began, told again by a model that knows an effect."""

from __future__ import annotations

from dataclasses import replace

from piezo_hysteresis.discovery.data.dataset import Dataset
from piezo_hysteresis.discovery.selection.baseline import told_by
from piezo_hysteresis.discovery.selection.candidate_fit import CandidateFit
from piezo_hysteresis.identification.circumstances import Choices


def told_again(fit: CandidateFit, data: Dataset, choices: Choices, workers: int) -> Dataset:
    """Return the data with starts and zeros of the records as a model tells them.

    Weights stay, so that sums of squares can be compared.
    """
    weights = {view.name: view.precision for view in (*data.training, *data.held_out)}
    renewed = told_by(fit, data, choices, workers)
    return renewed.with_each(lambda view: replace(view, precision=weights[view.name]))
