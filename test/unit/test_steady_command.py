"""Commands that come late leave no step behind that is faster than what is allowed."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from piezo_hysteresis.runtime.excitation_plan import SteadyCommand

RATE = 1000.0
PLAN = np.concatenate([np.sin(2 * np.pi * 100.0 * np.arange(3000) / RATE), np.zeros(200)])
SLEW = 700.0


def driven(delays: np.ndarray, slew: Any = SLEW, limited: int = 0) -> Any:
    """Return what an actuator applies that keeps its own pace, and how much was held back.

    The state of tick k is answered `delays[k]` ticks later, in order; a command acts from the
    first tick on after its arrival.
    """
    steady = SteadyCommand(RATE, lambda: free / RATE)
    sent: list[tuple[float, float]] = []
    applied, free = [0.0], 0.0
    for k, delay in enumerate(delays[: PLAN.size - 1]):
        free = max(free, k + delay)
        while len(applied) <= free:
            acting = [command for arrival, command in sent if arrival < len(applied)]
            applied.append(acting[-1] if acting else 0.0)
        steady.update(k, applied[k])
        sent = [*sent[-200:], (free, steady.next(k + 1, PLAN[k + 1], slew))]
    return np.array(applied), steady.limited


def starved(seed: int, typical: float) -> np.ndarray:
    """Return delays of a machine that is away for some ticks now and then [ticks]."""
    rng = np.random.default_rng(seed)
    delays = rng.uniform(0.1, typical, PLAN.size)
    for at in rng.integers(200, 2900, 25):
        delays[at] = rng.uniform(1.2, 60.0)
    delays[3000:] = 0.5
    return delays


@pytest.mark.parametrize('typical', [0.9, 1.5, 3.0])
@pytest.mark.parametrize('seed', range(4))
def test_no_step_is_faster_than_allowed_where_commands_come_late(
    seed: Any, typical: float
) -> None:
    applied, limited = driven(starved(seed, typical))
    assert np.abs(np.diff(applied)).max() <= SLEW / RATE * (1 + 1e-6)
    assert limited > 0
    assert np.abs(applied).max() > 0.5
    assert applied[-1] == 0.0
    # without it the same delays do move it faster
    before, _ = driven(starved(seed, typical), slew=0.0)
    assert np.abs(np.diff(before)).max() > 1.5 * SLEW / RATE


def test_commands_in_time_are_those_of_the_plan() -> None:
    applied, limited = driven(np.full(PLAN.size, 0.5))
    np.testing.assert_array_equal(applied, PLAN[: applied.size])
    assert limited == 0


def test_a_held_voltage_continues_where_commands_return_to_it() -> None:
    """A command like the one that acts tells nothing of what was sent between the two."""
    now = 0.0
    steady = SteadyCommand(RATE, lambda: now)
    steady.update(0, 0.0)
    for k, planned in enumerate((0.5, 0.0)):
        steady.next(k + 1, planned, 700.0)
        steady.update(k + 1, 0.0)  # both came within one tick
    assert steady.next(3, -0.5, 700.0) == pytest.approx(-0.2)  # as if 0.5 V were to come yet
    now = 0.2
    steady.update(200, 0.0)
    assert steady.next(201, -0.5, 700.0) == -0.5


def test_of_two_commands_the_older_one_is_forgotten_once_it_must_have_come() -> None:
    now = 0.0
    steady = SteadyCommand(RATE, lambda: now)
    steady.update(0, 0.0)
    for k, planned in enumerate((0.5, 0.0)):
        steady.next(k + 1, planned, 700.0)
    steady.update(2, 0.0)
    now = 0.2
    steady.update(200, 0.0)
    assert steady.next(201, -0.5, 700.0) == -0.5


def test_a_jump_becomes_a_ramp_and_without_a_limit_stays_one() -> None:
    steady = SteadyCommand(RATE)
    steady.update(0, 0.0)
    assert steady.next(1, 5.0, 0.0) == 5.0
    steady.reset()
    steady.update(0, 0.0)
    assert steady.next(1, 5.0, 700.0) == pytest.approx(0.7)
    assert steady.behind
    steady.update(1, 0.7 * (1 + 1e-9))
    assert steady.next(2, 0.9, 700.0) == 0.9
    assert not steady.behind


def test_an_actuator_that_goes_its_own_way_is_met_where_it_is() -> None:
    steady = SteadyCommand(RATE)
    for k in range(10):
        steady.update(k, 0.1 * k)
        steady.next(k + 1, 0.1 * (k + 1), 700.0)
    steady.update(10, -3.0)  # it ramped to safety
    assert steady.next(11, 1.1, 700.0) == pytest.approx(-2.3)


def test_waiting_for_an_actuator_without_commands_ends() -> None:
    steady = SteadyCommand(RATE)
    for k in range(1500):
        steady.update(k, 2.0)
        last = steady.next(k + 1, 0.0, 700.0)
        assert k > 900 or last > 1.0
    assert last == 0.0
    assert not steady.behind
