"""What the page says in words: small pieces of HTML, everything from outside escaped."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from html import escape
from urllib.parse import quote

from bokeh.models import Div

from piezo_hysteresis.dashboard.live import SILENCE, Counters, Estimate, Gap, Job, Live
from piezo_hysteresis.dashboard.template import WIDGET_STYLE
from piezo_hysteresis.reporting.units import micrometres, shown, with_deviation

GONE_SHOWN = 600.0  # a node that left is told of for so long [s]


def _ago(seconds: float) -> str:
    return f'{seconds:.0f} s' if seconds < 120 else f'{seconds / 60:.0f} min'


def trouble(live: Live) -> str:
    """Return what is wrong with the loop in one sentence, '' where nothing is."""
    name = f'/{live.actuator}/actuator/state' if live.actuator else '/actuator/state'
    silence = live.silence('state')
    if math.isinf(silence):
        if live.published:
            return (
                f'Waiting for the first sample of {name}. In lock-step an excitation must run too.'
            )
        return (
            f'No actuator: nobody publishes {name}. Start the simulator or the driver of your '
            'hardware; this page goes on by itself.'
        )
    if silence > SILENCE:
        lost = 'its node has gone' if not live.published else 'its node is still there'
        return (
            f'Stale: nothing heard of {name} for {_ago(silence)}, {lost}. The plots show the past.'
        )
    return ''


def banner(live: Live) -> str:
    """Return the banner on top of the page, '' where all is well."""
    found = trouble(live)
    now = live.clock()
    lost = [
        f'{node.name} (for {_ago(now - node.since)})'
        for node in list(live.nodes.values())
        if not node.present and now - node.since < GONE_SHOWN
    ]
    parts = [found] if found else []
    if lost:
        parts.append(f'Nodes that have gone: {", ".join(lost)}.')
    if not parts:
        return ''
    return f'<div class="banner" role="status">{escape(" ".join(parts))}</div>'


def pulse(live: Live) -> str:
    """Return the line under the title: alive or not, tick, rate, drive."""
    if live.silence('state') > SILENCE:
        return '<span class="dot off"></span>no signal'
    parts = [f'tick {live.signals.newest}', f'sampled at {live.signals.rate:g} Hz']
    if live.fundamental > 0.0:
        parts.append(f'drive {live.fundamental:g} Hz')
    if live.record:
        parts.append(f'record {live.record}')
    return f'<span class="dot on"></span>{escape(" · ".join(parts))}'


def tracking_words(rms: float, size: float) -> str:
    """Return the tracking error in words; [m], not finite where nothing is tracked."""
    if not math.isfinite(rms):
        return '<p class="soft">No reference now: nothing is tracked.</p>'
    share = f', {100 * rms / size:.3g} % of the reference' if size > 0.0 else ''
    return f'<p>Tracking error <b>{micrometres(rms)} µm</b> rms{share}.</p>'


def gap_words(gaps: Sequence[Gap], monitored: bool) -> str:
    """Return what the newest gap means."""
    if not gaps:
        if monitored:
            return (
                '<p class="soft">The gap monitor has no model yet: load one with its service '
                '<code>load_model</code>.</p>'
            )
        return (
            '<p class="soft">No gap monitor is running: start '
            '<code>gap_monitor</code> with a <code>model_file</code>.</p>'
        )
    gap = gaps[-1]
    text = f'Gap <b>{gap.floors:.3g} noise floors</b> ({micrometres(gap.rms)} µm rms)'
    if gap.beyond:
        text += f', looks like <b>{escape(gap.family or "nothing known")}</b>'
    else:
        text += ', nothing beyond the noise'
    sizes = [(s, o) for o, s in zip(gap.orders, gap.harmonics, strict=False) if math.isfinite(s)]
    if gap.beyond and sizes:
        size, order = max(sizes)
        text += f'; most of it at {order}× ({micrometres(size)} µm)'
    return f'<p>{text}.</p>'


def estimate_words(estimates: Sequence[Estimate], identifying: bool) -> str:
    """Return the newest estimate as a table with standard deviations."""
    if not estimates:
        hint = (
            'Nothing is learnt yet; between the records of a sweep '
            'only with <code>only_records</code> false.'
            if identifying
            else 'No identification is running.'
        )
        return f'<p class="soft">{hint}</p>'
    newest = estimates[-1]
    rows = []
    for name, unit, value, std in zip(
        newest.names, newest.units, newest.values, newest.deviations, strict=False
    ):
        words, factor = shown(unit)
        # a parameter that the method holds has no deviation
        known = None if std == 0.0 else math.inf if math.isnan(std) else abs(factor) * std
        number, deviation = with_deviation(factor * value, known)
        sign = '± ' if deviation[0].isdigit() else ''
        rows.append((name, number, f'{sign}{deviation}', words))
    state = 'settled' if newest.converged else 'settling'
    head = (
        f'<p>{escape(newest.model or "no model")} by {escape(newest.method)}, {state}; one-step '
        f'error {micrometres(newest.one_step)} µm, free run {micrometres(newest.free_run)} µm. '
        f'{escape(newest.message)}</p>'
    )
    return head + _table(('parameter', 'value', 'std', 'unit'), rows)


def status_words(live: Live) -> str:
    """Return the nodes with their health and counters, and what was logged last."""
    now = live.clock()
    rows = []
    for node in sorted(live.nodes.values(), key=lambda n: n.name):
        health = live.diagnostics.get(node.name)
        level, words = ('ok', 'there') if health is None else (health.level, health.text)
        if not node.present:
            level, words = 'gone', f'gone for {_ago(now - node.since)}'
        name = f'<span class="tick {level}"></span>{escape(node.name)}'
        rows.append((name, escape(words), escape(_counted(live.counters.get(node.name)))))
    parts = [_raw_table(('node', 'health', 'counters'), rows)] if rows else []
    parts += [
        f'<p class="{word.level}">{escape(word.node)}: {escape(word.text)} '
        f'<span class="soft">{_ago(now - word.at)} ago</span></p>'
        for word in list(live.words)[-4:]
    ]
    return ''.join(parts) or '<p class="soft">No nodes yet.</p>'


def _counted(counters: Counters | None) -> str:
    if counters is None:
        return ''
    told = [f'{name} {count}' for name, count in counters.counts.items() if count]
    if counters.rate > 0.0:
        told.insert(0, f'{counters.rate:.0f} ticks/s')
    return ', '.join(told)


def job_words(job: Job) -> str:
    """Return what a job does, brought out or failed with."""
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
        rows = [(name, by or 'nobody') for name, by in job.records]
        parts.append(_table(('record', 'recorded by'), rows))
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
    """Return a table of cells that are HTML already."""
    head = ''.join(f'<th>{escape(header)}</th>' for header in headers)
    body = ''.join('<tr>' + ''.join(f'<td>{cell}</td>' for cell in row) + '</tr>' for row in rows)
    return (
        f'<div class="wide"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>'
        '</div>'
    )


def words_div(name: str) -> Div:
    """Return an empty place for words."""
    return Div(text='', name=name, stylesheets=[WIDGET_STYLE], sizing_mode='stretch_width')


def say(place: Div, text: str) -> None:
    """Change words only where they are others."""
    if place.text != text:
        place.text = text
