"""Result files of the demo."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import yaml

from piezo_hysteresis.cli.demo_live import Demo
from piezo_hysteresis.models import ModelFile


def write_model(saved: ModelFile, folder: Path) -> None:
    """Write ``model.yaml`` and ``params.yaml`` (for ``ros2 param load``)."""
    saved.save(folder / 'model.yaml')
    ros = {'/**': {'ros__parameters': saved.to_ros_parameters()}}
    (folder / 'params.yaml').write_text(yaml.safe_dump(ros, sort_keys=False), encoding='utf-8')


def write_summary(content: dict[str, Any], folder: Path) -> None:
    """Write ``summary.json``."""
    text = json.dumps(content, indent=2, allow_nan=False) + '\n'
    (folder / 'summary.json').write_text(text, encoding='utf-8')


def demo_summary(demo: Demo, seconds: float) -> dict[str, Any]:
    """Return the summary of an identification and of the tracking runs."""
    return {
        **demo.found.summary(),
        'tracking': {
            'frequency_hz': demo.plan.tracked,
            'judged_seconds': demo.plan.judged_seconds,
            'runs': [
                {
                    'name': run.name,
                    'rmse_m': run.metrics.rms,
                    'rmse_without_mean_m': run.metrics.rms_without_mean,
                    'mean_m': run.metrics.mean,
                    'largest_m': run.metrics.largest,
                    'harmonics_m': {str(n): a for n, a in run.metrics.harmonics.items()},
                }
                for run in demo.runs
            ],
        },
        'parts_seconds': {name: round(lap, 3) for name, lap in demo.seconds.items()},
        'seconds': round(seconds, 3),
    }
