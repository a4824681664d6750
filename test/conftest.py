"""What holds for all tests: repeatable examples, reported skips and reruns, short unit tests."""

from __future__ import annotations

import functools
import importlib
import os
import subprocess
import sys
from collections.abc import Iterator
from math import inf
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

# Property tests draw the same examples in every run, so that a red run can be repeated.
settings.register_profile('repeatable', derandomize=True, deadline=None)
settings.load_profile('repeatable')

# With this set, a test that is skipped fails the run unless it stands on the list.
NO_SKIPS = 'PIEZO_NO_SKIPS'
ALLOWED = Path(__file__).with_name('allowed_skips.txt')


def allowed_skips() -> dict[str, str]:
    """Return why tests may be skipped, by the beginning of their names."""
    lines = [line for line in ALLOWED.read_text(encoding='utf-8').splitlines() if line[:1] != '#']
    return dict(line.split(': ', 1) for line in lines if line)


class Ledger:
    """Counts what was skipped and what was run again; of the process that reports to people."""

    def __init__(self, config: pytest.Config) -> None:
        self._reruns_allowed = bool(config.getoption('reruns', 0))
        self._skipped: dict[str, str] = {}
        self._again: list[str] = []

    def pytest_runtest_logreport(self, report: Any) -> None:
        if report.outcome == 'rerun':
            self._again.append(report.nodeid)
        elif report.skipped and not hasattr(report, 'wasxfail'):
            self._skipped[report.nodeid] = _reason(report)

    def pytest_collectreport(self, report: Any) -> None:
        if report.skipped:
            self._skipped[report.nodeid] = _reason(report)

    def _forbidden(self) -> dict[str, str]:
        if not os.environ.get(NO_SKIPS):
            return {}
        beginnings = tuple(allowed_skips())
        return {k: why for k, why in self._skipped.items() if not k.startswith(beginnings)}

    @pytest.hookimpl(wrapper=True)
    def pytest_sessionfinish(self, session: pytest.Session) -> Iterator[None]:
        yield
        if self._forbidden() and session.exitstatus == pytest.ExitCode.OK:
            session.exitstatus = pytest.ExitCode.TESTS_FAILED

    def pytest_terminal_summary(self, terminalreporter: Any) -> None:
        say = terminalreporter.write_line
        for name, why in self._forbidden().items():
            say(f'FAILED {name}: it was skipped ({why}), and {ALLOWED.name} does not list it')
        if self._reruns_allowed:
            say(f'live tests that needed another try: {len(self._again)}')
            for name in self._again:
                say(f'  {name}')


def _reason(report: Any) -> str:
    return str(report.longrepr[2]) if isinstance(report.longrepr, tuple) else str(report.longrepr)


def pytest_configure(config: pytest.Config) -> None:
    """Let the process that reports keep the ledger; the workers of xdist report to it."""
    if not hasattr(config, 'workerinput'):
        config.pluginmanager.register(Ledger(config), 'ledger')


# With this set, a unit test that takes more processor time fails, its children included [s].
UNIT_SECONDS = 'PIEZO_UNIT_SECONDS'
# Other work and slower machines raise processor time: 0.75 s became 1.1 s next to other work, and
# up to three times as much on another machine. A test fails only beyond what that explains.
BUSY = 4.0
# A pause of the machine counts as processor time, too (0.3 s became 6 s once): what is too long is
# run again in a process of its own, and fails if it is too long there as well.
AGAIN = 'PIEZO_UNIT_AGAIN'
SLOWER = ('component', 'slow')
UNIT = Path(__file__).with_name('unit')


@functools.cache
def _import_large_packages() -> None:
    """Import what takes long to import, so that no test is charged for being the first."""
    for name in ('bokeh.plotting', 'matplotlib.pyplot', 'scipy.optimize', 'scipy.signal'):
        importlib.import_module(name)


def _long_again(item: pytest.Item) -> bool:
    if AGAIN in os.environ:
        return True
    path = f'{item.path}::{item.nodeid.partition("::")[2]}'
    words = (sys.executable, '-m', 'pytest', '-q', '-p', 'no:cacheprovider', path)
    root = item.config.rootpath
    again = {**os.environ, AGAIN: '1'}
    return subprocess.run(words, cwd=root, env=again, check=False).returncode != 0


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Iterator[None]:
    """Fail a unit test that takes too much processor time and is not marked as longer."""
    most = float(os.environ.get(UNIT_SECONDS, 'inf'))
    if UNIT not in item.path.parents or most == inf:
        yield
        return
    _import_large_packages()
    from numba.core import event

    started = sum(os.times()[:4])
    with event.install_recorder('numba:compile') as compiled:
        yield
    spent = sum(os.times()[:4]) - started
    item.user_properties.append(('processor_s', f'{spent:.2f}'))
    # The first test that needs a kernel of no named model compiles it, whichever that is.
    long = spent > BUSY * most and not compiled.buffer
    if long and not any(map(item.get_closest_marker, SLOWER)) and _long_again(item):
        pytest.fail(
            f'{spent:.1f} s of processor time: a unit test takes {most:g} s at most on an idle '
            'machine. Make it smaller, or mark it as component (part of make test) or slow (make '
            'studies)'
        )
