"""Records that were cancelled, refused or run again: reported, and used by no verb."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from damaged_bags import FIELDS

from piezo_hysteresis.cli.main import main
from piezo_hysteresis.errors import RecordError
from piezo_hysteresis.records import LeftOutWarning, cdr, load, read_bag, survey, write_bag
from piezo_hysteresis.records.definitions import MARKER, STATE, definition_of, typestore
from piezo_hysteresis.records.markers import MOVED, VERDICTS
from piezo_hysteresis.records.recorder import Recorder

RATE = 1000
Mark = tuple[float, str, str, str]  # tick, record, excitation, frame_id


def bag_of(
    folder: Path, marks: Sequence[Mark], ticks: int = 400, jitter: Sequence[float] = ()
) -> Path:
    """Write what a recorder gets of a sweep: a sine of 25 Hz, marked as told.

    Stamps of the samples are off by `jitter` [ticks]; markers may lie between two ticks.
    """
    types = typestore().types
    number = np.arange(ticks)
    voltage = np.sin(2 * np.pi * 25.0 * number / RATE)
    columns = {'sample': number, 'voltage': voltage, 'displacement': 1e-5 * voltage}
    with Recorder(folder) as recorder:
        state = recorder.add_topic('/actuator/state', STATE, definition=definition_of(STATE)[0])
        mark = recorder.add_topic('/record/marker', MARKER, definition=definition_of(MARKER)[0])
        stamps = np.asarray(1e6 * (number + (np.asarray(jitter) if len(jitter) else 0)), np.int64)
        for row in cdr.encode(FIELDS, stamps, columns):
            recorder.write(state, row.tobytes(), 0)
        for tick, name, excitation, judged in marks:
            stamp = types['builtin_interfaces/msg/Time'](sec=0, nanosec=round(tick * 1_000_000))
            message = types[MARKER](
                header=types['std_msgs/msg/Header'](stamp=stamp, frame_id=judged), record=name,
                actuator='', excitation=excitation, frequency=25.0, amplitude=1.0, warm_up=0.0,
                rate=float(RATE), input_unit='V',
            )  # fmt: skip
            recorder.write(mark, bytes(typestore().serialize_cdr(message, MARKER)), 0)
    return folder


GOOD: list[Mark] = [(0, 'one', 'sine', ''), (80, '', '', '')]
CANCELLED: list[Mark] = [(100, 'two', 'sine', ''), (190, '', 'cancelled', 'two')]


@pytest.mark.parametrize('verdict', VERDICTS)
def test_an_invalidated_record_is_omitted_and_reported(tmp_path: Path, verdict: str) -> None:
    marks = [*GOOD, (100, 'two', 'sine', ''), (190, '', verdict, 'two')]
    found = survey([bag_of(tmp_path / 'bag', marks)])
    assert [(r.name, len(r)) for r in found.records] == [('one', 80)]
    lines = [str(note) for note in found.left_out]
    words = [f'{tmp_path}/bag: record two was {verdict} and is left out']
    assert lines == ([] if verdict == MOVED else words)
    assert set(found.left_out) <= set(found.notes)


def test_what_is_run_again_counts_once_and_under_its_name(tmp_path: Path) -> None:
    marks: list[Mark] = [
        (0, 'one', 'sine', ''), (40, '', 'moved', 'one'),
        # Said at the tick at which the next one begins, and at which it began itself.
        (40, 'one', 'sine', ''), (40, '', 'moved', 'one'), (60, 'one', 'sine', ''),
        (90, '', '', ''), (100, '', 'repeated', 'one'), (100, 'one', 'sine', ''),
        (100, 'one', 'sine', ''), (180, '', '', ''),
    ]  # fmt: skip
    found = survey([bag_of(tmp_path / 'bag', marks)])
    assert [(r.name, len(r), r.start) for r in found.records] == [('one', 80, 0.1)]
    assert [str(note).split(': ')[1] for note in found.notes] == [
        'record one was repeated and is left out', '290 samples lie outside the marked records',
    ]  # fmt: skip


def test_a_start_that_was_announced_late_swallows_nothing(tmp_path: Path) -> None:
    """A clock that jitters: the true start lies 8 us before the one that was foreseen."""
    marks: list[Mark] = [
        (100.5, 'one', 'sine', 'sample 101'), (105.5, '', 'moved', 'one'),
        (100.492, 'one', 'sine', 'sample 101'), (180.5, '', '', 'sample 181'),
    ]  # fmt: skip
    found = survey([bag_of(tmp_path / 'bag', marks)])
    assert [(r.name, len(r), r.start) for r in found.records] == [('one', 80, 0.101)]
    assert not any('no samples' in str(note) for note in found.notes)
    plain = [
        (tick, name, kind, judged if kind == 'moved' else '') for tick, name, kind, judged in marks
    ]
    assert [len(r) for r in survey([bag_of(tmp_path / 'older', plain)]).records] == [80]


def test_markers_cut_at_their_sample_for_any_stamps(tmp_path: Path) -> None:
    jitter = np.random.default_rng(1).uniform(-3, 3, 400) + 10
    marks: list[Mark] = [(100.5, 'one', 'sine', 'sample 100'), (160, '', '', 'sample 180'),
                         (190, 'two', 'sine', 'sample 180'),
                         (260, '', '', 'sample 260')]  # fmt: skip
    found = survey([bag_of(tmp_path / 'bag', marks, jitter=list(jitter))])
    assert [len(r) for r in found.records] == [80, 80]
    assert found.records[1].voltage[0] == pytest.approx(np.sin(2 * np.pi * 25 * 0.18))
    assert sum('its stamps jitter' in str(note) for note in found.notes) == 2


def test_a_driver_that_is_held_up_again_and_again_keeps_its_stated_rate(tmp_path: Path) -> None:
    late = np.cumsum(np.where(np.arange(400) % 5 == 3, 3.0, 0.0))
    marks: list[Mark] = [(0, 'one', 'sine', 'sample 100'), (0, '', '', 'sample 300')]
    found = survey([bag_of(tmp_path / 'bag', marks, jitter=list(late))])
    assert [(len(r), r.rate) for r in found.records] == [(200, 1000.0)]
    assert 'held up: 62' in str(found.notes[-1])
    for share, rate in ((1.0, '500'), (0.1, '909.0')):  # every step is longer: another rate
        slow = np.arange(400) * share
        with pytest.raises(RecordError, match=f'says 1000 Hz but its samples come at {rate}'):
            load([bag_of(tmp_path / f'slow {rate}', marks, jitter=list(slow))])


def test_a_record_that_was_cancelled_before_it_began_swallows_nothing(tmp_path: Path) -> None:
    marks: list[Mark] = [(150, 'two', 'sine', ''), (110, '', 'cancelled', 'two'),
                         (120, 'three', 'sine', ''), (200, '', '', '')]  # fmt: skip
    assert [len(r) for r in survey([bag_of(tmp_path / 'bag', marks)]).records] == [80]


def test_a_record_is_taken_back_long_after_its_end(tmp_path: Path) -> None:
    marks = [*GOOD, (100, 'two', 'sine', ''), (150, '', 'refused', 'one'),
             (150, '', 'refused', 'two'), (300, '', 'refused', 'nobody')]  # fmt: skip
    with pytest.warns(LeftOutWarning) as warned:
        records = load([bag_of(tmp_path / 'more', [*marks, (320, 'three', 'sine', '')])])
    assert [str(each.message).split()[2] for each in warned] == ['one', 'two']
    assert [record.name for record in records] == ['three']


def test_a_bag_without_valid_records_is_reported(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = bag_of(tmp_path / 'bag', CANCELLED)
    assert main(['info', str(bag)]) == 2
    assert 'record two was cancelled and is left out' in capsys.readouterr().err
    with pytest.raises(RecordError, match='no record that counts'):
        read_bag(bag)


def test_an_end_of_older_bags_that_has_an_excitation_ends_only(tmp_path: Path) -> None:
    marks: list[Mark] = [(0, 'one', 'sine', ''), (80, '', 'sine', 'laser')]
    found = survey([bag_of(tmp_path / 'bag', marks)])
    assert [(r.name, len(r)) for r in found.records] == [('one', 80)]


@pytest.mark.component
def test_every_verb_leaves_it_out_with_a_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = str(bag_of(tmp_path / 'bag', [*GOOD, *CANCELLED]))
    line = f'note: {bag}: record two was cancelled and is left out\n'
    assert main(['info', bag]) == 0
    printed = capsys.readouterr()
    assert line in printed.out
    assert [row.split()[0] for row in printed.out.splitlines() if row[:3] in ('one', 'two')] == [
        'one'
    ]
    out = tmp_path / 'model'
    assert main(['identify', bag, '--model', 'linear_mode', '--out', str(out)]) == 0
    assert line in capsys.readouterr().err
    summary = json.loads((out / 'summary.json').read_text())
    assert [record['record'] for record in summary['records']] == ['one']
    words = [bag, '--model', str(out / 'model.yaml'), '--out', str(tmp_path / 'check')]
    assert main(['validate', *words]) == 0
    assert line in capsys.readouterr().err
    assert main(['import', bag, '--out', str(tmp_path / 'copy')]) == 0
    assert line in capsys.readouterr().err
    assert [record.name for record in load([tmp_path / 'copy'])] == ['one']


def test_a_discovery_leaves_it_out_with_a_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = str(bag_of(tmp_path / 'bag', [*GOOD, *CANCELLED]))
    main(['discover', bag, '--baseline', 'linear_mode', '--out', str(tmp_path / 'found')])
    assert 'record two was cancelled and is left out' in capsys.readouterr().err


def test_bags_without_verdicts_are_read_as_before(tmp_path: Path) -> None:
    records = load([bag_of(tmp_path / 'bag', GOOD)])
    write_bag(tmp_path / 'old', records)
    (again,) = load([tmp_path / 'old'])
    np.testing.assert_array_equal(again.voltage, records[0].voltage)
