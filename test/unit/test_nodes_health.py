"""Numbers of samples, watchdog and health: the parts that know no ROS."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from piezo_hysteresis.common.node_sheet import HOLD, CounterWatch, Level, judge
from piezo_hysteresis.common.stamps import (
    REORDERED,
    ActuatorClock,
    SequenceFilter,
    StampValidator,
    tick_nanoseconds,
)
from piezo_hysteresis.compensation.limiter import Limiter
from piezo_hysteresis.compensation.link import Limits, Measured, ReferencePoint
from piezo_hysteresis.runtime.excitation_plan import Doing, ExcitationHealth
from piezo_hysteresis.runtime.link_health import SILENCE, LinkHealth, Watchdog
from piezo_hysteresis.runtime.synchronizer import SampleSynchronizer


class Clock:
    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


def test_an_intake_takes_each_number_once_and_in_order() -> None:
    intake = SequenceFilter()
    taken = [k for k in (7, 8, 8, 7, 10, 11, 9, 12) if intake.take(k)]
    assert taken == [7, 8, 11, 12]
    assert intake.counters() == {'missed': 2, 'doubled': 1, 'reordered': 2, 'strays': 0}


@pytest.mark.parametrize('ahead', [2, 3, REORDERED, REORDERED + 1, 900, 20_000])
def test_one_number_ahead_is_a_stray_at_any_distance_and_the_next_one_a_jump(ahead: int) -> None:
    intake = SequenceFilter()
    assert intake.take(5)
    assert not intake.take(5 + ahead)
    assert [k for k in range(6, 100) if intake.take(k)] == list(range(6, 100))
    assert intake.counters() == {'missed': 0, 'doubled': 0, 'reordered': 0, 'strays': 1}
    assert not intake.take(99 + ahead)
    assert intake.take(100 + ahead)
    assert intake.counters() == {'missed': ahead, 'doubled': 0, 'reordered': 0, 'strays': 1}


@pytest.mark.parametrize('ahead', [2, 60, 900])
def test_a_number_ahead_that_is_repeated_is_a_jump(ahead: int) -> None:
    """An excitation repeats its last message where no answer comes."""
    intake = SequenceFilter()
    assert [intake.take(k) for k in (5, 5 + ahead, 5 + ahead)] == [True, False, True]
    assert intake.counters()['strays'] == 0


@pytest.mark.parametrize('lost', [0.01, 0.1, 0.5])
def test_a_lost_packet_costs_at_most_one_more(lost: float) -> None:
    intake, rng = SequenceFilter(), np.random.default_rng(3)
    came = [0, *np.flatnonzero(rng.random(5000) > lost).tolist()[1:]]
    taken = [k for k in came if intake.take(k)]
    gaps = sum(after != before + 1 for before, after in pairwise(came))
    assert len(taken) >= len(came) - gaps
    assert taken == sorted(taken)
    assert intake.counters()['strays'] == 0


def test_a_source_that_begins_at_0_was_started_anew() -> None:
    intake = SequenceFilter()
    assert [k for k in (3, 0, 1, 900, 901, 0) if intake.take(k)] == [3, 0, 1, 901, 0]
    assert intake.counters() == {'missed': 899, 'doubled': 0, 'reordered': 0, 'strays': 0}
    assert not intake.take(0)
    assert intake.counters()['doubled'] == 1


@pytest.mark.parametrize(('first', 'restarts'), [(1000, True), (1000, False), (0, False)])
def test_one_number_far_back_is_a_stray_and_the_next_one_a_restart(
    first: int, restarts: bool
) -> None:
    intake = SequenceFilter(restarts=restarts)
    newest = first + REORDERED + 5
    assert intake.take(newest)
    assert not intake.take(first)
    assert intake.take(newest + 1)
    assert not intake.take(first + 1)
    assert intake.take(first + 2)
    assert intake.newest == first + 2
    assert intake.counters() == {'missed': 0, 'doubled': 0, 'reordered': 0, 'strays': 1}


def test_a_0_that_is_a_number_like_all_others_is_out_of_order_near_the_newest() -> None:
    intake = SequenceFilter(restarts=False)
    assert [k for k in range(5) if intake.take(k)] == list(range(5))
    assert not intake.take(0)
    assert intake.take(5)
    assert intake.counters()['reordered'] == 1


MS = 1_000_000
HOUR = 3_600_000 * MS


def timed(stamps: StampValidator, samples: dict[int, int]) -> list[int]:
    return [stamps.true_time(sample, stamp) for sample, stamp in samples.items()]


@pytest.mark.parametrize(
    ('wrong', 'jumps'), [(0, 2), (1, 2), (3 * HOUR, 2), (7 * HOUR, 2), (5 * HOUR + 2 * MS, 1)]
)
def test_a_stamp_that_jumps_is_replaced_by_the_sample_index(wrong: int, jumps: int) -> None:
    stamps = StampValidator(1e-3)
    genuine = {k: 5 * HOUR + k * MS for k in (0, 1, 2, 5, 6, 7)}
    assert timed(stamps, {**genuine, 5: wrong}) == list(genuine.values())
    assert stamps.jumps == jumps  # away, and back where that is far
    assert stamps.true_time(8, 5 * HOUR + 8 * MS + 3) == 5 * HOUR + 8 * MS + 3
    assert stamps.jumps == jumps


@pytest.mark.parametrize('set_to', [-2 * HOUR, 2 * HOUR])
def test_a_clock_that_was_set_is_accepted_from_the_second_sample_on(set_to: int) -> None:
    stamps = StampValidator(1e-3)
    begin = 5 * HOUR
    assert timed(stamps, {0: begin, 1: begin + MS}) == [begin, begin + MS]
    assert stamps.true_time(2, begin + set_to + 2 * MS) == begin + 2 * MS
    assert stamps.true_time(3, begin + set_to + 3 * MS) == begin + set_to + 3 * MS
    assert stamps.jumps == 1


def test_a_source_that_stamps_nothing_does_not_jump_and_one_that_stops_to_stamp_does() -> None:
    stamps = StampValidator(1e-3)
    assert timed(stamps, {0: 0, 1: 0, 2: 0, 9: 0}) == [0, 0, 0, 0]
    assert stamps.jumps == 0
    assert timed(stamps, {10: HOUR, 11: HOUR + MS}) == [MS, HOUR + MS]
    assert timed(stamps, {12: 0, 13: 0}) == [HOUR + 2 * MS, HOUR + 3 * MS]
    assert stamps.jumps == 3


def test_the_stamps_of_a_source_that_was_started_anew_begin_anew() -> None:
    stamps = StampValidator(1e-3)
    assert timed(stamps, {7: 7 * MS, 8: 8 * MS}) == [7 * MS, 8 * MS]
    assert timed(stamps, {0: HOUR, 1: HOUR + MS}) == [HOUR, HOUR + MS]
    assert stamps.jumps == 0


def test_edges_lie_at_the_ticks_of_a_simulator_and_between_those_of_a_driver() -> None:
    rate = 3000.0
    clock = ActuatorClock(rate)
    for k in range(5):
        clock.update(k, tick_nanoseconds(k, rate))
    assert [clock.time_of(k) for k in (5, 6)] == [tick_nanoseconds(k, rate) for k in (5, 6)]
    assert clock.edge_at(5) == tick_nanoseconds(5, rate)

    driver = ActuatorClock(rate)
    stamps = [5 * HOUR + tick_nanoseconds(k, rate) + (-1) ** k * 50_000 for k in range(2000)]
    for k, stamp in enumerate(stamps[:-1]):
        driver.update(k, stamp if k != 700 else 0)
        if k:
            assert stamps[k] < driver.edge_at(k + 1) < stamps[k + 1]
    assert driver.jumps == 2


def test_an_excitation_reports_its_state_and_the_node_it_waits_for() -> None:
    clock = Clock()
    health = ExcitationHealth(clock)

    def level(counts: dict[str, int] | None = None, **doing: Any) -> tuple[Level, str]:
        known = {'what': '', 'waits': '', 'given_up': '', 'silent': 0.0, 'sample': 7, **doing}
        found = health.judge(Doing(**known), counts or {}, '4 records')
        assert found.values['last_sweep'] == '4 records'
        return found.level, found.message

    assert level(sample=-1) == (Level.OK, 'idle, no actuator state received yet')
    assert level(silent=9.0) == (Level.OK, 'idle')
    assert level(what='reference: sine, 2 Hz') == (Level.OK, 'reference: sine, 2 Hz')
    silent = (Level.WARN, 'no actuator/state for 9 s after tick 7')
    assert level(what='a sweep', silent=9.0) == silent
    assert level(what='a sweep', waits='the recorder', silent=9.0) == (
        Level.WARN,
        'waits for the recorder',
    )
    assert level(given_up='no answer') == (Level.ERROR, 'no answer')
    assert level({'sweeps_refused': 1})[0] == Level.WARN
    clock.now += HOLD
    assert level({'sweeps_refused': 1}) == (Level.OK, 'idle')


def new_watchdog(**values: float) -> Watchdog:
    limiter = Limiter(Limits(-1.0, 1.0, 100.0), 1e-3, 0.5)
    return Watchdog(limiter, int(values.get('timeout', 10)), values.get('safe', 0.0), 20.0)


def test_a_watchdog_ramps_after_its_timeout_and_then_stops_publishing() -> None:
    watchdog = new_watchdog()
    assert [watchdog.voltage(k) for k in range(50)] == [None] * 50  # nothing was passed on yet
    watchdog.received(99)
    voltages = {k: v for k in range(100, 200) if (v := watchdog.voltage(k)) is not None}
    assert list(voltages) == list(range(110, 135))
    assert max(abs(b - a) for a, b in pairwise([0.5, *voltages.values()])) <= 0.02 + 1e-12
    assert voltages[134] == 0.0
    assert watchdog.stale
    watchdog.received(200)
    assert not watchdog.stale
    assert watchdog.voltage(205) is None
    assert watchdog.episodes == 1


def test_a_watchdog_keeps_to_the_limits_and_can_be_off() -> None:
    watchdog = new_watchdog(safe=-7.0)
    watchdog.received(0)
    voltages = [v for k in range(1, 500) if (v := watchdog.voltage(k)) is not None]
    assert voltages[-1] == -1.0
    off = new_watchdog(timeout=0)
    off.received(0)
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


def test_a_link_distinguishes_standstill_silence_and_rest() -> None:
    clock, watchdog = Clock(), new_watchdog()
    health = LinkHealth(Limits(), clock)

    def level(sample: int, active: bool = True) -> tuple[Level, str]:
        found = health.judge({'sample': sample, 'active': active}, {}, watchdog)
        return found.level, found.message

    assert level(-1) == (Level.OK, 'waits for the first tick')
    assert level(5) == (Level.OK, 'corrects the voltage')
    assert level(6, active=False) == (Level.OK, 'inactive: passes the voltage on')
    clock.now += SILENCE + 1.0
    assert level(6) == (Level.WARN, 'no tick for 3 s: the loop has stopped')
    watchdog.received(6)
    watchdog.voltage(17)
    words = 'no input since tick 6: the voltage is ramped to safety'
    assert level(6) == (Level.ERROR, f'{words}; its sender has gone')
    paused = health.judge({'sample': 6, 'active': True}, {}, watchdog, paused=True)
    assert (paused.level, paused.message[: len(words)]) == (Level.WARN, words)


def test_a_reference_beyond_the_stroke_is_reported() -> None:
    health = LinkHealth(Limits(), Clock())
    numbers = {'sample': 5, 'active': True}
    health.judge(numbers, {'out_of_stroke': 0}, new_watchdog())
    judged = health.judge(numbers, {'out_of_stroke': 7}, new_watchdog())
    assert judged.level == Level.WARN
    assert 'beyond the stroke' in judged.message


def test_a_voltage_whose_reference_never_comes_does_not_block_the_book() -> None:
    book: SampleSynchronizer[str] = SampleSynchronizer()
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


@pytest.mark.parametrize('ahead', [3, 64, 900, 10**6])
def test_strays_between_genuine_messages_never_make_a_jump(ahead: int) -> None:
    intake = SequenceFilter()
    for k in range(50):
        assert intake.take(k)
        assert not intake.take(k + ahead)
    assert intake.take(50)
    assert intake.newest == 50
    assert intake.counters()['strays'] == 50
