"""The parts of the simulator node that know no ROS."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest

from piezo_sim.nodes.pacing import CommandQueue, Pace

DT = 1e-3


def test_each_command_is_counted_once() -> None:
    book = CommandQueue(-1.0, 1.0)
    book.arrive(0, 0.5, tick=0)
    book.arrive(0, 0.6, tick=1)
    book.arrive(1, 0.7, tick=3)
    book.arrive(4, math.nan, tick=4)
    book.arrive(5, 1.1, tick=5)
    book.arrive(6, 0.1, tick=5)
    assert book.wanted == 0.7
    assert book.counts == {
        'late': 1, 'missed': 0, 'refused': 3, 'doubled': 1, 'timeouts': 0, 'overruns': 0,
        'slew_limited': 0, 'stamp_jumps': 0,
    }  # fmt: skip


def test_silence_is_missed_ticks_and_then_one_timeout() -> None:
    book = CommandQueue(-1.0, 1.0, safe_voltage=0.2, ramp=100.0)
    book.hold(0, DT, timeout=0.01)
    assert book.counts['missed'] == 0
    book.arrive(1, 0.9, tick=1)
    voltages = []
    for tick in range(1, 40):
        book.hold(tick, DT, timeout=0.01)
        voltages.append(book.voltage)
    assert book.counts['missed'] == 10
    assert book.counts['timeouts'] == 1
    assert voltages[:11] == [0.9] * 11
    assert voltages[-1] == 0.2
    assert max(abs(b - a) for a, b in pairwise(voltages)) <= 0.1 + 1e-12
    book.arrive(40, 0.3, tick=40)
    book.hold(40, DT, timeout=0.01)
    assert book.voltage == 0.3


def test_commands_that_jump_are_applied_no_faster_than_the_slew() -> None:
    book = CommandQueue(-1.0, 1.0, safe_voltage=-1.0, ramp=1e6, slew=50.0)
    voltages = [0.0]
    for tick in range(100):
        if tick < 50:
            book.arrive(tick, 1.0 if tick < 10 else -1.0, tick)
        book.hold(tick, DT, timeout=0.01)
        voltages.append(book.voltage)
    assert max(abs(b - a) for a, b in pairwise(voltages)) <= 0.05 + 1e-12
    assert max(voltages) == pytest.approx(0.5)
    assert voltages[-1] == -1.0
    assert book.counts['slew_limited'] > 30
    book.rest()
    assert book.voltage == 0.0


def test_commands_of_a_link_that_was_held_up_do_not_act() -> None:
    book = CommandQueue(-1.0, 1.0, timeout=10.0)
    book.arrive(0, 0.1, tick=0)
    for sample in range(1, 41):
        book.arrive(sample, 0.01 * sample, tick=50)
    book.follow(DT)
    assert book.voltage == pytest.approx(0.4)  # the newest, ten ticks late
    book.arrive(41, 0.9, tick=60)
    book.follow(DT)
    assert book.voltage == pytest.approx(0.4)
    assert book.counts['late'] == 41


def test_refused_commands_do_not_keep_the_watch_quiet() -> None:
    book = CommandQueue(-1.0, 1.0, safe_voltage=0.0, ramp=1000.0)
    book.arrive(0, 0.9, tick=0)
    for tick in range(1, 20):
        book.arrive(tick, math.nan, tick)
        book.hold(tick, DT, timeout=0.01)
    assert book.voltage == 0.0


def test_ticks_are_due_at_their_time_at_any_speed() -> None:
    pace = Pace(1000.0, 2.0)
    pace.restart(10.0, 100)
    assert pace.due(10.0) == 100
    assert pace.due(10.0 + 5.2 * pace.interval) == 105
    assert pace.interval == pytest.approx(0.5e-3)


@pytest.mark.parametrize('ahead', [1, 7, 64, 900, 5000])
def test_a_stray_command_ahead_is_not_applied_and_hides_none(ahead: int) -> None:
    book = CommandQueue(-1.0, 1.0, timeout=10.0)
    for tick in range(10):
        if tick == 5:
            book.arrive(tick + ahead, 1.0, tick)
        book.arrive(tick, 0.01 * tick, tick)
        book.hold(tick, DT, timeout=0.01)
        assert book.voltage == 0.01 * tick
    assert book.counts['refused'] == 1


@pytest.mark.parametrize('slew', [0.0, -5.0, -math.inf, math.inf, math.nan])
def test_what_is_no_slew_limit_leaves_the_one_in_force(slew: float) -> None:
    book = CommandQueue(-1.0, 1.0, slew=100.0)
    assert book.limit(50.0)
    assert not book.limit(slew)
    book.accept(1.0)
    book.follow(DT)
    assert book.voltage == pytest.approx(0.05)
    assert book.limit(80.0)  # the commanding node may raise its own
    book.follow(DT)
    assert book.voltage == pytest.approx(0.13)
