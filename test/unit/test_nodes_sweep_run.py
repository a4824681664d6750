"""A sweep and its recorders: nobody misses a record, whenever they come, stop or lose some."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
import pytest

from piezo_hysteresis.runtime.consumer_progress import Progress, Taken
from piezo_hysteresis.runtime.sweep_plan import Sweep, SweepRecord, narrowed, parse_options
from piezo_hysteresis.runtime.sweep_run import MOST_REPEATS, Kept, Pause, SweepRun, kept_message

RATE = 1000.0
TICKS = 50
GAP = 100


@dataclass
class Recorder:
    """What a recorder holds, and what it has told of that."""

    taken: Taken = field(default_factory=Taken)
    known: Progress = field(default_factory=Progress)
    deaf: bool = False

    def tell(self) -> None:
        if not self.deaf:
            counts = {'written': 0, **self.taken.counts()}
            self.known.receive(list(counts), list(counts.values()))


class World:
    """An actuator, its sweep and its recorders; ticks are numbered and stamped alike."""

    def __init__(self, *names: str, paced: bool = False) -> None:
        self.sweep = Sweep([10.0, 20.0], [1.0], TICKS / RATE, RATE)
        self.recorders = {name: Recorder() for name in names}
        for recorder in self.recorders.values():
            recorder.tell()
        self.said: list[tuple[str, str, int]] = []
        self.late: Callable[[int], int] = lambda sample: 0
        self.tick = 0
        self.voltages: list[float] = []
        self.run = SweepRun(self.sweep, self)
        self.run.paced = paced
        self.sweep.start(0)

    # As the markers see it.

    def edge_at(self, sample: int) -> int:
        return 1000 * sample + self.late(self.tick)

    def mark(self, record: SweepRecord, sample: int) -> int:
        return self._say(record.name, 'begins', sample)

    def end(self, judged: str, verdict: str, sample: int) -> int:
        return self._say(judged, verdict or 'ends', sample)

    def keepers(self) -> Mapping[str, Progress]:
        return {name: each.known for name, each in self.recorders.items() if each.known.keeps}

    def _say(self, name: str, what: str, sample: int) -> int:
        self.said.append((name, what, sample))
        for recorder in self.recorders.values():
            recorder.taken.marker(self.edge_at(sample))
        return self.edge_at(sample)

    # As time goes on.

    def step(self) -> float | Pause:
        """One answer of the sweep; what it commands is recorded."""
        voltage = self.run.step(self.tick)
        if not isinstance(voltage, Pause):
            self.voltages.append(voltage)
            for recorder in self.recorders.values():
                recorder.taken.state(self.tick)
            self.tick += 1
        return voltage

    def hear(self) -> None:
        for recorder in self.recorders.values():
            recorder.tell()

    def to(self, tick: int) -> None:
        while self.tick < tick:
            assert self.step() is not Pause.OVER
            self.hear()

    def finish(self, most: int = 5000) -> list[Kept]:
        for _ in range(most):
            if self.step() is Pause.OVER:
                return self.run.kept
            self.hear()
        raise AssertionError(f'it still waits for {self.run.awaited}')


NAMES = ['sine_10Hz_1V', 'sine_20Hz_1V']
LENGTH = 2 * (TICKS + GAP)


def test_without_recorders_nothing_waits_and_nothing_is_claimed() -> None:
    world = World()
    kept = world.finish()
    assert world.voltages == [world.sweep.voltage(k) for k in range(LENGTH)]
    assert [record.by for record in kept] == [(), ()]
    assert kept_message(kept) == '2 records, confirmed by no recorder'


def test_a_recorder_in_lock_step_changes_no_tick_and_has_every_record() -> None:
    world = World('/a', '/b')
    assert world.step() is Pause.HOLD  # the marker is out, nobody has confirmed
    assert world.run.awaited == '/a, /b to confirm the marker of record sine_10Hz_1V'
    world.recorders['/a'].tell()
    assert world.step() is Pause.HOLD
    kept = world.finish()
    assert world.voltages == [world.sweep.voltage(k) for k in range(LENGTH)]
    assert [(r.name, r.last) for r in kept] == list(zip(NAMES, (TICKS, LENGTH - GAP), strict=True))
    assert kept_message(kept) == '2 records, recorded by /a, /b'
    assert [what for _, what, _ in world.said] == ['begins', 'ends'] * 2


def test_who_does_not_confirm_the_end_holds_the_next_record_up() -> None:
    world = World('/a')
    world.to(10)
    world.recorders['/a'].deaf = True
    while not isinstance(world.step(), Pause):
        pass
    assert world.tick == TICKS + GAP
    assert 'the end of record sine_10Hz_1V' in world.run.awaited
    world.recorders['/a'].deaf = False
    world.hear()
    assert kept_message(world.finish()) == '2 records, recorded by /a'


def test_who_comes_in_the_middle_of_a_record_gets_all_of_it() -> None:
    world = World()
    world.to(20)
    world.recorders['/late'] = Recorder()
    world.hear()
    kept = world.finish()
    assert kept_message(kept) == '2 records, recorded by /late'
    assert world.said[:2] == [(NAMES[0], 'begins', 0), (NAMES[0], 'repeated', 20)]
    assert np.abs(np.diff(world.voltages)).max() < 2 * np.pi * 20.0 / RATE
    first = world.said[2][2]
    record = world.sweep.records[0].voltages
    np.testing.assert_array_equal(world.voltages[first : first + TICKS], record)


def test_who_comes_while_a_marker_waits_hears_it_too() -> None:
    world = World('/a')
    assert world.step() is Pause.HOLD
    world.recorders['/b'] = Recorder()
    world.hear()
    assert kept_message(world.finish()) == '2 records, recorded by /a, /b'
    assert world.said[0] == world.said[1]


@pytest.mark.parametrize('paced', [False, True])
def test_a_record_of_which_a_sample_is_lost_is_run_again(paced: bool) -> None:
    world = World('/a', paced=paced)
    while len(world.said) < 1 or world.tick < world.said[0][2] + 20:
        world.step()
        world.hear()
    world.recorders['/a'].taken.state(world.tick - 1, kept=False)
    kept = world.finish()
    assert kept_message(kept) == '2 records, recorded by /a'
    assert [name for name, what, _ in world.said if what == 'repeated'] == [NAMES[0]]


def test_who_loses_all_the_time_is_given_up_and_the_result_says_so() -> None:
    world = World('/a', '/bad')

    def lose() -> None:
        world.recorders['/bad'].taken.state(world.tick - 1, kept=False)

    while (answer := world.step()) is not Pause.OVER:
        if world.voltages and not isinstance(answer, Pause) and world.tick % 40 == 0:
            lose()
        world.hear()
    assert [what for _, what, _ in world.said].count('repeated') == 2 * MOST_REPEATS
    assert {record.by for record in world.run.kept} == {('/a',)}


def test_who_leaves_takes_no_record_with_it() -> None:
    world = World('/a', '/b')
    world.to(20)
    del world.recorders['/b']
    kept = world.finish()
    assert kept_message(kept) == '2 records, recorded by /a'
    world = World('/a')
    world.to(TICKS + GAP + 10)
    del world.recorders['/a']
    assert kept_message(world.finish()) == '2 records: sine_10Hz_1V by /a, sine_20Hz_1V by nobody'


def test_an_actuator_with_its_own_pace_rests_until_the_marker_is_confirmed() -> None:
    world = World('/a', paced=True)
    world.recorders['/a'].deaf = True
    while len([s for s in world.said if s[1] == 'begins']) < 3:
        assert world.step() == 0.0
    moved = [event for event in world.said if event[1] == 'moved']
    assert [what for _, what, _ in world.said] == ['begins', 'moved', 'begins', 'moved', 'begins']
    assert moved[1][2] - moved[0][2] == 2 * moved[0][2]  # twice as far ahead
    world.recorders['/a'].deaf = False
    world.hear()
    kept = world.finish()
    assert kept_message(kept) == '2 records, recorded by /a'
    for record, (_, _, first) in zip(
        world.sweep.records, [s for s in world.said if s[1] == 'begins'][-2:], strict=True
    ):
        np.testing.assert_array_equal(world.voltages[first : first + TICKS], record.voltages)


def test_a_clock_that_goes_otherwise_moves_the_marker_to_the_first_sample() -> None:
    world = World('/a', paced=True)
    world.late = lambda tick: tick // 7  # the stamps of the driver drift
    kept = world.finish()
    assert kept_message(kept) == '2 records, recorded by /a'
    starts = [k for k, event in enumerate(world.said) if event[1] == 'begins']
    assert [world.said[k + 1][1] for k in starts] == ['moved', 'ends', 'moved', 'ends']
    for k in starts[::2]:
        assert world.said[k][2] == world.said[k + 2][2]


def test_what_was_cancelled_does_not_count() -> None:
    world = World('/a')
    world.to(TICKS + GAP + 10)
    world.run.stop(world.tick)
    kept = world.finish()
    assert kept_message(kept) == '1 record, recorded by /a'
    assert world.said[-1] == (NAMES[1], 'cancelled', TICKS + GAP + 10)
    assert world.voltages[-1] == 0.0


def test_what_was_refused_is_taken_back() -> None:
    world = World('/a')
    world.to(TICKS + GAP + 10)
    world.run.take_back(TICKS, world.tick, 'refused')  # the last good tick lies behind it
    assert len(world.run.kept) == 1
    world.run.take_back(TICKS - 1, world.tick, 'refused')
    assert world.run.kept == []
    assert world.said[-1] == (NAMES[0], 'refused', TICKS + GAP + 10)
    world.run.stop(world.tick, 'refused')
    assert world.said[-1] == (NAMES[1], 'refused', TICKS + GAP + 10)
    assert kept_message(world.finish()) == '0 records'


def test_a_marker_that_nobody_confirmed_is_ended_by_a_cancel() -> None:
    world = World('/a')
    assert world.step() is Pause.HOLD
    world.run.stop(world.tick)
    assert world.run.awaited == ''
    assert world.finish() == []
    assert world.said[-1] == (NAMES[0], 'cancelled', 0)


def test_samples_without_a_gap_are_known_by_their_ends() -> None:
    taken, known = Taken(), Progress()

    def hear() -> None:
        counts = taken.counts()
        known.receive(list(counts), list(counts.values()))

    hear()
    assert known.takes
    assert not known.keeps
    assert known.holds(0, 5) is None
    for sample in (5, 6, 6, 7):
        taken.state(sample)
    hear()
    assert known.holds(5, 7) is True
    assert known.holds(4, 7) is False
    assert known.holds(5, 8) is None
    taken.state(9)
    hear()
    assert known.holds(5, 9) is False
    assert known.holds(9, 9) is True
    taken.marker(77)
    taken.marker(78, kept=False)
    hear()
    assert (known.taken, known.marked, known.edge) == (5, 1, 77)


def test_a_drive_out_of_range_is_told_what_would_fit() -> None:
    said = narrowed(-48.0, 48.0, 0.0, 100.0)
    assert 'offset of 50 V (options "{offset: 50}"' in said
    assert 'smaller amplitude' in narrowed(-80.0, 80.0, 0.0, 100.0)
    shifted = Sweep([5.0], [48.0], 0.5, 1000.0, options=parse_options('{offset: 50}'))
    assert 0.0 <= shifted.extremes[0] < shifted.extremes[1] <= 100.0
