"""One set of parameters per drive: file, selection by the reference, smooth change, export."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import piezo_hysteresis as ph
from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.compensation.controllers import Controllers
from piezo_hysteresis.compensation.inverses.inverse_choice import ScheduledInverse
from piezo_hysteresis.compensation.link import Limits
from piezo_hysteresis.compensation.offline_loop import reference_points
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.identification.per_frequency import identify_per_frequency, order_of
from piezo_hysteresis.interface import model_functions
from piezo_hysteresis.models import ModelFile
from piezo_hysteresis.models.schedule import OperatingPoint, Schedule
from piezo_hysteresis.records import Record, RecordInfo
from piezo_hysteresis.waveforms import Sine

DT = 1e-3


def seconds(duration: float) -> FloatArray:
    """Return the ticks of a duration [s]."""
    return np.asarray(DT * np.arange(round(duration / DT)), np.float64)


def model(gain: float) -> ModelFile:
    """Return a classical model of a gain [m/V]."""
    return ModelFile.from_name('classical', A1=gain, A=0.3 * gain, beta=1.0, gamma=0.2)


def scheduled(*drives: tuple[float, float, float]) -> ModelFile:
    """Return a model with an entry for each frequency [Hz], amplitude [V] and gain [m/V]."""
    points = tuple(OperatingPoint(f, a, a * g, 3, model(g)) for f, a, g in drives)
    return replace(model(1e-4), schedule=Schedule(points))


def record(frequency: float, gain: float, *, third: float = 0.0, seconds: float = 0.5) -> Record:
    """Return a record of the model of a gain, and a third harmonic of that share."""
    time = DT * np.arange(round(seconds / DT))
    voltage = np.sin(2 * np.pi * frequency * time)
    moved = model(gain).simulate(voltage, DT)
    moved += third * gain * np.sin(6 * np.pi * frequency * time)
    moved += 1e-9 * np.random.default_rng(1).standard_normal(time.size)
    info = RecordInfo(frequency=frequency, amplitude=1.0, warm_up=0.2 * seconds)
    return Record(f'sine_{frequency:g}Hz', DT, voltage, moved, info=info)


def test_a_file_keeps_its_schedule(tmp_path: Path) -> None:
    given = scheduled((10.0, 1.0, 1e-4), (23.0, 0.5, 2e-4), (23.0, 1.0, 3e-4))
    given.save(tmp_path / 'model.yaml')
    read = ModelFile.load(tmp_path / 'model.yaml')
    assert read.text() == given.text()
    assert read.schedule is not None
    assert [p.name for p in read.schedule.points] == ['10 Hz, 1 V', '23 Hz, 0.5 V', '23 Hz, 1 V']
    assert read.at(22.0)['A1'] == 3e-4
    assert read.at(22.0, 0.6)['A1'] == 2e-4
    assert read.at(12.0, 0.6)['A1'] == 1e-4
    assert read.at(0.0) is read


@pytest.mark.parametrize(
    ('line', 'other', 'reason'),
    [
        ('schedule: frequency', 'schedule: phase', 'expected frequency'),
        ('    frequency: 10.0', '    frequency: -1.0', 'must be positive'),
        ('    amplitude: 1.0', '    amplitud: 1.0', 'amplitude of entry'),
        ('    name: classical', '    name: classical\n    schedule: frequency', 'of its own'),
    ],
)
def test_a_broken_schedule_is_refused(line: str, other: str, reason: str) -> None:
    text = scheduled((10.0, 1.0, 1e-4)).text()
    assert line in text
    with pytest.raises(PiezoError, match=reason):
        ModelFile.parse(text.replace(line, other, 1))


def test_each_record_is_simulated_with_the_entry_of_its_drive() -> None:
    given = scheduled((10.0, 1.0, 1e-4), (23.0, 1.0, 2e-4))
    records = [record(10.0, 1e-4), record(23.0, 2e-4)]
    assert max(row.free_run_rms for row in ph.validate(records, given).records) < 5e-9
    alone = ph.validate(records, replace(given, schedule=None))
    assert alone.records[1].free_run_rms > 2e-5
    second = given.simulate(records[1].voltage, DT, frequency=23.0)
    assert np.array_equal(second, model(2e-4).simulate(records[1].voltage, DT))


def test_the_order_of_a_record_is_its_harmonic_oscillation() -> None:
    assert order_of(record(10.0, 1e-4)) == 0
    assert order_of(record(10.0, 1e-4, third=0.2)) == 3


def test_one_set_per_frequency_follows_each_record() -> None:
    records = [record(10.0, 1e-4), record(23.0, 2e-4, third=0.3)]
    found = identify_per_frequency(records, 'classical', method='rls_ud')
    assert [each.point.order for each in found.drives] == [0, 3]
    assert found.drives[0].rms < 0.05 * found.drives[0].rms_of_all
    assert found.drives[0].rms < 0.05 * found.drives[0].rms_left_out
    own = ph.identify(records[0], 'classical', method='rls_ud')
    assert found.model.at(10.0).values == own.values


def test_records_without_a_frequency_have_no_entry() -> None:
    unnamed = replace(record(10.0, 1e-4), info=RecordInfo())
    with pytest.raises(PiezoError, match='give --frequency'):
        identify_per_frequency([unnamed], 'classical', method='rls_ud')


def test_the_feedforward_takes_the_entry_of_the_drive_without_a_step() -> None:
    limits = Limits(-5.0, 5.0, 200.0)
    given = scheduled((10.0, 1.0, 1e-4), (23.0, 1.0, 2e-4))
    link = Controllers(DT, limits, given).inverse()
    assert isinstance(link, ScheduledInverse)
    slow, fast = (Sine(5e-5, f, 2.0).sample(seconds(2.0)) for f in (10.0, 23.0))
    own = Controllers(DT, limits).inverse(given.at(10.0))
    points = list(reference_points(slow))
    voltage = [link.step(point) for point in points]
    assert voltage == [own.step(point, 0.0, None) for point in points]
    # the frequency changes where both references pass 0 upwards
    voltage += [link.step(point) for point in reference_points(fast, 2000)]
    jumps = np.abs(np.diff(voltage))
    assert link.counters()['schedule_changes'] == 1
    assert jumps[1990:2010].max() < 1.3 * jumps[1000:1990].max()
    settled = Controllers(DT, limits).inverse(given.at(23.0))
    settled.follow(points[-1000:])
    after = [settled.step(point, 0.0, None) for point in reference_points(fast, 2000)]
    assert np.allclose(voltage[-500:], after[-500:], atol=1e-12)


def test_a_changed_entry_moves_the_voltage_over_and_others_leave_it() -> None:
    limits = Limits(-5.0, 5.0, 200.0)
    given = scheduled((10.0, 1.0, 1e-4), (23.0, 1.0, 2e-4))
    link = Controllers(DT, limits, given).inverse()
    same = Controllers(DT, limits, given).inverse()
    assert isinstance(link, ScheduledInverse)
    wave = list(reference_points(Sine(5e-5, 10.0, 3.0).sample(seconds(3.0))))
    voltage = [link.step(point) for point in wave[:1000]]
    link.update(scheduled((10.0, 1.0, 1e-4), (23.0, 1.0, 3e-4), (35.0, 1.0, 3e-4)))
    voltage += [link.step(point) for point in wave[1000:2000]]
    assert voltage == [same.step(point, 0.0, None) for point in wave[:2000]]
    link.update(scheduled((10.0, 1.0, 1.2e-4)))
    after = [link.step(point) for point in wave[2000:]]
    assert abs(after[0] - voltage[-1]) < 1.3 * np.abs(np.diff(voltage[1000:])).max()
    assert np.max(after[-100:]) == pytest.approx(np.max(voltage[-100:]) / 1.2, rel=0.03)


def test_among_amplitudes_of_one_frequency_the_travel_decides() -> None:
    given = scheduled((10.0, 0.2, 1e-4), (10.0, 1.0, 2e-4))
    link = Controllers(DT, Limits(-5.0, 5.0, 1e3), given).inverse()
    assert isinstance(link, ScheduledInverse)
    for point in reference_points(Sine(2e-5, 10.0, 1.0).sample(seconds(1.0))):
        link.step(point)
    assert link.point is not None
    assert link.point.amplitude == 0.2


def test_a_library_of_a_schedule_needs_a_frequency(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given = scheduled((10.0, 1.0, 1e-4), (23.0, 1.0, 2e-4))
    asked = []

    def files(request: Any) -> dict[str, str]:
        asked.append(request)
        return {'libpiezo.a': ''}

    monkeypatch.setattr(model_functions, 'files_of', files)
    with pytest.raises(PiezoError, match='one per frequency; give the frequency'):
        given.export(tmp_path / 'none', low=-1.0, high=1.0, slew=1e3)
    given.export(tmp_path / 'own', low=-1.0, high=1.0, slew=1e3, frequency=21.0)
    (request,) = asked
    assert request.model.values == model(2e-4).values
    assert request.links()[0].parameters == model(2e-4).values
