"""Numbers of samples, watchdog and health: the parts that know no ROS."""

from __future__ import annotations

from itertools import pairwise

import pytest

from piezo_hysteresis.compensation.base import Limits, Measured, ReferencePoint
from piezo_hysteresis.compensation.limiter import Limiter
from piezo_hysteresis.nodes.link_health import SILENCE, LinkHealth
from piezo_hysteresis.nodes.tick_book import TickBook
from piezo_hysteresis.nodes.watchdog import Watchdog
from piezo_ros_common.health import HOLD, CounterWatch, Level, judge
from piezo_ros_common.order import AHEAD, REORDERED, Intake


class Clock:
    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


def test_an_intake_takes_each_number_once_and_in_order() -> None:
    intake = Intake()
    taken = [k for k in (7, 8, 8, 7, 10, 9, 11) if intake.take(k)]
    assert taken == [7, 8, 10, 11]
    assert intake.counters() == {'missed': 1, 'doubled': 1, 'reordered': 2, 'strays': 0}


def test_one_number_far_ahead_is_a_stray_and_the_next_one_a_jump() -> None:
    intake = Intake()
    assert intake.take(5)
    assert not intake.take(6 + AHEAD)
    assert intake.take(6)
    assert not intake.take(9 * AHEAD)
    assert not intake.take(20 * AHEAD)
    assert intake.take(20 * AHEAD)  # said again, as an excitation does
    assert intake.newest == 20 * AHEAD
    assert intake.counters()['strays'] == 3


@pytest.mark.parametrize('first', [0, 1000])
def test_a_source_that_was_started_anew_is_followed(first: int) -> None:
    intake = Intake()
    assert intake.take(first + REORDERED + 1)
    assert intake.take(first)
    assert intake.take(first + 1)
    assert sum(intake.counters().values()) == 0


def new_watchdog(**values: float) -> Watchdog:
    limiter = Limiter(Limits(-1.0, 1.0, 100.0), 1e-3, 0.5)
    return Watchdog(limiter, int(values.get('patience', 10)), values.get('safe', 0.0), 20.0)


def test_a_watchdog_ramps_after_its_patience_says_the_goal_and_is_silent() -> None:
    watchdog = new_watchdog()
    assert [watchdog.voltage(k) for k in range(50)] == [None] * 50  # nothing was passed on yet
    watchdog.fed(99)
    said = {k: v for k in range(100, 200) if (v := watchdog.voltage(k)) is not None}
    assert list(said) == list(range(110, 135))
    assert max(abs(b - a) for a, b in pairwise([0.5, *said.values()])) <= 0.02 + 1e-12
    assert said[134] == 0.0
    assert watchdog.stale
    watchdog.fed(200)
    assert not watchdog.stale
    assert watchdog.voltage(205) is None
    assert watchdog.episodes == 1


def test_a_watchdog_keeps_to_the_limits_and_can_be_off() -> None:
    watchdog = new_watchdog(safe=-7.0)
    watchdog.fed(0)
    said = [v for k in range(1, 500) if (v := watchdog.voltage(k)) is not None]
    assert said[-1] == -1.0
    off = new_watchdog(patience=0)
    off.fed(0)
    assert off.voltage(10**9) is None


def test_what_happened_counts_for_a_while() -> None:
    clock = Clock()
    watch = CounterWatch({'late': (Level.WARN, 'slow'), 'lost': (Level.ERROR, 'gone')}, clock)
    assert watch.findings({'late': 0, 'lost': 0, 'other': 9}) == []
    assert watch.findings({'late': 2, 'lost': 0}) == [(Level.WARN, 'slow (late 2)')]
    clock.now += 0.5 * HOLD
    findings = watch.findings({'late': 2, 'lost': 1})
    assert judge(findings, 'fine', {}).level == Level.ERROR
    assert judge(findings, 'fine', {}).message == 'gone (lost 1)'
    clock.now += 0.6 * HOLD
    assert watch.findings({'late': 2, 'lost': 1}) == [(Level.ERROR, 'gone (lost 1)')]
    clock.now += HOLD
    assert judge(watch.findings({'late': 2, 'lost': 1}), 'fine', {}).message == 'fine'


def test_a_link_tells_standstill_from_silence_and_from_rest() -> None:
    clock, watchdog = Clock(), new_watchdog()
    health = LinkHealth(clock)

    def level(sample: int, active: bool = True) -> tuple[Level, str]:
        found = health.judge({'sample': sample, 'active': active}, {}, watchdog)
        return found.level, found.message

    assert level(-1) == (Level.OK, 'waits for the first tick')
    assert level(5) == (Level.OK, 'corrects')
    assert level(6, active=False) == (Level.OK, 'inactive: passes the voltage on')
    clock.now += SILENCE + 1.0
    assert level(6) == (Level.WARN, 'no tick for 3 s: the loop stands still')
    watchdog.fed(6)
    watchdog.voltage(17)
    assert level(6) == (Level.ERROR, 'no input since tick 6: the voltage is ramped to safety')


def test_a_voltage_whose_reference_never_comes_does_not_block_the_book() -> None:
    book: TickBook[str] = TickBook()
    for k in (0, 1, 2, 3):
        book.add_voltage(k, 0.1 * k, 'tag')
        book.add_measured(Measured(k, 0.0, 0.0))
        if k != 1:
            book.add_reference(ReferencePoint(k, 0.0, 0.0, 0.0, 0.0, 0.0))
    taken = []
    while (tick := book.take()) is not None:
        taken.append(tick.point.sample)
    assert taken == [0, 2, 3]
    assert book.dropped == 1


def test_strays_between_genuine_messages_never_make_a_jump() -> None:
    intake = Intake()
    for k in range(50):
        assert intake.take(k)
        assert not intake.take(k + 10**6)
    assert intake.newest == 49
    assert intake.counters()['strays'] == 50
