"""A sweep tick by tick: its markers, and that a record of which a state was lost is run again."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

from piezo_hysteresis.errors import PiezoError, RecordError
from piezo_hysteresis.runtime.consumer_progress import Progress
from piezo_hysteresis.runtime.sweep_plan import (
    MOST_REPEATS,
    Sweep,
    SweepRecord,
    SweepRun,
    kept_message,
    narrowed,
    parse_options,
)

RATE = 1000.0
TICKS = 50
GAP = 100
NAMES = ['sine_10Hz_1V', 'sine_20Hz_1V']
LENGTH = 2 * (TICKS + GAP)


class World:
    """An actuator and its sweep, whose states all are heard but those that a test loses."""

    def __init__(self, *, recorded: bool = True) -> None:
        self.sweep = Sweep([10.0, 20.0], [1.0], TICKS / RATE, RATE)
        self.said: list[tuple[str, str, int]] = []
        self.tick = 0
        self.moves = True
        self.voltages: list[float] = []
        self.run = SweepRun(self.sweep, self, recorded=recorded)
        self.sweep.start(0)

    def mark(self, record: SweepRecord, sample: int) -> None:
        self.said.append((record.name, 'begins', sample))

    def end(self, judged: str, verdict: str, sample: int) -> int:
        self.said.append((judged, verdict or 'ends', sample))
        return sample

    def step(self, *, heard: bool = True, kept: bool = True) -> float | None:
        """One answer of the sweep, and the state that it brings about."""
        voltage = self.run.step(self.tick)
        if voltage is not None:
            self.voltages.append(voltage)
            if heard:
                self.run.add_state(self.tick, voltage if self.moves else 0.0, kept=kept)
            self.tick += 1
        return voltage

    def to(self, tick: int) -> None:
        while self.tick < tick:
            assert self.step() is not None

    def finish(self, most: int = 5000) -> list[str]:
        for _ in range(most):
            if self.step() is None:
                return [each.record.name for each in self.run.kept]
        raise AssertionError('it does not end')

    def message(self, bag: str = '') -> str:
        return kept_message(self.run, bag)


@pytest.mark.parametrize('recorded', [False, True])
def test_a_sweep_is_as_planned_and_its_markers_are_at_its_ticks(recorded: bool) -> None:
    world = World(recorded=recorded)
    assert world.finish() == NAMES
    assert world.voltages == [world.sweep.voltage(k) for k in range(LENGTH)]
    assert [each.last for each in world.run.kept] == [TICKS, LENGTH - GAP]
    second = TICKS + GAP
    assert world.said == [
        (NAMES[0], 'begins', 0), ('', 'ends', TICKS),
        (NAMES[1], 'begins', second), ('', 'ends', second + TICKS),
    ]  # fmt: skip
    assert world.message() == '2 records'
    assert world.message('/bags/a') == '2 records in /bags/a'


@pytest.mark.parametrize('recorded', [False, True])
def test_a_record_that_moved_nothing_is_run_again_and_does_not_count(recorded: bool) -> None:
    world = World(recorded=recorded)
    world.moves = False
    assert world.finish() == []
    assert world.message() == (
        '0 records; in sine_10Hz_1V, sine_20Hz_1V the actuator did not change its voltage: check '
        'that it takes voltage/command'
    )
    late = World(recorded=recorded)
    late.moves = False
    late.to(TICKS + 1)
    late.moves = True
    assert sorted(late.finish()) == NAMES


@pytest.mark.parametrize('lost', [{'heard': False}, {'kept': False}])
@pytest.mark.parametrize('tick', [0, 20, TICKS - 1])
def test_a_record_of_which_a_state_is_lost_is_run_again(lost: dict[str, bool], tick: int) -> None:
    world = World()
    world.to(tick)
    world.step(**lost)
    assert world.finish() == NAMES
    second = TICKS + GAP
    assert world.said[:4] == [
        (NAMES[0], 'begins', 0), ('', 'ends', TICKS), (NAMES[0], 'repeated', second),
        (NAMES[0], 'begins', second),
    ]  # fmt: skip
    assert np.abs(np.diff(world.voltages)).max() < 2 * np.pi * 20.0 / RATE
    again = world.voltages[second : second + TICKS]
    np.testing.assert_array_equal(again, world.sweep.records[0].voltages)


def test_states_lost_between_records_or_without_a_bag_are_no_matter() -> None:
    world = World()
    world.to(TICKS + 3)
    world.step(heard=False)
    assert world.finish() == NAMES
    assert len(world.said) == 4
    world = World(recorded=False)
    world.to(10)
    world.step(heard=False)
    assert world.finish() == NAMES
    assert len(world.said) == 4


@pytest.mark.parametrize('tick', [1, 20, TICKS + 10, TICKS + GAP + 1])
@pytest.mark.parametrize('skipped', [TICKS + GAP, 2 * LENGTH, 1_000_000])
def test_records_that_begin_or_end_in_ticks_that_never_came_are_run_again(
    tick: int, skipped: int
) -> None:
    """As if the first state that a new node received was far older than the next one."""
    world = World()
    world.to(tick)
    before = world.voltages[-1]
    world.tick += skipped
    assert world.finish() == NAMES
    assert abs(world.voltages[tick] - before) < 2 * np.pi * 20.0 / RATE
    for kept in world.run.kept:
        first = kept.first - skipped
        np.testing.assert_array_equal(
            world.voltages[first : first + TICKS] if first >= tick else kept.record.voltages,
            kept.record.voltages,
        )


def test_a_record_with_repeated_losses_is_aborted_and_reported() -> None:
    world = World()
    while world.step(heard=not (world.tick % 10 == 0 and world.tick < 700)) is not None:
        pass
    verdicts = [what for name, what, _ in world.said if name == NAMES[0] and what != 'begins']
    assert verdicts == ['repeated'] * MOST_REPEATS + ['failed']
    assert world.message() == f'1 record; states of {NAMES[0]} were lost'


def test_what_was_cancelled_does_not_count() -> None:
    world = World()
    world.to(TICKS + GAP + 10)
    world.run.stop(world.tick)
    assert world.finish() == NAMES[:1]
    assert world.said[-1] == (NAMES[1], 'cancelled', TICKS + GAP + 10)
    assert world.voltages[-1] == 0.0


def test_what_was_refused_is_taken_back() -> None:
    world = World()
    world.to(TICKS + GAP + 10)
    world.run.take_back(TICKS, world.tick, 'refused')  # the last good tick lies behind it
    assert len(world.run.kept) == 1
    world.run.take_back(TICKS - 1, world.tick, 'refused')
    assert world.run.kept == []
    assert world.said[-1] == (NAMES[0], 'refused', TICKS + GAP + 10)
    world.run.stop(world.tick, 'refused')
    assert world.said[-1] == (NAMES[1], 'refused', TICKS + GAP + 10)
    assert world.finish() == []


def test_the_status_of_a_listener_is_read_by_name() -> None:
    known = Progress()
    assert not known.takes
    known.receive(['taken', 'marked'], [3, 1])
    assert known.takes
    assert not known.keeps
    known.receive(['written', 'taken', 'marked'], [4, 3, 1])
    assert known.keeps
    assert (known.taken, known.marked) == (3, 1)


def test_a_drive_out_of_range_is_refused_with_the_range() -> None:
    said = narrowed(-48.0, 48.0, 0.0, 100.0)
    assert 'offset of 50 V (options "{offset: 50}"' in said
    assert 'smaller amplitude' in narrowed(-80.0, 80.0, 0.0, 100.0)
    shifted = Sweep([5.0], [48.0], 0.5, 1000.0, options=parse_options('{offset: 50}'))
    assert 0.0 <= shifted.extremes[0] < shifted.extremes[1] <= 100.0


def test_a_record_beyond_what_was_written_does_not_count() -> None:
    world = World()
    world.finish()
    first, second = world.run.kept
    assert world.run.drop_unwritten(second.queued) == []
    assert world.run.drop_unwritten(second.queued - 1) == NAMES[1:]
    assert [each.record.name for each in world.run.kept] == NAMES[:1]
    assert world.run.drop_unwritten(first.queued - 1) == NAMES[:1]
    assert world.run.kept == []


@pytest.mark.parametrize(
    ('changes', 'word'),
    [({'frequencies': [1.0] * 2000}, 'records'), ({'warm_up': 5.0}, 'warm-up')],
)
def test_a_goal_that_cannot_be_planned_is_refused(changes: dict[str, object], word: str) -> None:
    goal = {'frequencies': [1.0], 'amplitudes': [1.0], 'seconds': 2.0, 'rate': 1000.0, **changes}
    with pytest.raises(RecordError, match=word):
        Sweep(**goal)  # type: ignore[arg-type]


FIELDS = ('frequencies', 'amplitudes', 'seconds', 'rate', 'warm_up', 'pause')


@pytest.mark.parametrize('name', FIELDS)
@pytest.mark.parametrize('number', [math.nan, math.inf, -math.inf, -1.0, 1e300, 1.7e308])
def test_a_field_of_a_goal_without_sense_is_named(name: str, number: float) -> None:
    lists = name in ('frequencies', 'amplitudes')
    goal = {'frequencies': [1.0], 'amplitudes': [1.0], 'seconds': 2.0, 'rate': 1000.0}
    with pytest.raises(PiezoError) as refused:
        Sweep(**{**goal, name: [1.0, number] if lists else number})  # type: ignore[arg-type]
    refusal = str(refused.value)
    named = {'warm_up': 'warm.up', 'frequencies': 'frequenc', 'rate': 'rate|samples'}
    assert re.search(named.get(name, name), refusal), refusal
    assert '\n' not in refusal
