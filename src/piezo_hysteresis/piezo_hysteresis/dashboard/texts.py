"""Texts of the page: HTML fragments, with all external text escaped."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from html import escape
from urllib.parse import quote

from bokeh.models import Div

from piezo_hysteresis.dashboard.live_state import BackgroundJob, Counters, Gap, Live, ShownEstimate
from piezo_hysteresis.dashboard.overall_status import ago, corrected, of_node
from piezo_hysteresis.dashboard.template import WIDGET_STYLE
from piezo_hysteresis.reporting.display_units import (
    clock,
    micrometres,
    shown,
    time_left,
    with_deviation,
)

# Counters of nodes, for the page and its documentation.
COUNTED = {
    'late': 'input or ticks that came after their time',
    'missed': 'ticks that never came',
    'refused': 'values that are no number, beyond the range or far ahead',
    'limited': 'ticks at which a limit changed the voltage',
    'doubled': 'messages that came twice, as when a sender repeats its last one; harmless',
    'reordered': 'messages that came behind later ones',
    'strays': 'messages numbered far from the rest',
    'stale': 'times that the input stayed away and the voltage was ramped to safety',
    'stamp_jumps': 'time stamps off the clock of the samples; only their numbers count',
    'out_of_range': 'ticks at which the voltage was cut at limits.low or limits.high',
    'slew_limited': 'ticks at which the voltage was slowed down to the slew limit',
    'energy_limited': 'ticks at which the voltage was slowed down to keep energy_limit',
    'out_of_stroke': 'ticks at which the reference lay beyond the stroke of the model',
    'clamped_slopes': 'ticks at which the slope of the inverse was clamped',
    'dropped': 'ticks left out because their reference never came',
    'windows': 'windows of whole periods that attenuation has evaluated',
    'restarts': 'times that a law, or the counting of ticks, began again',
    'bounded': 'corrections that were held at their bound',
    'frozen': 'readings of the sensor that repeat the one before',
    'law_reset': 'times that a law returned NaN and was reset',
    'overruns': 'ticks of the simulator that began late',
}


# Time for which log messages are shown [s].
LOG_SHOWN = 60.0
# Share of a job after which its rate is estimated.
ENOUGH = 0.05


def tracking_text(rms: float, size: float) -> str:
    """Return the tracking error as text; [m], not finite without a reference."""
    if not math.isfinite(rms):
        return '<p class="soft">No reference.</p>'
    share = f', {100 * rms / size:.3g} % of the reference' if size > 0.0 else ''
    return f'<p>Tracking error <b>{micrometres(rms)} µm</b> rms{share}.</p>'


def start_text(what: str, node: str, actuator: str, *settings: str) -> str:
    """Return the missing node, and the command that starts it for this actuator."""
    options = [node, *(f'-p {each}' for each in settings)]
    if actuator:
        options.append(f'-r __ns:=/{actuator}')
    line = escape(' '.join(options))
    return (
        f'<p class="soft">{what} In another terminal: '
        f'<code>python -m piezo_hysteresis node {line}</code></p>'
    )


def gap_text(
    gaps: Sequence[Gap],
    monitored: bool,
    actuator: str = '',
    stroke: float = math.nan,
    untracked: float = math.nan,
) -> str:
    """Return the meaning of the newest gap, with range of motion and tracking error [m]."""
    if not gaps:
        if monitored:
            return (
                '<p class="soft">The gap monitor has no model yet: load one with its service '
                '<code>load_model</code>, or wait for the first whole window.</p>'
            )
        return start_text(
            'No gap monitor is running.', 'gap_monitor', actuator, 'model_file:=MODEL.yaml'
        )
    gap = gaps[-1]
    share = f'{100 * gap.rms / stroke:.2g} % of the motion, ' if stroke > 0.0 else ''
    text = f'Gap <b>{micrometres(gap.rms)} µm rms</b> ({share}{gap.floors:.3g} noise floors)'
    if not gap.beyond:
        return f'<p>{text}, within the known discrepancy of the model.</p>'
    text += f'; possible causes: <b>{escape(gap.family or "no known effect")}</b>'
    sizes = [(s, o) for o, s in zip(gap.orders, gap.harmonics, strict=False) if math.isfinite(s)]
    if sizes:
        size, order = max(sizes)
        where = f'at {order}× the drive' if order else 'in the mean'
        text += f'; largest component {where} ({micrometres(size)} µm)'
    if corrected(gap, untracked):
        text += '. The correction compensates it: tracking is not affected'
    return f'<p>{text}.</p>'


def estimate_text(
    estimates: Sequence[ShownEstimate], identifying: bool, actuator: str = ''
) -> str:
    """Return the newest estimate as a table with standard deviations."""
    if not estimates:
        if not identifying:
            return start_text('No identification is running.', 'identification', actuator)
        return (
            '<p class="soft">No estimate yet; between the records of a sweep '
            'only with <code>only_records</code> false.</p>'
        )
    newest = estimates[-1]
    rows = []
    for name, unit, value, std in zip(
        newest.names, newest.units, newest.values, newest.deviations, strict=False
    ):
        unit_text, factor = shown(unit)
        # a held parameter has no deviation
        known = None if std == 0.0 else math.inf if math.isnan(std) else abs(factor) * std
        number, deviation = with_deviation(factor * value, known)
        sign = '± ' if deviation[0].isdigit() else ''
        rows.append((name, number, f'{sign}{deviation}', unit_text))
    state = 'settled' if newest.converged else 'settling'
    head = (
        f'<p>{escape(newest.model or "no model")} by {escape(newest.method)}, {state}; one-step '
        f'error {micrometres(newest.one_step)} µm, free run {micrometres(newest.free_run)} µm. '
        f'{escape(newest.message)}</p>'
    )
    return head + _table(('parameter', 'value', 'std', 'unit'), rows)


def status_text(live: Live) -> str:
    """Return the nodes with their status and counters, and the last log messages."""
    now = live.clock()
    rows = []
    for node in sorted(live.nodes.values(), key=lambda n: n.name):
        known = of_node(live, node)
        name = f'<span class="tick {known.level}"></span>{escape(node.name)}'
        rows.append((name, escape(known.text), _counted(live.counters.get(node.name))))
    parts = [_raw_table(('node', 'health', 'counters'), rows)] if rows else []
    parts += [
        f'<p class="{line.level}">{escape(line.node)}: {escape(line.text)} '
        f'<span class="soft">{ago(now - line.at)} ago</span></p>'
        for line in list(live.words)[-4:]
        if now - line.at < LOG_SHOWN
    ]
    return ''.join(parts) or '<p class="soft">No nodes yet.</p>'


def _counted(counters: Counters | None) -> str:
    if counters is None:
        return ''
    counted = [_counter(name, count) for name, count in counters.counts.items() if count]
    if counters.rate > 0.0:
        counted.insert(0, f'{counters.rate:.0f} ticks/s')
    return ', '.join(counted)


def _counter(name: str, count: int) -> str:
    """Return a counter, with its description as a tooltip."""
    text = f'{escape(name)} {count}'
    meaning = COUNTED.get(name)
    return text if meaning is None else f'<abbr title="{escape(meaning)}">{text}</abbr>'


def time_text(job: BackgroundJob, now: float) -> str:
    """Return the elapsed time of a job, and the remaining time at its current rate."""
    if not job.busy or not math.isfinite(job.since):
        return ''
    spent = max(now - job.since, 0.0)
    text = f'since {clock(spent)}'
    if job.fraction >= ENOUGH and spent >= 1.0:
        text += time_left(job.fraction, spent)
    return text


def job_text(job: BackgroundJob) -> str:
    """Return the state of a job, its result or its error."""
    if job.phase == 'none':
        return ''
    kind = {'failed': 'error', 'done': 'good'}.get(job.phase, 'soft')
    parts = [f'<p class="{kind}">{escape(job.text)}</p>']
    if job.effects:
        parts.append(
            _table(
                ('effect', 'probability'),
                [(name, f'{100 * probability:.3g} %') for name, probability in job.effects],
            )
        )
    if job.records:
        parts.append(f'<p>{", ".join(map(escape, job.records))}</p>')
    if math.isfinite(job.before):
        parts.append(
            f'<p>Held-out gap <b>{job.before:.3g}</b> noise floors before, '
            f'<b>{job.after:.3g}</b> after.</p>'
        )
    if job.report:
        parts.append(
            f'<p><a href="reports/{quote(job.report)}" target="_blank" rel="noopener">'
            'Open the report</a></p>'
        )
    return ''.join(parts)


def _table(headers: Iterable[str], rows: Iterable[Sequence[str]]) -> str:
    return _raw_table(headers, [[escape(cell) for cell in row] for row in rows])


def _raw_table(headers: Iterable[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table of cells that contain HTML."""
    head = ''.join(f'<th>{escape(header)}</th>' for header in headers)
    body = ''.join('<tr>' + ''.join(f'<td>{cell}</td>' for cell in row) + '</tr>' for row in rows)
    return (
        f'<div class="wide"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>'
        '</div>'
    )


def text_div(name: str) -> Div:
    """Return an empty text element."""
    return Div(text='', name=name, stylesheets=[WIDGET_STYLE], sizing_mode='stretch_width')


def set_text(place: Div, text: str) -> None:
    """Change the text only if it differs."""
    if place.text != text:
        place.text = text
