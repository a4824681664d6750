"""Output folder of a discovery: verdict, model, parameters and report, complete or unchanged."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import yaml

from piezo_hysteresis.discovery import Discovery
from piezo_hysteresis.discovery.live.apply import simulator_parameters
from piezo_hysteresis.reporting.discovery_report import discovery_page
from piezo_hysteresis.reporting.folder import write_folder


def write_discovery(out: str | Path, found: Discovery, data: Sequence[str] = ()) -> None:
    """Write verdict.json, model.yaml, params.yaml, simulator.yaml and report.html.

    Raises
    ------
    PiezoError
        If the folder cannot be written, or holds the results of another verb.
    """
    saved = found.model_file(data)
    ros = {'/**': {'ros__parameters': saved.to_ros_parameters()}}
    simulator = simulator_parameters(saved)
    note = ''
    if simulator.missing:
        note = f'# Without counterpart in the simulator: {", ".join(simulator.missing)}\n'
    verdict = json.dumps(found.verdict.to_dict(), indent=2, allow_nan=False)
    write_folder(
        out,
        {
            'verdict.json': verdict + '\n',
            'model.yaml': saved.text(),
            'params.yaml': yaml.safe_dump(ros, sort_keys=False),
            'simulator.yaml': note + yaml.safe_dump(simulator.to_ros(), sort_keys=False),
            'report.html': discovery_page(found),
        },
        'discover',
    )
