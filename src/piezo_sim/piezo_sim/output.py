"""Output of a sweep: a bag, a NumPy archive or a CSV file, and the true parameters."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from piezo_hysteresis.common.files import write_atomically
from piezo_hysteresis.common.wording import reason_of
from piezo_hysteresis.records import Record, write_bag, write_csv
from piezo_sim.plant import Plant
from piezo_sim.simulation_errors import SweepError


def check_target(path: Path, count: int) -> None:
    """Reject a target that cannot store `count` records, before the simulation."""
    if path.exists():
        raise SweepError(f'{path} exists already; remove it or choose another name')
    if path.suffix == '.csv' and count != 1:
        raise SweepError(
            f'a CSV file holds one record, the sweep has {count}; write a bag (a name without '
            'suffix) or an archive (.npz)'
        )


def write_records(path: Path, records: Sequence[Record]) -> None:
    """Write records as a bag, or in the format of the suffix (``.npz``, ``.csv``)."""
    if path.suffix == '.csv':
        write_csv(path, records[0])
    elif path.suffix == '.npz':
        columns: dict[str, Any] = {}
        for record in records:
            columns[f'{record.name}/time_s'] = record.time
            columns[f'{record.name}/voltage_V'] = record.voltage
            columns[f'{record.name}/displacement_m'] = record.displacement
        _replace(path, lambda temporary: _save(temporary, columns))
    else:
        write_bag(path, records)


def labels(
    plant: Plant, preset: str, overrides: Mapping[str, float | bool], seed: int
) -> dict[str, Any]:
    """Return the true simulation settings, which a bag does not contain."""
    usual = Plant.from_preset(preset).effects
    on = [name for name, active in plant.effects.items() if active]
    return {
        'preset': preset,
        'seed': seed,
        'rate_hz': plant.rate,
        'overrides': dict(overrides),
        'effects': on,
        'effects_beyond_the_preset': [name for name in on if not usual[name]],
        'exotic_effects': [
            row.name for row in plant.effect_table if row.exotic and row.name in on
        ],
        'parameters': plant.parameters,
    }


def write_labels(path: Path, content: Mapping[str, Any]) -> None:
    """Write `labels` as JSON or YAML, according to the suffix."""
    if path.suffix == '.json':
        text = json.dumps(content, indent=2) + '\n'
    elif path.suffix in ('.yaml', '.yml'):
        text = yaml.safe_dump(dict(content), sort_keys=False)
    else:
        raise SweepError(f'{path}: the labels are written as .json or .yaml')
    _replace(path, lambda temporary: temporary.write_text(text, encoding='utf-8'))


def _save(path: Path, columns: Mapping[str, Any]) -> None:
    with path.open('wb') as file:
        np.savez_compressed(file, allow_pickle=False, **columns)


def _replace(path: Path, write: Any) -> None:
    """Write a temporary file and rename it to `path`, so that it is complete or unchanged."""
    try:
        with write_atomically(path) as temporary:
            write(temporary)
    except OSError as error:
        raise SweepError(f'{path} cannot be written: {reason_of(error)}') from None
