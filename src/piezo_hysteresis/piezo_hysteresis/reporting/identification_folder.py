"""Output folder of an identification: model, parameters, figures and report.

Complete or unchanged.
"""

from __future__ import annotations

import json
from collections.abc import Sequence

import yaml

from piezo_hysteresis.identification.identify import Identification
from piezo_hysteresis.records import Record
from piezo_hysteresis.reporting.folder import write_folder
from piezo_hysteresis.reporting.identification_figures import figures
from piezo_hysteresis.reporting.identification_report import free_runs, identification_page


def write_identification(
    out: str, found: Identification, records: Sequence[Record], data: Sequence[str] = ()
) -> None:
    """Write model.yaml, params.yaml, summary.json, report.html and figures.

    Parameters
    ----------
    out : str
        Folder; created if missing.
    found : Identification
        Result of the identification.
    records : sequence of Record
        Records of the identification.
    data : sequence of str
        Paths of the records.

    Raises
    ------
    PiezoError
        If the folder cannot be written or holds the results of another verb, or the parameters are
        not a valid model.
    """
    saved = found.model_file(data, records[0].rate)
    drawn = figures(
        records,
        free_runs(records, found),
        found.records,
        noise_floor=found.noise_floor,
    )
    ros = {'/**': {'ros__parameters': saved.to_ros_parameters()}}
    write_folder(
        out,
        {
            'model.yaml': saved.text(),
            'params.yaml': yaml.safe_dump(ros, sort_keys=False),
            'summary.json': json.dumps(found.summary(), indent=2, allow_nan=False) + '\n',
            'report.html': identification_page(records, found, data=data, folder=out),
            **drawn,
        },
        'identify',
    )
