"""Overall status of the loop: indicator, summary, banner."""

from __future__ import annotations

import math
from dataclasses import dataclass
from html import escape

from piezo_hysteresis.dashboard.live_state import SILENCE, Gap, Live, NodeState

LOST_SHOWN = 600.0  # time for which a node that has ended is shown [s]
UNTRACKED = 0.2  # relative tracking error above which the reference is not followed
CORRECTED = 0.1  # tracking error relative to the gap below which the gap is compensated
#: Nodes that only monitor the loop: their status does not change its light.
WATCHERS = {
    'gap_monitor', 'identification', 'discovery', 'recorder', 'dashboard_listener', 'player',
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
