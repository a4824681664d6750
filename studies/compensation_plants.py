"""Goals of the compensation on the actuators of Zhou 2021, Xiao 2014 and Fang 2019."""

from __future__ import annotations

from studies.goals import Goals
from studies.papers import flap, stack, stage

KINDS = (
    'PID', 'inverse', 'inverse + PID', 'inverse + fuzzy PID', 'switched inverse',
    'switched inverse + fuzzy PID',
)  # fmt: skip


def measure_stack(goals: Goals, rows: int) -> None:
    """Beat Xiao 2014's table 1 in every row."""
    goals.heading(
        'Stack of Xiao 2014, triangles of 30 µm peak to peak, rms (largest), mean included [µm]'
    )
    selector = stack.selector_values()
    for frequency, none, _, paper, paper_largest in stack.TABLE_1[:rows]:
        row = stack.errors(frequency, selector)
        goals.note(
            f'{frequency:4.0f} Hz  paper {none:.2f} -> {paper:.2f}: '
            + ', '.join(f'{k} {a * 1e6:.2f} ({b * 1e6:.2f})' for k, (a, b) in row.items())
        )
        for kind in ('selector', 'inverse', 'inverse + H-infinity'):
            goals.check(f'{kind}, rms at {frequency:.0f} Hz', row[kind][0] * 1e6, paper, 'um')
        for kind in ('selector', 'inverse'):
            goals.check(f'{kind}, largest at {frequency:.0f} Hz', row[kind][1] * 1e6,
                        paper_largest, 'um')  # fmt: skip


def measure_flap(goals: Goals, rows: int) -> None:
    """Stay below Zhou 2021's 14 and 9 µm at every frequency with 10 % of mismatch."""
    goals.heading('Actuator of Zhou 2021, +-200 µm, largest error [µm]; paper at 10 Hz: 65, 14, 9')
    cases = dict(list(flap.mismatches().items())[: 1 + rows])
    for frequency in (10.0, 20.0, 30.0, 40.0, 50.0, 60.0)[:rows]:
        none = flap.largest_error('none', frequency, cases['as identified']) * 1e6
        alone = {k: flap.largest_error('inverse', frequency, v) * 1e6 for k, v in cases.items()}
        both = {k: flap.largest_error('compound', frequency, v) * 1e6 for k, v in cases.items()}
        goals.note(
            f'{frequency:.0f} Hz, none {none:.0f}: '
            + ', '.join(f'{k} {alone[k]:.1f} / {both[k]:.1f}' for k in cases)
        )
        # No open-loop law can make up for a wrong gain: 10 % of 200 µm are 20 µm.
        shape = max(error for words, error in alone.items() if not words.startswith('A1'))
        goals.check(f'inverse, worst but for the gain, {frequency:.0f} Hz', shape, 14.0, 'um')
        goals.check(f'compound, worst mismatch at {frequency:.0f} Hz', max(both.values()), 9.0,
                    'um')  # fmt: skip


def measure_stage(goals: Goals, rows: int) -> None:
    """Stay below every error that Fang 2019 prints."""
    goals.heading('Stage of Fang 2019, largest error [µm]')
    fast, slow = stage.by_least_squares(), stage.slow_by_least_squares()
    for name, spec, paper_pid, paper in stage.FIGURES[:rows]:
        row = {kind: stage.largest_error(stage.run(spec, kind, fast, slow)) for kind in KINDS}
        goals.note(
            f'{name}, paper PID {paper_pid}, compound {paper}: '
            + ', '.join(f'{k} {v:.3f}' for k, v in row.items())
        )
        goals.check(f'inverse + fuzzy PID, {name}', row['inverse + fuzzy PID'], paper, 'um')


def measure_plants(goals: Goals, rows: int) -> None:
    """Measure all three, the first rows of each table."""
    measure_stack(goals, rows)
    measure_flap(goals, rows)
    measure_stage(goals, rows)
