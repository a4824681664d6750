"""What the demo leaves in its folder, and how a finished folder takes the place of an old one."""

from __future__ import annotations

import json
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import yaml

from piezo_hysteresis.cli.demo_live import Demo
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.models import ModelFile


@contextmanager
def replacing(folder: Path) -> Iterator[Path]:
    """Offer an empty folder whose content goes into `folder` only when everything went well.

    Files of the same names are replaced, others stay.

    Raises
    ------
    PiezoError
        If `folder` cannot be written.
    """
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        if folder.exists() and not folder.is_dir():
            raise NotADirectoryError(0, 'it is a file')
        staging = Path(tempfile.mkdtemp(dir=folder.parent, prefix=f'.{folder.name}.'))
    except OSError as error:
        raise _unwritable(folder, error) from error
    try:
        made = staging / 'new'
        made.mkdir()
        yield made
        _move(made, folder, staging / 'old')
    except OSError as error:
        raise _unwritable(folder, error) from error
    finally:
        shutil.rmtree(staging, ignore_errors=True)


def _move(made: Path, folder: Path, old: Path) -> None:
    folder.mkdir(exist_ok=True)
    old.mkdir()
    for path in sorted(made.iterdir()):
        target = folder / path.name
        if target.exists():
            target.replace(old / path.name)
        path.replace(target)


def _unwritable(folder: Path, error: OSError) -> PiezoError:
    reason = error.strerror or str(error)
    return PiezoError(f'{folder} cannot be written ({reason}); name another folder with --out')


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
    """Return the summary of an identification with the tracking runs beside it."""
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
