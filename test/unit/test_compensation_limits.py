"""Limits of links; commands that come late leave no step that is faster than allowed."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from piezo_hysteresis.compensation.limiter import EnergyLimits, Limiter
from piezo_hysteresis.compensation.link import Limits, Measured, ReferencePoint, Transition
from piezo_hysteresis.compensation.offline_loop import (
    closed_loop,
    reference_points,
    tracking_metrics,
)
from piezo_hysteresis.errors import CompensationError
from piezo_hysteresis.runtime.excitation_plan import SteadyCommand
from piezo_hysteresis.waveforms.sine import Sine

DT = 1e-3


def test_limiter_clamps_range_and_slew_and_counts() -> None:
    limiter = Limiter(Limits(-1.0, 2.0, 500.0), DT)
    assert limiter.apply(0.4) == 0.4
    assert limiter.apply(5.0) == pytest.approx(0.9)
    for _ in range(10):
        limiter.apply(5.0)
    assert limiter.voltage == 2.0
    assert limiter.counters() == {
        'not_finite': 0, 'out_of_range': 11, 'slew_limited': 3, 'energy_limited': 0,
    }  # fmt: skip


def test_the_limits_themselves_are_within_the_range() -> None:
    limiter = Limiter(Limits(-1.0, 2.0, 1e4), DT)
    assert [limiter.apply(each) for each in (2.0, -1.0)] == [2.0, -1.0]
    assert not any(limiter.counters().values())


@pytest.mark.parametrize('bad', [math.nan, math.inf, -math.inf])
def test_limiter_holds_the_last_safe_voltage_for_what_is_no_number(bad: float) -> None:
    limiter = Limiter(Limits(), DT)
    limiter.apply(0.3)
    assert limiter.apply(bad) == 0.3
    assert limiter.counters()['not_finite'] == 1


def test_ramp_to_rest_arrives_and_stays_within_the_slew() -> None:
    limiter = Limiter(Limits(-1.0, 1.0, 100.0), DT, voltage=0.95)
    path = [limiter.ramp_to(0.0, 20.0) for _ in range(80)]
    assert np.max(np.abs(np.diff([0.95, *path]))) <= 0.02 + 1e-12
    assert path[-1] == 0.0


def test_new_limits_bring_the_voltage_in_without_a_jump_and_keep_the_counts() -> None:
    limiter = Limiter(Limits(-1.0, 1.0, 500.0), DT)
    for _ in range(3):
        limiter.apply(1.0)
    limiter.retune(Limits(-0.2, 0.2, 100.0))
    path = [limiter.apply(1.0) for _ in range(10)]
    assert np.abs(np.diff([1.0, *path])).max() <= 0.1 + 1e-12
    assert path[-1] == 0.2
    assert limiter.counters()['slew_limited'] > 2
    with pytest.raises(CompensationError):
        limiter.retune(Limits(1.0, -1.0))
    assert limiter.apply(0.2) == 0.2


def test_mean_power_is_that_of_the_makers_formula() -> None:
    energy = EnergyLimits(power=0.0, capacitance=3e-6, window=1.0, supply=150.0)
    limiter = Limiter(Limits(-10.0, 140.0, 1e6), DT, energy=energy)
    for voltage in 60.0 - 50.0 * np.cos(2 * np.pi * 20.0 * DT * np.arange(8000)):
        limiter.apply(voltage)
    assert limiter.mean_power == pytest.approx(3e-6 * 20.0 * 150.0 * 100.0, rel=0.03)
    assert limiter.counters()['energy_limited'] == 0


def test_a_drive_beyond_the_energy_limit_is_slowed_down_smoothly_and_recovers() -> None:
    energy = EnergyLimits(power=0.2, capacitance=3e-6, window=1.0, supply=150.0)
    limiter = Limiter(Limits(-10.0, 140.0, 1e6), DT, voltage=10.0, energy=energy)
    wanted = 60.0 - 50.0 * np.cos(2 * np.pi * 20.0 * DT * np.arange(6000))
    got = np.array([limiter.apply(voltage) for voltage in wanted])
    np.testing.assert_array_equal(got[:60], wanted[:60])  # a burst is free
    assert limiter.counters()['energy_limited'] > 1000
    # What can be kept up is used: the limit is reached from below, and steps go over to it.
    steps = np.abs(np.diff(got)) / DT
    assert steps[-1000:].mean() == pytest.approx(energy.sustained_slew, rel=0.02)
    assert np.diff(steps[-1000:]).max() < 0.1 * np.abs(np.diff(wanted)).max() / DT
    for _ in range(5000):
        limiter.apply(got[-1])
    assert limiter.apply(got[-1] + 20.0) == pytest.approx(
        got[-1] + min(20.0, 11.0 * energy.sustained_slew * DT), rel=0.02
    )


def test_a_lowered_energy_limit_holds_while_the_mean_falls_to_it() -> None:
    energy = EnergyLimits(power=1.0, capacitance=3e-6, window=0.1, supply=150.0)
    limiter = Limiter(Limits(-10.0, 140.0, 1e6), DT, energy=energy)
    for k in range(500):
        limiter.apply(130.0 * (k % 2))
    lower = EnergyLimits(power=0.1, capacitance=3e-6, window=0.1, supply=150.0)
    limiter.retune(limiter.limits, lower)
    held = limiter.voltage
    assert limiter.mean_power > 0.9
    means = []
    for k in range(1000):
        voltage = limiter.apply(130.0 * (k % 2))
        means.append(limiter.mean_power)
        assert voltage == held or means[-1] < 0.11
    assert np.diff(means).max() <= 0.0
    assert means[-1] == pytest.approx(0.1, rel=0.01)


@pytest.mark.parametrize(
    'energy',
    [
        EnergyLimits(power=-1.0),
        EnergyLimits(power=math.nan),
        EnergyLimits(capacitance=0.0),
        EnergyLimits(window=0.005),
        EnergyLimits(supply=-1.0),
    ],
)
def test_impossible_energy_limits_are_refused(energy: Any) -> None:
    with pytest.raises(CompensationError):
        Limiter(Limits(), DT, energy=energy)


@pytest.mark.parametrize(
    'limits', [Limits(1.0, 1.0), Limits(slew=0.0), Limits(low=math.nan), Limits(high=math.inf)]
)
def test_impossible_limits_are_refused(limits: Any) -> None:
    with pytest.raises(CompensationError):
        Limiter(limits, DT)


def test_transition_begins_where_the_old_law_ended_and_keeps_to_the_slew() -> None:
    change = Transition(DT, duration=0.1, slew=5.0)
    change.apply(1.0)
    change.start()
    path = [change.apply(0.0) for _ in range(600)]
    assert path[0] == 1.0
    assert path[-1] == 0.0
    assert np.max(np.abs(np.diff(path))) <= 5.0 * DT * 1.001


class Spy:
    """A link that notes what it is given and adds a constant."""

    def __init__(self, share: Any) -> None:
        self.share = share
        self.seen: list[tuple[int, float, Measured | None]] = []

    def step(self, point: Any, received: Any, measured: Any = None) -> Any:
        self.seen.append((point.sample, received, measured))
        return received + self.share

    def counters(self) -> dict[Any, Any]:
        return {'steps': len(self.seen)}

    def reset(self) -> None:
        self.seen.clear()


class Doubling:
    """A plant that answers twice the voltage of the tick before."""

    def __init__(self) -> None:
        self.held = 0.0

    def exchange(self, voltage: Any) -> float:
        reading, self.held = 2.0 * self.held, voltage
        return reading


def test_closed_loop_gives_reference_k_and_measurement_k_minus_1() -> None:
    samples = Sine(1e-6, 10.0, 1.0).sample(np.arange(5.0) * DT)
    first, second = Spy(0.1), Spy(0.2)
    result = closed_loop(samples, [first, second], Doubling(), Limits(), DT)
    assert first.seen[0] == (0, 0.0, None)
    assert second.seen[3][1] == pytest.approx(0.1)
    assert second.seen[3][2] == Measured(2, result.voltage[2], result.displacement[2])
    np.testing.assert_allclose(result.voltage, 0.3)
    np.testing.assert_allclose(result.displacement, [0.0, 0.6, 0.6, 0.6, 0.6])
    assert result.counters['limiter']['not_finite'] == 0
    assert result.counters['0_spy'] == {'steps': 5}


def test_metrics_name_mean_rms_and_harmonics() -> None:
    n = 2000
    samples = Sine(0.0, 10.0, 2.0).sample(np.arange(n, dtype=np.float64) * DT)
    phase = samples.phase

    class Wave:
        def __init__(self) -> None:
            self.k = -1

        def exchange(self, voltage: Any) -> float:
            self.k += 1
            return 3e-6 + 2e-6 * math.cos(3 * phase[self.k] + 1.0)

    result = closed_loop(samples, [Spy(0.0)], Wave(), Limits(), DT)
    metrics = tracking_metrics(result, from_seconds=1.0)
    assert metrics.mean == pytest.approx(3e-6)
    assert metrics.rms_without_mean == pytest.approx(2e-6 / math.sqrt(2))
    assert metrics.rms == pytest.approx(math.hypot(3e-6, 2e-6 / math.sqrt(2)))
    assert metrics.harmonics[3] == pytest.approx(2e-6)
    assert metrics.harmonics[1] < 1e-12
    with pytest.raises(CompensationError):
        tracking_metrics(result, from_seconds=5.0)


def test_reference_points_are_numbered_from_the_first_tick() -> None:
    points = list(reference_points(Sine(1e-6, 10.0, 1.0).sample(np.arange(3.0) * DT), first=7))
    assert [point.sample for point in points] == [7, 8, 9]
    assert isinstance(points[0], ReferencePoint)


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
