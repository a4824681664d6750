"""Report of the demo: tracking before and after compensation, then the identified model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.common.wording import short
from piezo_hysteresis.compensation.offline_loop import TrackingMetrics
from piezo_hysteresis.discovery.choose import TriedModel
from piezo_hysteresis.identification.identify import Identification
from piezo_hysteresis.records import Record
from piezo_hysteresis.reporting.display_units import micrometres
from piezo_hysteresis.reporting.folder import write_folder
from piezo_hysteresis.reporting.identification_report import (
    fit_section,
    identification_page,
    parameter_section,
    where_section,
)
from piezo_hysteresis.reporting.page import PageSection, Plot, table, write_report
from piezo_hysteresis.reporting.plots import (
    Curve,
    band_figure,
    loop_figure,
    spectrum_figure,
    trace_figure,
)

_DRAWN_PERIODS = 3
_RUNS = ('uncompensated', 'feedforward', 'attenuated')  # roles of the runs, in their order


@dataclass(frozen=True)
class Plan:
    """Settings of the demo."""

    frequencies: Sequence[float] = (1, 5, 10, 14, 18, 22, 23, 24, 35, 50)  # [Hz]
    amplitudes: Sequence[float] = (0.5, 1.0)  # amplitudes of the sweep [V]
    seconds: float = 2.0  # duration of each record of the sweep [s]
    warm_up: float = 1.0  # its first part that is not evaluated [s]
    tracked: float = 23.0  # frequency of the reference [Hz]
    tracking_seconds: float = 3.0  # duration of each tracking run [s]
    learning_seconds: float = 6.0  # additional time in which attenuation learns the harmonics [s]
    judged_seconds: float = 1.0  # evaluated part at the end of each run [s]


@dataclass(frozen=True)
class LiveRun:
    """One tracking run."""

    name: str  # active controllers
    record: Record  # record with its reference
    metrics: TrackingMetrics  # errors of the evaluated part


def write_demo_report(
    path: Path,
    sweep: Sequence[Record],
    found: Identification,
    runs: Sequence[LiveRun],
    plan: Plan,
    results: Path,
) -> None:
    """Write the report of the demo."""
    simulated = found.runs.simulated
    sections = [
        _before_after(runs, plan),
        _where(runs, plan, found.values.get('natural_frequency')),
        fit_section(sweep, found, simulated),
        where_section(sweep, found, simulated),
        parameter_section(found),
        _next_after_demo(results),
    ]
    title = f'Tracking {plan.tracked:g} Hz with a piezo actuator'
    write_report(path, title, _verdict(runs, plan), sections)


def write_data_report(
    path: Path,
    records: Sequence[Record],
    found: Identification,
    steps: Sequence[TriedModel],
    data: Sequence[str],
    results: Path,
) -> None:
    """Write the report of an identification with automatic model selection.

    Its commands name the folder `results`; `path` may be moved into it later.
    """
    page = identification_page(records, found, steps=steps, data=data, folder=str(results))
    write_folder(path.parent, {path.name: page})


def _verdict(runs: Sequence[LiveRun], plan: Plan) -> str:
    first, *others = runs
    parts = []
    for run in others:
        ratio = first.metrics.rms / run.metrics.rms
        change = f'{short(ratio)} times lower' if ratio > 1 else f'{short(1 / ratio)} times higher'
        parts.append(f'{micrometres(run.metrics.rms)} µm with {run.name} ({change})')
    return (
        f'The rms tracking error at {plan.tracked:g} Hz is {micrometres(first.metrics.rms)} µm '
        f'with {first.name}, {" and ".join(parts)}.'
    )


def _errors(runs: Sequence[LiveRun]) -> list[tuple[LiveRun, FloatArray]]:
    pairs = []
    for run in runs:
        assert run.record.reference is not None
        pairs.append((run, run.record.displacement - run.record.reference))
    return pairs


def _before_after(runs: Sequence[LiveRun], plan: Plan) -> PageSection:
    traces: list[Curve] = []
    loops: list[Curve] = []
    for run, role in zip(runs, _RUNS, strict=False):
        record = run.record
        assert record.reference is not None
        tail = slice(-round(_DRAWN_PERIODS / plan.tracked / record.dt), None)
        time, reference = record.time[tail] - record.time[tail][0], record.reference[tail]
        if not traces:
            traces.append(Curve('reference', time, reference))
            loops.append(Curve('reference', reference, reference))
        traces.append(Curve(run.name, time, record.displacement[tail], role))
        loops.append(Curve(run.name, reference, record.displacement[tail], role))
    orders = list(runs[0].metrics.harmonics)
    rows = [
        (
            run.name,
            micrometres(run.metrics.rms),
            micrometres(run.metrics.rms_without_mean),
            *(micrometres(run.metrics.harmonics[order]) for order in orders),
        )
        for run in runs
    ]
    headers = ('run', 'RMSE [µm]', 'without mean [µm]', *(f'{n}× [µm]' for n in orders))
    caption = (
        f'Tracking error over the last {plan.judged_seconds:g} s: rms, and amplitudes of the '
        'fundamental and its harmonics.'
    )
    text = (
        'Four ROS 2 processes in lock-step: excitation, feedforward, attenuation and the '
        'simulated actuator. The reference is a sine; without compensation the voltage is the '
        'reference divided by the gain of the actuator.'
    )
    figures = (
        trace_figure(traces, 'Displacement', f'The last {_DRAWN_PERIODS} periods of each run.'),
        loop_figure(
            loops, 'Displacement over reference',
            'Perfect tracking is a straight line.', 'm',
        ),
    )  # fmt: skip
    return PageSection(
        'Tracking error before and after', text, figures, (table(headers, rows, caption),)
    )


def _where(runs: Sequence[LiveRun], plan: Plan, resonance: float | None) -> PageSection:
    errors = _errors(runs)
    dt = runs[0].record.dt
    judged = round(plan.judged_seconds / dt)
    signals = [(run.name, error[-judged:]) for run, error in errors]
    last = round(_DRAWN_PERIODS / plan.tracked / dt)
    compensated = list(zip(errors[1:], _RUNS[1:], strict=False))
    marks = {} if resonance is None else {'resonance': resonance}
    figures: list[Plot] = [
        spectrum_figure(
            signals, dt, 'Spectrum of the tracking error',
            f'Amplitudes over the last {plan.judged_seconds:g} s, multiples of the reference '
            'marked.', roles=_RUNS, fundamental=plan.tracked, orders=(1, 2, 3, 5), marks=marks,
            highest=8 * plan.tracked,
        ),
        band_figure(
            [
                Curve(run.name, run.record.time, error, role)
                for (run, error), role in compensated
            ],
            'Tracking error of the compensated runs',
            'The reference grows over the first second. Attenuation then learns the harmonics.',
            'tracking error',
            plan.tracked,
        ),
        trace_figure(
            [
                Curve(run.name, run.record.time[:last], error[-last:], role)
                for (run, error), role in compensated
            ],
            f'Tracking error, last {_DRAWN_PERIODS} periods',
            'The compensated runs in steady state.',
            'tracking error',
            ground=False,
        ),
    ]  # fmt: skip
    text = 'Error by multiple of the reference frequency.'
    if resonance is not None:
        nearest = max(1, round(resonance / plan.tracked))
        text += (
            f' The {_ordinal(nearest)} harmonic of {plan.tracked:g} Hz lies at '
            f'{nearest * plan.tracked:g} Hz, near the resonance at {resonance:.2f} Hz, which '
            'amplifies this harmonic of the hysteresis (odd-harmonic oscillation).'
        )
    return PageSection('Error by harmonic', text, tuple(figures))


def _ordinal(n: int) -> str:
    return {1: 'first', 2: 'second', 3: 'third', 5: 'fifth'}.get(n, f'{n}th')


def _next_after_demo(folder: Path) -> PageSection:
    text = (
        f'- `python -m piezo_hysteresis discover {folder}/bags/sweep --baseline bouc_wen_mode '
        f'--out {folder.parent / "discover"}` reports what the model lacks.\n'
        '- `make demo DATA=my_record.csv` identifies an actuator of your own.\n'
        '- `params.yaml` in this folder is loaded into the running feedforward node by '
        f'`python -m piezo_hysteresis param load /feedforward {folder}/params.yaml`.\n'
        f'- `python -m piezo_hysteresis loop --model {folder}/model.yaml` runs the loop with its '
        'live page.'
    )
    return PageSection('Next steps', text)
