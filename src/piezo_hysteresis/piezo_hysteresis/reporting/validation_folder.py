"""Output folder of a validation: report, errors, figures and model; complete or unchanged."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict

from piezo_hysteresis.discovery.detection.limits import DetectionLimit
from piezo_hysteresis.discovery.verdict.verdict import plain_types
from piezo_hysteresis.identification.validate import Validation
from piezo_hysteresis.reporting.folder import write_folder
from piezo_hysteresis.reporting.identification_figures import figures
from piezo_hysteresis.reporting.validation_report import validation_page


def write_validation(
    out: str,
    validation: Validation,
    *,
    model: str = 'model.yaml',
    data: Sequence[str] = (),
    limits: Sequence[DetectionLimit] = (),
) -> None:
    """Write report.html, summary.json, model.yaml and figures.

    Parameters
    ----------
    out : str
        Folder; created if missing.
    validation : Validation
        Errors of a model on records.
    model : str
        Path of the model for the recommended command.
    data : sequence of str
        Paths of the records for the recommended command.
    limits : sequence of DetectionLimit
        Detection limits of these records, where they were calculated.

    Raises
    ------
    PiezoError
        If the folder cannot be written or holds the results of another verb.
    """
    summary = validation.summary()
    if limits:
        summary['detection_limits'] = plain_types([asdict(each) for each in limits])
    write_folder(
        out,
        {
            'report.html': validation_page(validation, model=model, data=data, limits=limits),
            'summary.json': json.dumps(summary, indent=2, allow_nan=False) + '\n',
            'model.yaml': validation.updated.text(),
            **figures(
                validation.data,
                validation.simulated,
                validation.records,
                noise_floor=validation.noise_floor,
            ),
        },
        'validate',
    )
