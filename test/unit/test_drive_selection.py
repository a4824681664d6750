"""A schedule is respected by all that use a model: which entry the drive selects, and where."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import piezo_hysteresis as ph
from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.compensation.controllers import Controllers
from piezo_hysteresis.compensation.drive_selection import DriveFrequency, DriveSelector
from piezo_hysteresis.compensation.harmonics.harmonic_attenuation import ScheduledAttenuation
from piezo_hysteresis.compensation.harmonics.lines import AttenuationSettings
from piezo_hysteresis.compensation.inverses.inverse_choice import model_gain
from piezo_hysteresis.compensation.linear_gain import gain_at
from piezo_hysteresis.compensation.link import Limits, Measured, ReferencePoint
from piezo_hysteresis.compensation.offline_loop import reference_points
from piezo_hysteresis.discovery.gap_monitor import GapMonitor
from piezo_hysteresis.errors import PiezoError
from piezo_hysteresis.identification.simulate import entry_for
from piezo_hysteresis.models import ModelFile
from piezo_hysteresis.models.schedule import OperatingPoint, Schedule
from piezo_hysteresis.records import Record, RecordInfo
from piezo_hysteresis.waveforms import Sine, Waveform, from_spec

DT = 1e-3
LIMITS = Limits(-5.0, 5.0, 200.0)


def own(gain: float) -> ModelFile:
    """Return a classical model of a gain [m/V]."""
    return ModelFile.from_name('classical', A1=gain, A=0.3 * gain, beta=1.0, gamma=0.2)


def scheduled(*drives: tuple[float, float]) -> ModelFile:
    """Return a model with an entry for each frequency [Hz] and gain [m/V]."""
    points = tuple(OperatingPoint(f, 1.0, g, 0, own(g)) for f, g in drives)
    return replace(own(1e-4), schedule=Schedule(points))


TWO = scheduled((10.0, 1e-4), (23.0, 2e-4))


def ticks(seconds: float, first: int = 0) -> FloatArray:
    """Return the times of ticks [s]."""
    return np.asarray(DT * np.arange(first, first + round(seconds / DT)), np.float64)


def unstated(waveform: Waveform, seconds: float, first: int = 0) -> list[ReferencePoint]:
    """Return a reference that states neither frequency nor phase."""
    samples = waveform.sample(ticks(seconds))
    points = reference_points(samples, first)
    return [point._replace(frequency=0.0, phase=0.0) for point in points]


@pytest.mark.parametrize('frequency', [1.0, 7.3, 23.0, 180.0])
def test_the_frequency_of_a_reference_is_seen_in_its_stream(frequency: float) -> None:
    drive = DriveFrequency(DT)
    wave = Sine(5e-5, frequency, 10.0, offset=2e-4, ramp=0.5)
    for value in wave.sample(ticks(max(4.0 / frequency, 1.0))).value.tolist():
        drive.update(value)
    assert drive.frequency == pytest.approx(frequency, rel=0.02)
    assert drive.amplitude == pytest.approx(5e-5, rel=0.2)


def test_small_tones_do_not_count_and_a_pause_forgets() -> None:
    drive = DriveFrequency(DT)
    time = ticks(2.0)
    for value in (np.sin(2 * np.pi * 7.0 * time) + 0.2 * np.sin(2 * np.pi * 43.0 * time)).tolist():
        drive.update(value)
    assert drive.frequency == pytest.approx(7.0, rel=0.1)
    for _ in range(2000):
        drive.update(0.0)
    assert drive.frequency == 0.0


def test_the_entry_follows_a_frequency_that_the_reference_does_not_state() -> None:
    link = Controllers(DT, LIMITS, TWO).inverse()
    slow, fast = Sine(5e-5, 10.0, 2.0), Sine(5e-5, 23.0, 2.0)
    voltage = [link.step(point, 0.0, None) for point in unstated(slow, 2.0)]
    voltage += [link.step(point, 0.0, None) for point in unstated(fast, 2.0, first=2000)]
    assert link.counters()['schedule_changes'] >= 1
    stated = Controllers(DT, LIMITS).inverse(own(2e-4))
    for point in reference_points(fast.sample(ticks(2.0))):
        last = stated.step(point, 0.0, None)
    assert voltage[-1] == pytest.approx(last, abs=1e-3)


def test_a_sum_of_tones_selects_by_its_main_one_and_not_by_its_divisor() -> None:
    assert TWO.schedule is not None
    wave = from_spec({'kind': 'composite_zhou2021_low', 'amplitude': 5e-5, 'duration': 2.0})
    selector = DriveSelector(scheduled((10.0, 1e-4), (23.0, 2e-4), (30.0, 2e-4)).schedule, DT)  # type: ignore[arg-type]
    points = list(reference_points(wave.sample(ticks(2.0))))
    assert points[-1].frequency == 10.0
    for point in points:
        selector.select(point)
    assert selector.point is not None
    assert selector.point.frequency > 20.0


def with_mode(natural_frequency: float) -> ModelFile:
    """Return a schedule of 10 Hz whose model has a mode [Hz]."""
    model = ModelFile.from_name('bouc_wen_mode', natural_frequency=natural_frequency)
    return replace(model, schedule=Schedule((OperatingPoint(10.0, 1.0, 1e-4, 3, model),)))


@pytest.mark.parametrize('method', ['afc', 'rls'])
def test_the_attenuation_takes_the_gain_of_the_drive(method: str) -> None:
    orders = (-1,) if method == 'afc' else (3,)
    settings = AttenuationSettings(method=method, orders=orders)  # type: ignore[arg-type]
    link = Controllers(DT, LIMITS, TWO, attenuation=settings).attenuate()
    assert isinstance(link, ScheduledAttenuation)
    for frequency, gain in ((10.0, 1e-4), (23.0, 2e-4)):
        for point in reference_points(Sine(5e-5, frequency, 0.1).sample(ticks(0.1))):
            link.step(point, 0.0, None)
        expected = model_gain(own(gain).model, own(gain).values, DT, 5.0)
        assert np.allclose(link.packed_gain, expected.packed, rtol=1e-6, atol=0.0)
    assert link.counters()['schedule_changes'] == 1


@pytest.mark.parametrize('method', ['afc', 'rls'])
def test_another_gain_of_the_drive_makes_no_step_in_the_correction(method: str) -> None:
    """The mode moves from above the third harmonic to below it, which turns its sign."""
    orders = (-1,) if method == 'afc' else (3,)
    settings = AttenuationSettings(method=method, orders=orders)  # type: ignore[arg-type]
    link = Controllers(DT, LIMITS, with_mode(68.0), attenuation=settings).attenuate()
    assert isinstance(link, ScheduledAttenuation)
    corrections = []
    before = None
    for point in reference_points(Sine(5e-5, 10.0, 3.0).sample(ticks(3.0))):
        if point.sample == 2004:
            link.update(with_mode(20.0))
        corrections.append(link.step(point, 0.0, before))
        moved = point.displacement + 1e-6 * np.sin(3.0 * point.phase)
        before = Measured(point.sample, point.displacement / 1e-4, float(moved))
    steps = np.abs(np.diff(corrections))
    assert steps[1000:2000].max() > 1e-4
    assert steps[2000:2010].max() < 1.5 * steps[1800:2000].max()


def record(frequency: float, gain: float, seconds: float = 1.0) -> Record:
    """Return a record of the model of a gain."""
    voltage = np.sin(2 * np.pi * frequency * ticks(seconds))
    moved = own(gain).simulate(voltage, DT)
    moved += 1e-9 * np.random.default_rng(1).standard_normal(voltage.size)
    info = RecordInfo(frequency=frequency, amplitude=1.0)
    return Record(f'sine_{frequency:g}Hz', DT, voltage, moved, info=info)


def test_the_gap_is_that_of_the_entry_of_the_drive() -> None:
    """With the model of all drives the gap at 23 Hz is a third of the motion."""
    monitor = GapMonitor(TWO, DT, 1e-9, 200)
    alone = GapMonitor(replace(TWO, schedule=None), DT, 1e-9, 200)
    gaps, others = [], []
    for each in (record(10.0, 1e-4), record(23.0, 2e-4)):
        for u, y in zip(each.voltage.tolist(), each.displacement.tolist(), strict=True):
            gaps.append(monitor.add(u, y))
            others.append(alone.add(u, y))
    last = [report.rms for report in (*gaps[-1:], *others[-1:]) if report is not None]
    assert last[0] < 2e-7
    assert last[1] > 3e-5
    first = [report.rms for report in gaps[:1000] if report is not None]
    assert max(first) < 2e-9


def test_python_inverts_by_the_drive_of_an_array() -> None:
    desired = Sine(5e-5, 23.0, 1.0).sample(ticks(1.0)).value
    found = TWO.inverse(desired, DT, low=-5.0, high=5.0, slew=1e4)
    assert np.abs(found.displacement - desired).max() < 1e-6
    tracked = ph.compensate(
        TWO, desired, dt=DT, low=-5.0, high=5.0, slew=1e4, attenuation='none', from_seconds=0.5
    )
    assert tracked.runs[1].metrics.rms < 1e-6


def test_the_frequency_response_is_that_of_each_drive() -> None:
    low, high = np.abs(TWO.frequency_response([10.0, 23.0], amplitude=1.0, rate=1000.0))
    assert high == pytest.approx(2.0 * low, rel=1e-6)


def test_discover_takes_the_entry_of_one_drive_and_refuses_several() -> None:
    several = [record(10.0, 1e-4), record(23.0, 2e-4)]
    with pytest.raises(PiezoError, match='records of one drive'):
        ph.discover(several, TWO)
    assert entry_for(TWO, several[1:]).values == own(2e-4).values


def test_an_investigation_needs_one_model_for_all_drives() -> None:
    with pytest.raises(PiezoError, match='without --per-frequency'):
        ph.investigate(TWO, TWO, out='none', low=-1.0, high=1.0, slew=1e3)


def test_the_gain_of_an_entry_counts_at_its_own_frequency_only() -> None:
    """The RLS of 5 Hz extrapolates its recursion to half the gain at 35 Hz, its seventh order."""
    base = ModelFile.from_name('bouc_wen_mode', natural_frequency=68.0)
    point = OperatingPoint(
        10.0, 1.0, 1e-4, 0, ModelFile.from_name('bouc_wen_mode', natural_frequency=30.0)
    )
    given = replace(base, schedule=Schedule((point,)))
    link = Controllers(DT, LIMITS, given, attenuation=AttenuationSettings()).attenuate()
    assert isinstance(link, ScheduledAttenuation)
    wave = reference_points(Sine(5e-5, 10.0, 0.1).sample(ticks(0.1)))
    link.step(next(iter(wave)), 0.0, None)
    usual = model_gain(base.model, base.values, DT, 5.0)
    entry = model_gain(point.model.model, point.model.values, DT, 5.0)
    for frequency, size in ((10.0, 1.0), (40.0, abs(usual(40.0) / usual(10.0)))):
        found = gain_at(frequency, link.packed_gain)
        assert abs(found) == pytest.approx(size * abs(entry(10.0)), rel=1e-6)
        assert np.angle(found) == pytest.approx(np.angle(usual(frequency)), abs=1e-6)


def test_rls_takes_the_harmonic_of_each_entry_by_order_minus_one() -> None:
    slow, fast = (
        OperatingPoint(10.0, 1.0, 1e-4, 0, own(1e-4)),
        OperatingPoint(23.0, 1.0, 1e-4, 3, own(1e-4)),
    )
    given = replace(own(1e-4), schedule=Schedule((slow, fast)))
    settings = AttenuationSettings(method='rls', orders=(-1,))
    link = Controllers(DT, LIMITS, given, attenuation=settings).attenuate()
    assert isinstance(link, ScheduledAttenuation)
    corrections, before = [], None
    for k, frequency in enumerate((10.0, 23.0, 10.0)):
        for point in reference_points(Sine(5e-5, frequency, 1.0).sample(ticks(1.0)), 1000 * k):
            corrections.append(link.step(point, 0.0, before))
            moved = point.displacement + 1e-6 * np.sin(3.0 * point.phase)
            before = Measured(point.sample, point.displacement / 1e-4, float(moved))
        assert link.settings.orders == ((3,) if frequency == 23.0 else ())
    assert not np.any(corrections[:1000])
    assert np.abs(corrections[1500:2000]).max() > 1e-3
    steps = np.abs(np.diff(corrections))
    assert steps[1995:2005].max() < 1.5 * steps[1500:1995].max()
    assert not np.any(corrections[2300:])
    with pytest.raises(PiezoError, match='identified per frequency'):
        Controllers(DT, LIMITS, own(1e-4), attenuation=settings).attenuate()
