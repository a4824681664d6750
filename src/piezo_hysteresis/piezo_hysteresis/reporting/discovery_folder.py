"""The folder that a discovery leaves: verdict, model, parameters, report; whole or not at all."""

from __future__ import annotations

import json
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

import yaml

from piezo_hysteresis.discovery import Discovery
from piezo_hysteresis.discovery.apply import simulator_parameters
from piezo_hysteresis.models import ModelFile, Provenance
from piezo_hysteresis.reporting.discovery_report import discovery_page
from piezo_hysteresis.reporting.folder import write_folder


def model_file(found: Discovery, data: Sequence[str] = ()) -> ModelFile:
    """Return the final model with its values, deviations and where they come from."""
    final = found.final
    own = {name: final.values[name] for name in final.model.parameter_names}
    std = final.fitted.std if final.fitted is not None else {}
    effects = ', '.join(e.name for e in found.verdict.effects) or 'none'
    return ModelFile(
        final.model,
        own,
        {name: value for name, value in std.items() if name in own},
        Provenance(
            data=tuple(data),
            date=datetime.now(UTC).isoformat(timespec='seconds'),
            fit=f'discover, baseline {found.verdict.baseline}, seed {found.verdict.seed}',
            rate=found.data.records[0].rate,
            noise_floor=found.floor,
            free_run_rms=final.rms,
            notes={
                'effects': effects,
                'sampling_offset_s': float(final.sampling_offset),
            },
        ),
    )


def write_discovery(out: str | Path, found: Discovery, data: Sequence[str] = ()) -> None:
    """Write verdict.json, model.yaml, params.yaml, simulator.yaml and report.html.

    Raises
    ------
    PiezoError
        If the folder cannot be written, or holds the results of another verb.
    """
    saved = model_file(found, data)
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
