"""Texts and frame of the page: HTML and CSS for the bench screen and the phone."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from urllib.parse import quote

from bokeh.models import Div
from jinja2 import Environment, Template

from piezo_hysteresis.dashboard.live_state import (
    SILENCE,
    BackgroundJob,
    Counters,
    Gap,
    Live,
    NodeState,
    ShownEstimate,
)
from piezo_hysteresis.reporting.display_units import (
    clock,
    micrometres,
    shown,
    time_left,
    with_deviation,
)
from piezo_hysteresis.reporting.page import EXPORT_SCRIPT, EXPORT_STYLE, STYLE

# Widgets of Bokeh are in shadow trees, which styles of the page do not affect.
WIDGET_STYLE = """
:host { font: 14px/1.45 system-ui, -apple-system, "Segoe UI", Roboto, "DejaVu Sans", sans-serif;
  color: #1b1f24; overflow-wrap: anywhere; }
.soft, .unit { color: #57606a; } .soft { font-size: 13px; }
p { margin: .3rem 0; }
.error, :host(.refusal) { color: #a40e26; }
.warning { color: #8a4600; }
.good { color: #00593f; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: 13px; }
th, td { text-align: left; padding: .15rem .9rem .15rem 0; vertical-align: top;
  border-bottom: 1px solid #d0d7de; overflow-wrap: normal; }
td:first-child { white-space: nowrap; }
code { background: #f3f4f6; padding: .05em .3em; border-radius: 3px; }
a { color: #0072b2; font-weight: 600; }
.banner { background: #fff4e5; border-left: 5px solid #d55e00; padding: .6rem .9rem;
  font-size: 15px; }
.dot { display: inline-block; width: .7em; height: .7em; border-radius: 50%; margin-right: .45em; }
.dot.ok { background: #009e73; } .dot.warning { background: #e69f00; }
.dot.error, .dot.gone { background: #d5001c; }
.banner.calm { background: #f2f8fc; border-left-color: #0072b2; }
abbr { text-decoration: underline dotted #8c959f; text-underline-offset: 2px; cursor: help; }
:host(.brief) { display: grid; gap: 0 .8rem;
  grid-template-columns: repeat(auto-fill, minmax(155px, 1fr)); }
:host(.brief) > .refusal { grid-column: 1 / -1; }
.tick { display: inline-block; width: .6em; height: .6em; border-radius: 50%; margin-right: .4em;
  background: #009e73; }
.tick.warning { background: #e69f00; } .tick.error, .tick.gone { background: #d5001c; }
"""

# The switch before its name.
SWITCH_STYLE = """
:host { flex-direction: row-reverse; justify-content: flex-end; font-size: 13px; }
"""

_PAGE = """{% from macros import embed %}<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="__POLICY__">
<link rel="icon" href="data:,">
<title>{{ title | e }}</title>
<style>__STYLE__</style>
{{ bokeh_css if bokeh_css }}
{{ bokeh_js if bokeh_js }}
</head>
<body>
<main>
<header><h1>{{ title | e }}</h1>{{ embed(roots.actuator) }}{{ embed(roots.pulse) }}</header>
{{ embed(roots.banner) }}
<div class="page">
<section class="pictures" aria-label="Signals">
<div class="view">{{ embed(roots.view) }}</div>
<div class="plots">
<figure class="first">{{ embed(roots.loop) }}</figure>
<figure class="first">{{ embed(roots.trace) }}</figure>
<figure>{{ embed(roots.spectrum) }}</figure>
<figure class="first">{{ embed(roots.error) }}{{ embed(roots.tracking) }}</figure>
</div>
<details open class="more"><summary>Gap, voltage, estimate</summary>
<div class="plots">
<figure>{{ embed(roots.gap) }}{{ embed(roots.gap_text) }}</figure>
<figure>{{ embed(roots.voltage) }}</figure>
<figure>{{ embed(roots.estimate) }}{{ embed(roots.estimate_choice) }}</figure>
<figure>{{ embed(roots.estimates) }}</figure>
</div>
</details>
<details open><summary>Effects of the simulator</summary>{{ embed(roots.effects) }}</details>
<details open><summary>Nodes</summary>{{ embed(roots.status) }}</details>
</section>
<aside class="controls" aria-label="Controls">
<details open class="first"><summary>Drive</summary>{{ embed(roots.drive) }}</details>
<details open><summary>Sweep</summary>{{ embed(roots.sweep) }}</details>
<details open><summary>Discovery</summary>{{ embed(roots.discovery) }}</details>
<details open><summary>Investigation</summary>{{ embed(roots.investigation) }}</details>
<details><summary>All parameters</summary>{{ embed(roots.all) }}</details>
</aside>
</div>
<noscript>This page needs JavaScript; all of it comes from this machine.</noscript>
</main>
{{ plot_script }}
<script>// on a phone, what is secondary is folded
if (matchMedia('(max-width: 900px)').matches) {
  document.querySelectorAll('details:not(.first)').forEach((part) => { part.open = false; });
}
__EXPORT__
const waiting = setInterval(() => {
  addExports();
  if (document.querySelectorAll('.export').length >= __FIGURES__) clearInterval(waiting);
}, 500);
</script>
</body>
</html>
"""

_STYLE = (
    STYLE
    + EXPORT_STYLE
    + """
main { max-width: 1720px; padding-top: .4rem; }
header { display: flex; flex-wrap: wrap; align-items: center; gap: .2rem 1.2rem;
  margin-bottom: .4rem; }
h1 { margin: 0; font-size: 1.3rem; }
.page { display: grid; gap: 1.4rem; grid-template-columns: minmax(0, 1fr) minmax(330px, 400px); }
.pictures .plots { gap: .6rem 1.2rem; margin: .2rem 0; align-items: start;
  grid-template-columns: repeat(auto-fit, minmax(min(100%, 400px), 1fr)); }
.controls { min-width: 0; }
details { border: 1px solid var(--line); border-radius: 6px; margin-bottom: .7rem;
  padding: 0 .7rem .3rem; }
summary { cursor: pointer; font-weight: 600; padding: .45rem 0; }
figure { margin-bottom: .4rem; }
@media (max-width: 900px) {
  .page { display: flex; flex-direction: column; gap: .6rem; }
  .pictures, .plots, .controls { display: contents; }
  .page figure, .page details { order: 3; margin: 0; }
  .page .view { order: 1; }
  .page figure.first { order: 1; }
  .page details.first { order: 2; }
}
"""
)

# No external content; Bokeh compiles the callbacks of the page to functions.
_POLICY = (
    "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; "
    "style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; font-src data:; "
    "connect-src 'self' ws:"
)

_FIGURES = ('loop', 'trace', 'spectrum', 'error', 'gap', 'voltage', 'estimate')

PAGE = (
    _PAGE.replace('__STYLE__', _STYLE)
    .replace('__POLICY__', _POLICY)
    .replace('__EXPORT__', EXPORT_SCRIPT)
    .replace('__FIGURES__', str(len(_FIGURES)))
)


def page_template() -> Template:
    """Return the template of the document."""
    return Environment(autoescape=False).from_string(PAGE)


LOST_SHOWN = 600.0  # time for which a node that has ended is shown [s]
UNTRACKED = 0.2  # relative tracking error above which the reference is not followed
CORRECTED = 0.1  # tracking error relative to the gap below which the gap is compensated
#: Nodes that only monitor the loop: their status does not change its light.
WATCHERS = {
    'gap_monitor', 'identification', 'recorder', 'dashboard_listener', 'player',
}  # fmt: skip
MUTE = 5.0  # time without a status after which a node is not ok [s]

# Status of a link on its input, which is no fault while there is no input.
_NO_INPUT = 'no input since'
_NO_COMMAND = 'no command'


@dataclass(frozen=True)
class OverallStatus:
    """A status."""

    level: str  # ``ok``, ``warning``, ``error`` or ``gone``
    text: str  # as a sentence


def ago(seconds: float) -> str:
    """Return an elapsed time as text."""
    return f'{seconds:.0f} s' if seconds < 120 else f'{seconds / 60:.0f} min'


def at_rest(live: Live) -> bool:
    """Return whether no motion is requested: links without input are then correct."""
    mode = live.parameter('excitation', 'mode')
    health = live.diagnostics.get('excitation')
    failed = health is not None and health.level == 'error'
    return mode is not None and mode.value == 'idle' and not failed


def of_node(live: Live, node: NodeState) -> OverallStatus:
    """Return the status of one node, from its diagnostics and from those of others."""
    now = live.clock()
    if not node.present:
        return OverallStatus('gone', f'ended {ago(now - node.since)} ago')
    health = live.diagnostics.get(node.name)
    if health is None:
        return OverallStatus('ok', 'running')
    if at_rest(live) and health.text.startswith((_NO_INPUT, _NO_COMMAND)):
        return OverallStatus('ok', 'rests: no experiment runs')
    if now - health.at > MUTE:
        return OverallStatus('warning', f'{health.text} (reported {ago(now - health.at)} ago)')
    return OverallStatus(health.level, health.text)


def corrected(gap: Gap, error: float) -> bool:
    """Return whether the loop tracks far better [m] than its model predicts."""
    return error < CORRECTED * gap.rms


def overall(live: Live, tracking: tuple[float, float] = (math.nan, math.nan)) -> OverallStatus:
    """Return the status of the loop: the worst of its nodes and of the tracking.

    Warnings of nodes that only watch the loop are added to the text and do not change the level.
    """
    # tracking [m]
    if live.silence('state') > SILENCE:
        return OverallStatus('gone', 'no signal')
    found: list[OverallStatus] = []
    aside: list[str] = []
    error, size = tracking
    if size > 0.0 and error > UNTRACKED * size:
        share = 100 * error / size
        found.append(OverallStatus('error', f'the reference is not followed: error {share:.0f} %'))
    for node in sorted(live.nodes.values(), key=lambda n: n.name):
        state = of_node(live, node)
        mends = node.name == 'gap_monitor' and live.gaps and corrected(live.gaps[-1], error)
        if not node.present or state.level == 'ok' or mends:
            continue
        text = f'{node.name}: {state.text}'
        if node.name in WATCHERS:
            aside.append(text)
        else:
            found.append(OverallStatus(state.level, text))
    found.sort(key=lambda each: each.level != 'error')
    texts = [*(each.text for each in found), *aside]
    return OverallStatus(found[0].level if found else 'ok', '; '.join(texts))


def trouble(live: Live) -> str:
    """Return the fault of the loop in one sentence, '' without one."""
    name = f'/{live.actuator}/actuator/state' if live.actuator else '/actuator/state'
    silence = live.silence('state')
    if silence <= SILENCE:
        return ''
    if not live.published:
        lost = 'Start the simulator or the driver of your hardware; this page continues by itself.'
        if math.isinf(silence):
            return f'No actuator: no node publishes {name}. {lost}'
        return (
            f'Stale: no message on {name} for {ago(silence)}, its node has ended. The plots '
            f'show old data. {lost}'
        )
    if math.isinf(silence):
        begin = f'Waiting for the first sample of {name}.'
    else:
        begin = (
            f'Stale: no message on {name} for {ago(silence)}, its node is still running. The '
            'plots show old data.'
        )
    return f'{begin} {_remedy(live)}'


def _remedy(live: Live) -> str:
    """Return the advice for an actuator that is present and publishes nothing."""
    if 'excitation' not in live.parameters:
        return 'In lock-step it waits for commands: start an excitation.'
    report = live.diagnostics.get('excitation')
    mode = live.parameter('excitation', 'mode')
    if mode is not None and mode.value == 'idle':
        if report is not None and report.level == 'error':
            return (
                f'The excitation has stopped ({report.text}). When all nodes run, choose a mode '
                'again under Drive.'
            )
        return 'No experiment runs: choose a mode under Drive, or start a sweep.'
    if report is not None and report.level != 'ok':
        return f'The excitation reports: {report.text}.'
    return 'Nodes shows which node does not run.'


def banner(live: Live) -> str:
    """Return the banner on top of the page, '' without a fault."""
    found = trouble(live)
    now = live.clock()
    lost = [
        f'{node.name} (for {ago(now - node.since)})'
        for node in list(live.nodes.values())
        if not node.present and now - node.since < LOST_SHOWN
    ]
    parts = [found] if found else []
    if lost:
        parts.append(f'Nodes that have ended: {", ".join(lost)}.')
    if not parts:
        return ''
    kind = ' calm' if not lost and at_rest(live) and live.published else ''
    return f'<div class="banner{kind}" role="status">{escape(" ".join(parts))}</div>'


def pulse(live: Live, tracking: tuple[float, float] = (math.nan, math.nan)) -> str:
    """Return the line under the title: status, tick, rate, drive."""
    known = overall(live, tracking)
    light = f'<span class="dot {known.level}"></span>'
    if known.level == 'gone':
        return f'{light}{known.text}'
    parts = [f'tick {live.signals.newest}', f'sampled at {live.signals.rate:g} Hz']
    if live.fundamental > 0.0:
        parts.append(f'drive {live.fundamental:g} Hz')
    if live.record:
        parts.append(f'record {live.record}')
    text = f' <span class="{known.level}">{escape(known.text)}</span>' if known.text else ''
    return f'{light}{escape(" · ".join(parts))}{text}'


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
