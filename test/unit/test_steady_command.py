"""Commands that come late leave no step behind that is faster than what was planned."""

import numpy as np
import pytest

from piezo_hysteresis.runtime.steady_command import SteadyCommand

RATE = 1000.0
PLAN = np.concatenate([np.sin(2 * np.pi * 100.0 * np.arange(3000) / RATE), np.zeros(200)])
FASTEST = float(np.abs(np.diff(PLAN)).max())


def driven(steady, delays, echo=lambda voltage: voltage, usual=0):
    """Return what an actuator applies that keeps its own pace, tick by tick.

    The state of tick k is answered `delays[k]` ticks later, in order; a command acts from the
    first tick on after its arrival, or `usual` ticks after that.
    """
    applied, sent, free = [0.0], [], 0.0
    for k, delay in enumerate(delays[: PLAN.size - 1]):
        free = max(free, k + delay)
        while len(applied) <= free:
            acting = [command for arrival, command in sent if arrival < len(applied)]
            applied.append(acting[-1] if acting else 0.0)
        steady.hear(k, echo(applied[k]))
        sent = [*sent[-200:], (free + usual, steady.next(k + 1, PLAN[k + 1]))]
    return np.array(applied)


def starved(seed: int) -> np.ndarray:
    """Return delays of a machine that is away for some ticks now and then [ticks]."""
    rng = np.random.default_rng(seed)
    delays = rng.uniform(0.2, 0.8, PLAN.size)
    for at in rng.integers(200, 2900, 25):
        delays[at] = rng.uniform(1.2, 60.0)
    return delays


class Unbounded(SteadyCommand):
    """As it was before: every tick gets what was planned for it."""

    def next(self, sample, planned):
        return planned


@pytest.mark.parametrize('seed', range(6))
def test_no_step_is_faster_than_the_plan_where_commands_come_late(seed):
    steady = SteadyCommand(RATE)
    applied = driven(steady, starved(seed))
    assert np.abs(np.diff(applied)).max() <= FASTEST * (1 + 1e-6)
    assert steady.eased > 0
    assert applied[-1] == 0.0
    # without it the same delays do move it faster
    before = driven(Unbounded(RATE), starved(seed))
    assert np.abs(np.diff(before)).max() > 1.5 * FASTEST


def test_commands_in_time_are_those_of_the_plan():
    steady = SteadyCommand(RATE)
    applied = driven(steady, np.full(PLAN.size, 0.5))
    np.testing.assert_array_equal(applied, PLAN[: applied.size])
    assert steady.eased == 0
    assert not steady.behind


@pytest.mark.parametrize(
    ('echo', 'usual'),
    [
        (lambda voltage: voltage + np.random.default_rng(1).normal(0.0, 0.05), 0),
        (lambda voltage: 0.97 * voltage, 0),
        (lambda voltage: voltage, 1),
    ],
    ids=['noise', 'gain', 'always a tick late'],
)
def test_an_actuator_that_does_not_say_what_it_applied_in_time_gets_the_plan(echo, usual):
    steady = SteadyCommand(RATE)
    driven(steady, np.full(PLAN.size, 0.5), echo, usual)
    assert steady.eased == 0


def test_a_planned_jump_is_a_jump_and_another_plan_begins_anew():
    steady, voltage = SteadyCommand(RATE), 0.0
    for k in range(200):
        steady.hear(k, voltage)
        voltage = steady.next(k + 1, 0.001 * (k + 1))
    steady.hear(200, voltage)
    assert steady.next(201, 5.0) == 5.0
    steady.hear(201, 5.0)
    steady.begin()
    assert steady.next(202, -5.0) == -5.0
    # what is held is caught up with as fast as the new plan goes, and not the old one
    steady.hear(202, -5.0)
    assert steady.next(203, -4.9) == -4.9
    steady.hear(203, -5.0)
    assert steady.next(204, -4.8) == pytest.approx(-4.9)
    assert steady.behind


def test_an_actuator_that_takes_no_commands_is_not_waited_for_for_ever():
    steady, voltage = SteadyCommand(RATE), 0.0
    for k in range(500):
        steady.hear(k, voltage)
        voltage = steady.next(k + 1, 0.001 * (k + 1))
    for k in range(500, 1700):
        steady.hear(k, 0.5)
        last = steady.next(k + 1, 1.0 if k < 1000 else 0.0)
    assert last == 0.0
    assert not steady.behind
