"""A process reports that it compiles; a waiting client can identify it."""

from __future__ import annotations

import threading
import time

import pytest

from piezo_hysteresis.kernels import watch
from piezo_hysteresis.ros import readiness
from piezo_hysteresis.ros.readiness import FRESH, HeartbeatPublisher, Heartbeats, Readiness


class Ear:
    def __init__(self) -> None:
        self.said: list[tuple[Readiness, str]] = []
        self.compiled = 0

    def publish(self, state: Readiness, words: str) -> None:
        self.said.append((state, words))

    def compiles(self) -> None:
        self.compiled += 1

    def wait(self, count: int) -> None:
        end = time.monotonic() + 10.0
        while len(self.said) < count:
            assert time.monotonic() < end, self.said
            time.sleep(0.01)


@pytest.fixture
def ear(monkeypatch: pytest.MonkeyPatch) -> Ear:
    monkeypatch.setattr(readiness, 'PERIOD', 0.05)
    monkeypatch.setattr(readiness, 'SHORT', 0.02)
    return Ear()


def threads() -> int:
    return sum(thread.name == 'herald' for thread in threading.enumerate())


def test_a_start_is_reported_until_the_node_is_served(ear: Ear) -> None:
    told = HeartbeatPublisher(ear.publish)
    assert ear.said == [(Readiness.STARTING, 'starting (0 s)')]
    ear.wait(3)
    told.ready()
    end = time.monotonic() + 10.0
    while threads() and time.monotonic() < end:
        time.sleep(0.01)
    assert threads() == 0, 'no thread is left beside the loop'
    assert ear.compiled == 0
    told.close()


def test_compiling_is_reported_while_it_lasts_and_once_in_the_log(ear: Ear) -> None:
    told = HeartbeatPublisher(ear.publish, ear.compiles)
    for _ in range(2):
        watch.begin()
        ear.wait(len(ear.said) + 2)
        watch.end()
    assert ear.said[-1][0] is Readiness.STARTING
    assert ear.said[-1][1].startswith('starting: compiles its kernels (first start only) (')
    assert ear.compiled == 1
    told.close()


def test_later_compiling_is_reported(ear: Ear) -> None:
    told = HeartbeatPublisher(ear.publish, ear.compiles)
    told.ready()
    while threads():
        time.sleep(0.01)
    before = len(ear.said)
    watch.begin()
    ear.wait(before + 2)
    watch.end()
    assert ear.said[-1] == (Readiness.COMPILING, 'compiles its kernels (first start only) (0 s)')
    told.close()


def test_a_kernel_within_a_kernel_is_one_compilation(monkeypatch: pytest.MonkeyPatch) -> None:
    started: list[int] = []
    monkeypatch.setattr(watch, 'LISTENERS', [lambda: started.append(1)])
    watch.begin()
    watch.begin()
    watch.end()
    assert watch.compiling()
    watch.end()
    assert (watch.compiling(), started) == (False, [1])


def test_a_busy_node_is_known_while_it_reports() -> None:
    now = [100.0]
    book = Heartbeats(lambda: now[0])
    assert book.silence() == float('inf')
    assert not book.is_ready('simulator')
    book.note('/piezo/simulator', 'starting', 'starting (0 s)')
    assert book.working() == 'piezo/simulator: starting (0 s)'
    now[0] += FRESH
    assert book.working() == ''
    assert book.silence() == FRESH
    book.note('/piezo/simulator', 'ready', 'runs')
    assert book.is_ready('piezo/simulator')
    assert book.silence() == FRESH


def test_a_new_node_is_expected_to_report() -> None:
    now = [100.0]
    book = Heartbeats(lambda: now[0])
    book.update_discovered(['/recorder', '/foreign'])
    assert book.awaiting_first_heartbeat() == ['foreign', 'recorder']
    book.note('/recorder', 'starting', 'starting (0 s)')
    assert book.awaiting_first_heartbeat() == ['foreign']
    now[0] += FRESH  # whoever never speaks under its own name holds nobody up for long
    book.update_discovered(['/recorder', '/foreign', '/late'])
    assert book.awaiting_first_heartbeat() == ['late']
    book.update_discovered(['/recorder'])
    assert book.awaiting_first_heartbeat() == []
