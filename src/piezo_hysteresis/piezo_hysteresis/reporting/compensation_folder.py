"""Output folder of a compensation study: report, errors and a figure, complete or unchanged."""

from __future__ import annotations

import io
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from piezo_hysteresis.compensation.study import PRESET, Run, Study
from piezo_hysteresis.models.modelfile import ModelFile
from piezo_hysteresis.reporting.compensation_report import colour_of, compensation_page
from piezo_hysteresis.reporting.folder import write_folder


def write_compensation(
    out: str | Path, study: Study, runs: Sequence[Run], reference: str, seconds: float
) -> None:
    """Write ``summary.json``, ``report.html`` and ``tracking.png``.

    Parameters
    ----------
    out : str or Path
        Folder; created if missing.
    study : Study
        All settings.
    runs : sequence of Run
        Runs, the first one without compensation.
    reference : str
        Description of the reference.
    seconds : float
        Computing time [s].

    Raises
    ------
    PiezoError
        If the folder cannot be written, or holds the results of another verb.
    """
    controllers = study.controllers
    summary: dict[str, Any] = {
        'model': study.model.model.name,
        'plant': (
            study.plant.model.name
            if isinstance(study.plant, ModelFile)
            else study.controller or f'{PRESET}{study.plant}'
        ),
        'law': controllers.law,
        'gain_model': (controllers.gain_model or study.model).model.name,
        'notes': list(dict.fromkeys(remark for each in runs for remark in each.words)),
        'reference': reference,
        'rate_hz': 1.0 / controllers.dt,
        'from_seconds': study.from_seconds,
        'noise_rms_m': study.noise,
        'seed': study.seed,
        'runs': [_row(each) for each in runs],
        'seconds': seconds,
    }
    page = compensation_page(
        runs, summary['model'], summary['plant'], reference, study.from_seconds
    )
    files: dict[str, bytes | str] = {
        'summary.json': json.dumps(summary, indent=2) + '\n',
        'report.html': page,
        'tracking.png': _figure(runs),
    }
    write_folder(out, files, 'compensate')


def _row(run: Run) -> dict[str, Any]:
    m = run.metrics
    return {
        'run': run.name,
        'rms_m': m.rms,
        'rms_without_mean_m': m.rms_without_mean,
        'largest_m': m.largest,
        'mean_m': m.mean,
        'harmonics_m': {str(order): amplitude for order, amplitude in m.harmonics.items()},
        'counters': run.result.counters,
    }


def _figure(runs: Sequence[Run]) -> bytes:
    figure = Figure(figsize=(9, 7), layout='constrained')
    whole, last = figure.subplots(2, 1)
    for each in runs:
        result = each.result
        part = slice(-min(result.time.size, max(200, result.time.size // 50)), None)
        label = f'{each.name}: rms {each.metrics.rms * 1e6:.3g} µm'
        colour = colour_of(each)
        whole.plot(result.time, result.error * 1e6, lw=0.7, label=label, color=colour)
        if each is not runs[0]:  # at its scale the other errors are indistinguishable
            error = result.error[part] * 1e6
            last.plot(result.time[part], error, lw=1.2, color=colour)
    whole.set(title='Tracking error', ylabel='error [µm]')
    whole.legend(loc='upper right')
    last.set(xlabel='time [s]', ylabel='error [µm]', title='The end of the compensated runs')
    for axis in (whole, last):
        axis.grid(alpha=0.3)
    picture = io.BytesIO()
    figure.savefig(picture, format='png', dpi=110)
    return picture.getvalue()
