"""The live page in a real browser, over live processes."""

from __future__ import annotations

import re
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlsplit

import pytest
from dashboard_browser import BROWSER, Browser
from diagnostic_msgs.msg import DiagnosticStatus
from listening import Listener

from piezo_hysteresis.ros.processes import NodeProcess, NodeProcesses

pytestmark = [
    pytest.mark.ros,
    pytest.mark.skipif(BROWSER is None, reason='no Chromium: apt-get install chromium'),
]

SPACE = 'stage_x'
SIMULATOR = {'clock': 'lock_step', 'preset': 'generic_bouc_wen'}


# Elements that reach beyond the screen.
WIDE = """(() => { const found = []; const walk = (root) => {
  for (const e of root.querySelectorAll('*')) {
    if (e.getBoundingClientRect().right > 390.1) found.push(e.tagName + ' ' + e.className);
    if (e.shadowRoot) walk(e.shadowRoot);
  } }; walk(document); return found.join(', '); })()"""


@pytest.fixture
def browser(tmp_path: Path) -> Iterator[Browser]:
    page = Browser(tmp_path)
    yield page
    page.close()


def start_all(processes: NodeProcesses, listener: Listener, folder: Path) -> NodeProcess:
    drive = {
        'frequency': 5.0, 'voltage.amplitude': 0.5, 'ramp': 0.1,
        'deadline': 120.0, 'folder': str(folder),
    }  # fmt: skip
    dashboard = processes.start(
        'piezo_hysteresis', 'dashboard', {'port': 0, 'folder': str(folder)}
    )
    processes.start('piezo_sim', 'simulator', SIMULATOR, namespace=SPACE)
    listener.matched(f'/{SPACE}/actuator/state', 120.0)
    processes.start('piezo_hysteresis', 'excitation', drive, namespace=SPACE)
    return dashboard


def address_of(dashboard: NodeProcess, browser: Browser) -> str:
    def said() -> re.Match[str] | None:
        return re.search(r'http://\S+', dashboard.log.read_text())

    return str(browser.until(said, what='the dashboard says where it is').group())


def status_of(url: str) -> int:
    try:
        with urllib.request.urlopen(url, timeout=30) as answer:
            return int(answer.status)
    except urllib.error.HTTPError as error:
        return error.code


def loop_height(browser: Browser) -> float:
    """Return the height of the loop on the screen [µm]."""
    return float(
        browser.run(
            "(() => { const y = Array.from(model('loop.last').data['y']).filter(isFinite);"
            ' return Math.max(...y) - Math.min(...y); })()'
        )
    )


def drag_slider(browser: Browser, name: str, share: float) -> None:
    """Drag the handle of a slider to a share of its length."""
    left, top, width, height = browser.place(name, 'slider_el')
    start, end, value = (browser.value(name, field) for field in ('start', 'end', 'value'))
    middle = top + height / 2
    here = left + width * (value - start) / (end - start)
    browser.drag((here, middle), (left + share * width, middle))


def words(browser: Browser, name: str) -> str:
    return str(browser.value(name, 'text'))


def test_the_page_over_live_processes(
    processes: NodeProcesses, listener: Listener, browser: Browser, tmp_path: Path
) -> None:
    dashboard = start_all(processes, listener, tmp_path)
    listener.says(listener.watch_health(), 'dashboard', DiagnosticStatus.OK, 'serves http')
    browser.size(1400, 1000)
    address = address_of(dashboard, browser)
    # A loop in lock-step takes all the processor it can get: it starts once the page is there.
    browser.open(f'{address}?actuator={SPACE}')
    node = f'/{SPACE}/excitation'
    assert listener.set_one(node, 'mode', 'voltage') == ''

    # The loop is shown.
    browser.until("document.querySelector('h1').textContent.includes('stage_x')")
    browser.until("model('loop.last')?.data['x'].length > 50")
    browser.until("model('excitation.voltage.amplitude.slider') !== null")
    browser.until(lambda: 30.0 < loop_height(browser) < 90.0, what='a loop of 1 V across')
    assert words(browser, 'banner') == ''

    # A slider moves the actuator.
    before = loop_height(browser)
    drag_slider(browser, 'excitation.voltage.amplitude.slider', 0.5)
    wanted = browser.value('excitation.voltage.amplitude.slider')
    assert wanted > 0.7
    listener.until(lambda: listener.get_parameter(node, 'voltage.amplitude') == wanted)
    browser.until(lambda: loop_height(browser) > 1.3 * before, what='a larger loop')
    assert words(browser, 'excitation.voltage.amplitude.reason') == ''

    # A refusal says why, and the control goes back. What is typed before the number follows the
    # slider is lost.
    browser.until(f"model('excitation.voltage.amplitude.number').value == {wanted}")
    browser.type('excitation.voltage.amplitude.number', '9000')
    reason = browser.until("model('excitation.voltage.amplitude.reason').text")
    assert 'voltage.amplitude' in reason
    assert '500' in reason
    browser.until(f"model('excitation.voltage.amplitude.number').value == {wanted}")
    assert listener.get_parameter(node, 'voltage.amplitude') == wanted

    # What others set is followed.
    assert listener.set_one(node, 'voltage.amplitude', 0.8) == ''
    browser.until("model('excitation.voltage.amplitude.slider').value == 0.8")

    # An effect is switched on, found by a sweep and a discovery, and read as words.
    browser.click('simulator.effects.resonance.switch', 'body_el')
    listener.until(
        lambda: listener.get_parameter(f'/{SPACE}/simulator', 'effects.resonance') is True
    )
    run_sweep(browser, 'first', seconds='1')
    bag = tmp_path / 'sweeps' / 'first'
    browser.until(f"model('sweep.words').text.includes('6 records in {bag}')", 120.0)
    assert words(browser, 'sweep.words').count('sine_') == 6
    browser.until("model('discovery.data').value.includes('first')")
    browser.click('discovery.start')
    browser.until("model('discovery.bar').visible")
    browser.until("model('discovery.words').text.includes('Open the report')", 180.0)
    verdict = words(browser, 'discovery.words')
    assert 'misses resonance' in verdict
    assert 'noise floors before' in verdict
    report = re.search(r'href="(\S+)"', verdict)
    assert report
    assert status_of(address + report.group(1)) == 200
    (tmp_path / 'secret.txt').write_text('secret')
    assert status_of(f'{address}reports/secret.txt') == 404
    assert status_of(f'{address}reports/..%2F..%2Fetc%2Fpasswd.html') in (403, 404)

    # A sweep can be given up.
    run_sweep(browser, 'second', seconds='600')
    browser.until("model('sweep.bar').visible && model('sweep.words').text.includes('Hz at')")
    browser.click('sweep.cancel')
    browser.until("model('sweep.words').text.includes('cancelled')")

    # A node that is lost is told of, and taken up again.
    processes.retire(processes.nodes[1])
    browser.until("model('banner').text.includes('Stale')")
    processes.start('piezo_sim', 'simulator', SIMULATOR, namespace=SPACE)
    assert listener.set_one(node, 'mode', 'voltage') == ''
    browser.until("model('banner').text === ''")

    # A phone is wide enough, and nothing was asked of the network.
    browser.size(390, 844, phone=True)
    browser.until('document.documentElement.scrollWidth <= 390', what=browser.run(WIDE))
    hosts = {urlsplit(url).hostname for url in browser.requests if not url.startswith('data:')}
    assert hosts == {urlsplit(address).hostname}
    assert browser.complaints == []

    # Ctrl-C ends it without a word, with the page open.
    assert dashboard.stop(30.0) == 0
    assert 'Traceback' not in dashboard.log.read_text()
    processes.retire(dashboard)


def test_a_foreign_site_that_points_to_this_machine_gets_nothing(
    processes: NodeProcesses, tmp_path: Path
) -> None:
    rule = '--host-resolver-rules=MAP rebound.example 127.0.0.1'
    browser = Browser(tmp_path, rule)
    try:
        dashboard = processes.start(
            'piezo_hysteresis', 'dashboard', {'port': 0, 'folder': str(tmp_path)}
        )
        port = urlsplit(address_of(dashboard, browser)).port
        browser.command('Page.navigate', url=f'http://rebound.example:{port}/')
        browser.until("document.body.textContent.includes('not known by that name')")
        opened = f"""new Promise((done) => {{
            const socket = new WebSocket('ws://rebound.example:{port}/ws', ['bokeh', 'x']);
            socket.onopen = () => done('opened');
            socket.onerror = () => done('refused');
        }})"""
        assert browser.run(opened) == 'refused'
    finally:
        browser.close()


def run_sweep(browser: Browser, name: str, seconds: str) -> None:
    browser.type('sweep.frequencies', '5, 11, 23')
    browser.type('sweep.amplitudes', '1, 0.5')
    browser.type('sweep.seconds', seconds)
    browser.type('sweep.warm_up', '0.2')
    browser.type('sweep.name', name)
    browser.until(f"model('sweep.name').value === '{name}'")
    time.sleep(0.2)  # the browser tells the server
    browser.click('sweep.start')


def test_a_phone_folds_what_is_secondary(processes: NodeProcesses, tmp_path: Path) -> None:
    browser = Browser(tmp_path)
    try:
        dashboard = processes.start(
            'piezo_hysteresis', 'dashboard', {'port': 0, 'folder': str(tmp_path)}
        )
        browser.size(390, 844, phone=True)
        browser.open(address_of(dashboard, browser))
        assert browser.run("document.querySelectorAll('details[open]').length") == 1
        folded = browser.run('document.documentElement.scrollHeight')
        assert folded < 4000
        browser.run("document.querySelector('details.more').open = true")
        browser.until(f'document.documentElement.scrollHeight > {folded + 900}')
        box = "view('gap').el.getBoundingClientRect()"
        browser.until(f'{box}.height > 150 && {box}.width > 300')
        assert browser.run('document.documentElement.scrollWidth') <= 390
    finally:
        browser.close()
