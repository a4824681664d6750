"""Input and estimates of the identification node, without ROS."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import piezo_hysteresis as ph
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.identification.recursion import OnlineMethod
from piezo_hysteresis.models import ModelFile, named
from piezo_hysteresis.parameters.node_tables import IDENTIFICATION
from piezo_hysteresis.records import Record, RecordInfo
from piezo_hysteresis.runtime.identification_plan import (
    EVERY,
    KEPT,
    RecordSegmenter,
    SegmentEdge,
    forgetting_of,
    new_method,
)

RATE = 1000.0
MS = 1_000_000
DEFAULTS = {**IDENTIFICATION.defaults(), 'rate': RATE}


class Spy:
    """Notes what a course does with its method; as much of one as that takes."""

    forgetting = 1.0

    def __init__(self) -> None:
        self.did: list[object] = []

    def update(self, voltage: float, _displacement: float) -> float:
        self.did.append(voltage)
        return 0.0

    def rest(self) -> None:
        self.did.append('rest')

    def reset(self) -> None:
        self.did.append('reset')


def feed(course: RecordSegmenter, samples: list[int]) -> None:
    for k in samples:
        course.take(k, k * MS, float(k), 0.0)


def spied(only_records: bool = True) -> tuple[RecordSegmenter, list[object]]:
    spy = Spy()
    return RecordSegmenter(cast(OnlineMethod, spy), RATE, only_records), spy.did


def test_without_markers_everything_counts_once() -> None:
    course, did = spied()
    feed(course, [0, 1, 1, 0 + 1, 2, 3])
    assert did == [0.0, 1.0, 2.0, 3.0]


def test_markers_cut_by_their_time_however_early_they_come() -> None:
    course, did = spied()
    for nanoseconds, name in ((1 * MS, 'a'), (3 * MS, ''), (5 * MS, 'b')):
        course.mark(SegmentEdge(nanoseconds, name))
    course.mark(SegmentEdge(7 * MS, ''))
    feed(course, list(range(9)))
    assert did == [0.0, 'rest', 1.0, 2.0, 'rest', 'rest', 5.0, 6.0, 'rest']
    course.reset()
    feed(course, [9])
    assert did[-2:] == ['reset', 9.0]


class Tape(Spy):
    """A method whose copies know what they did themselves."""

    def __deepcopy__(self, memo: object) -> Tape:
        copy = Tape()
        copy.did = list(self.did)
        return copy


EDGES = [SegmentEdge(k * MS, name) for k, name in ((2, 'a'), (4, ''), (6, 'b'), (9, ''), (9, 'c'))]


def taped(order: list[int | SegmentEdge]) -> tuple[list[object], int]:
    """Let a course hear samples, by their number, and markers, in an order."""
    course = RecordSegmenter(cast(OnlineMethod, Tape()), RATE)
    for each in order:
        if isinstance(each, SegmentEdge):
            course.mark(each)
        else:
            feed(course, [each])
    assert isinstance(course.method, Tape)
    assert course.state.taken == sum(isinstance(each, float) for each in course.method.did)
    return course.method.did, course.late


@given(st.lists(st.integers(0, 14), min_size=len(EDGES), max_size=len(EDGES)))
def test_a_marker_that_comes_late_cuts_as_if_it_had_come_in_time(places: list[int]) -> None:
    order: list[int | SegmentEdge] = []
    for k in range(15):
        order += [edge for edge, place in zip(EDGES, sorted(places), strict=True) if place == k]
        order.append(k)
    assert taped(order)[0] == taped([*EDGES, *range(15)])[0]


@pytest.mark.parametrize('delay', [EVERY - 1, EVERY, EVERY + 1, (KEPT - 1) * EVERY])
def test_a_marker_may_be_seconds_late(delay: int) -> None:
    first, last = SegmentEdge(100 * MS, 'a'), SegmentEdge(3000 * MS, '')
    everything = range(KEPT * EVERY + 500)
    in_time = taped([first, last, *everything])
    late: list[int | SegmentEdge] = list(everything)
    late.insert(101 + delay, first)
    late.insert(max(3001, 102 + delay), last)
    assert taped(late) == in_time == (in_time[0], 0)


def test_a_marker_that_is_later_than_memory_acts_from_then_on() -> None:
    end = KEPT * EVERY + 10
    did, late = taped([*range(end), SegmentEdge(3 * MS, 'a'), end, end + 1])
    assert late == 1
    assert did == [*map(float, range(end)), 'rest', float(end), float(end + 1)]


def test_the_first_marker_of_a_bag_played_again_is_not_late() -> None:
    once: list[int | SegmentEdge] = [SegmentEdge(0, 'a'), 0, 1, 2, SegmentEdge(3 * MS, ''), 3]
    did, late = taped([*once, *once])
    assert late == 0
    assert did == ['rest', 0.0, 1.0, 2.0, 'rest', 'rest', 0.0, 1.0, 2.0, 'rest']


HOUR = 3_600_000 * MS


@pytest.mark.parametrize('wrong', [0, 2 * MS, 2 * HOUR, 9 * HOUR])
@pytest.mark.parametrize('place', [1, 3, 4, 5])
def test_a_stamp_that_jumps_cuts_nothing(wrong: int, place: int) -> None:
    """A sample belongs to the record of its index, for any time stamp."""
    course, did = spied()
    times = {k: 5 * HOUR + k * MS for k in range(8)}
    for k, name in ((2, 'a'), (4, ''), (6, 'b')):
        course.mark(SegmentEdge(times[k], name))
    for k, time in {**times, place: wrong}.items():
        course.take(k, time, float(k), 0.0)
    assert did == [0.0, 1.0, 'rest', 2.0, 3.0, 'rest', 'rest', 6.0, 7.0]
    assert course.stamps.jumps > 0


def test_a_number_of_another_actuator_cuts_nothing() -> None:
    course, did = spied()
    for k, name in ((2, 'a'), (4, '')):
        course.mark(SegmentEdge(k * MS, name))
    for k in range(6):
        course.take(k, k * MS, float(k), 0.0)
        assert not course.take(k + 10**6, k * MS, -1.0, 0.0)
    assert did == [0.0, 1.0, 'rest', 2.0, 3.0, 'rest']
    assert course.intake.counters()['strays'] == 5  # the last one may still be confirmed


def test_a_record_may_begin_at_any_number() -> None:
    course, did = spied()
    course.mark(SegmentEdge(5 * MS, 'a'))
    feed(course, [5, 6])
    course.mark(SegmentEdge(7 * MS, 'b'))
    for number, k in ((90_000, 7), (90_001, 8)):
        course.take(number, k * MS, float(k), 0.0)
    course.mark(SegmentEdge(5 * MS, 'a'))
    feed(course, [5, 6])
    assert did == ['rest', 5.0, 6.0, 'rest', 7.0, 8.0, 'rest', 5.0, 6.0]
    assert course.stamps.jumps == 0


def test_samples_between_records_count_where_wanted() -> None:
    course, did = spied(only_records=False)
    course.mark(SegmentEdge(1 * MS, 'a'))
    course.mark(SegmentEdge(2 * MS, ''))
    feed(course, list(range(4)))
    assert did == [0.0, 'rest', 1.0, 'rest', 2.0, 3.0]


def test_an_actuator_that_starts_anew_is_at_rest() -> None:
    course, did = spied()
    feed(course, [0, 1, 2, 0, 1])
    assert did == [0.0, 1.0, 2.0, 'rest', 0.0, 1.0]


def swept(
    method: str, seconds: float = 4.0, **settings: object
) -> tuple[RecordSegmenter, np.ndarray]:
    values = {**DEFAULTS, 'method': method, **settings}
    course = RecordSegmenter(new_method(values), RATE)
    model = named('classical')
    parameters = {**model.defaults(), 'A1': 1e-4, 'A': 3e-5, 'beta': 1.0, 'gamma': 0.2}
    time = np.arange(round(seconds * RATE)) / RATE
    voltage = np.sin(2 * np.pi * 5.0 * time)
    displacement = model.respond(voltage, model.pack(parameters), 1.0 / RATE)
    for k, (u, y) in enumerate(zip(voltage.tolist(), displacement.tolist(), strict=True)):
        course.take(k, k * MS, u, y)
    return course, displacement


@pytest.mark.parametrize(('method', 'limit'), [('rls_ud', 5e-3), ('pi_bank', 2e-2)])
def test_estimates_can_be_saved_and_simulated(method: str, limit: float, tmp_path: Path) -> None:
    course, displacement = swept(method)
    saved = course.model_file(f'{method}, online')
    saved.save(tmp_path / 'model.yaml')
    estimate = course.method.estimate()
    assert saved.provenance.rate == RATE
    for name, value in estimate.parameters().items():
        assert saved.values[name] == value
    assert course.free_run_rms(estimate) < limit * np.std(displacement)


def test_an_estimate_that_is_no_model_is_not_saved() -> None:
    course, _ = swept('rls')  # the papers' recursion has no bounds
    assert course.method.estimate().parameters()['beta'] < 0.0
    with pytest.raises(PiezoError, match='beta'):
        course.model_file('rls, online')


def test_a_free_run_of_rls_is_that_of_its_estimate() -> None:
    course, displacement = swept('rls', 1.5)
    estimate = course.method.estimate()
    time = np.arange(1500) / RATE
    free = course.method.free_run(np.sin(2 * np.pi * 5.0 * time))
    expected = float(np.sqrt(np.mean((free - displacement)[-1000:] ** 2)))
    assert course.free_run_rms(estimate) == pytest.approx(expected, rel=1e-9)


def test_an_estimate_settles() -> None:
    course, _ = swept('rls_ud', 3.0)
    assert not course.settled(course.method.estimate())
    assert course.settled(course.method.estimate())


def test_an_estimate_whose_free_run_is_no_model_has_not_settled() -> None:
    course, displacement = swept('rls_ud', 3.0)
    for free_run, settled in ((0.0, False), (0.0, True), (6e-4, False), (math.nan, False)):
        assert course.settled(course.method.estimate(), free_run) is settled
    assert course.settled(course.method.estimate(), 0.5 * float(np.std(displacement)))


def test_forgetting_zero_is_that_of_the_method() -> None:
    assert forgetting_of({**DEFAULTS, 'method': 'rls'}) == 1.0
    assert forgetting_of({**DEFAULTS, 'method': 'pi_bank'}) == 0.9999
    assert forgetting_of({**DEFAULTS, 'method': 'rls', 'forgetting': 0.99}) == 0.99


@pytest.mark.parametrize(
    'wrong',
    [
        {'harmonic': 4},
        {'harmonic': 3},
        {'forgetting': 0.3},
        {'method': 'rls_ud', 'natural_frequency': 600.0},
        {'harmonic': 3, 'frequency': 10.0, 'variant': 'V2'},
    ],
)
def test_settings_that_do_not_go_together_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(PiezoError):
        new_method({**DEFAULTS, **wrong})


def test_v0_is_a_model_without_a_harmonic_only() -> None:
    settings = {**DEFAULTS, 'variant': 'V0'}
    course = RecordSegmenter(new_method(settings), RATE)
    assert course.model_file('rls').model.name == 'extended_free'
    course = RecordSegmenter(new_method({**settings, 'harmonic': 3, 'frequency': 5.0}), RATE)
    with pytest.raises(PiezoError, match='V0 with a harmonic'):
        course.model_file('rls')


@pytest.mark.parametrize('harmonic', [3, 5])
def test_the_harmonic_belongs_to_its_named_model(harmonic: int) -> None:
    course, _ = swept('rls', 0.5, harmonic=harmonic, frequency=5.0)
    estimate = course.method.estimate()
    model = course.method.model()
    assert model is not None
    assert {*estimate.names, 'offset'} == set(model.parameter_names)  # no column of its own


DRIVES = ((10.0, 1.0), (23.0, 1.0), (10.0, 0.5))


def played_sweep(course: RecordSegmenter, *, late: bool = False) -> None:
    """Pass the records of `DRIVES` with 20 samples of rest before each, markers first or last."""
    k = 0
    for n, (frequency, amplitude) in enumerate(DRIVES):
        record = drive(frequency, amplitude)
        k += 20
        edges = (
            SegmentEdge(k * MS, f'r{n}', frequency, amplitude),
            SegmentEdge((k + len(record)) * MS, ''),
        )
        for edge in () if late else edges:
            course.mark(edge)
        for u, y in zip(record.voltage, record.displacement, strict=True):
            course.take(k, k * MS, float(u), float(y))
            k += 1
        for edge in edges if late else ():
            course.mark(edge)


def drive(frequency: float, amplitude: float) -> Record:
    """Return a record of a classical model whose gain depends on the frequency."""
    time = np.arange(1500) / RATE
    voltage = amplitude * np.sin(2 * np.pi * frequency * time)
    gain = 1e-4 * (1.0 + frequency / 20.0)
    plant = ModelFile.from_name('classical', A1=gain, A=0.3 * gain, beta=1.0, gamma=0.2)
    moved = plant.simulate(voltage, 1.0 / RATE)
    moved += 1e-9 * np.random.default_rng(0).standard_normal(time.size)
    info = RecordInfo(frequency=frequency, amplitude=amplitude)
    return Record(f'{frequency:g}Hz_{amplitude:g}V', 1.0 / RATE, voltage, moved, info=info)


@pytest.mark.parametrize('late', [False, True])
@pytest.mark.parametrize('method', ['rls', 'rls_ud'])
def test_each_drive_has_the_estimate_of_its_record_alone(method: str, late: bool) -> None:
    values = {**DEFAULTS, 'method': method, 'voltage_range': 1.0}
    course = RecordSegmenter(new_method(values), RATE, renew=lambda: new_method(values))
    played_sweep(course, late=late)
    saved = course.model_file('test')
    assert saved.schedule is not None
    assert {(p.frequency, p.amplitude) for p in saved.schedule.points} == set(DRIVES)
    for frequency, amplitude in DRIVES:
        alone = new_method(values)
        record = drive(frequency, amplitude)
        alone.update_many(record.voltage, record.displacement)
        found = saved.at(frequency, amplitude).values
        for name, value in alone.estimate().parameters().items():
            assert found[name] == value


def test_the_model_of_a_drive_has_the_harmonic_of_its_record() -> None:
    values = {**DEFAULTS, 'method': 'rls'}
    course = RecordSegmenter(new_method(values), RATE, renew=lambda: new_method(values))
    record = drive(10.0, 1.0)
    third = 3e-5 * np.sin(60.0 * np.pi * np.arange(len(record)) / RATE)
    record = replace(record, displacement=record.displacement + third)
    course.mark(SegmentEdge(0, 'a', 10.0, 1.0, 0.2))
    for k, (u, y) in enumerate(zip(record.voltage, record.displacement, strict=True)):
        course.take(k, k * MS, float(u), float(y))
    (live,) = course.model_file('test').schedule.points  # type: ignore[union-attr]
    alone = ph.identify(record, 'enhanced3', method='rls').values
    assert (live.order, live.model.model.name) == (3, 'enhanced3')
    for name, number in live.model.values.items():
        if name != 'offset':
            assert number == pytest.approx(alone[name], rel=1e-12, abs=1e-300), name


def test_an_actuator_at_rest_gives_no_converged_estimate() -> None:
    values = {**DEFAULTS, 'method': 'rls_ud', 'voltage_range': 1.0}
    course = RecordSegmenter(new_method(values), RATE, only_records=False)
    noise = 2e-8 * np.random.default_rng(3).standard_normal(6000)
    verdicts = []
    for k, y in enumerate(noise):
        course.take(k, k * MS, 0.0, float(y))
        if k % 500 == 499:
            estimate = course.method.estimate()
            verdicts.append(course.settled(estimate, course.free_run_rms(estimate)))
    assert not any(verdicts)


def test_forgetting_changes_for_every_drive() -> None:
    values = {**DEFAULTS, 'method': 'rls_ud', 'voltage_range': 1.0}
    course = RecordSegmenter(new_method(values), RATE, renew=lambda: new_method(values))
    played_sweep(course)
    course.set_forgetting(0.99)
    start = 30_000
    for k, drive_of in enumerate(DRIVES):
        course.mark(SegmentEdge((start + k) * MS, 'again', *drive_of))
        course.take(start + k, (start + k) * MS, 0.0, 0.0)
        assert (course.drive.frequency, course.drive.amplitude) == drive_of
        assert course.method.forgetting == 0.99
