"""The noise floor of records, in which more than noise changes from period to period."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.discovery.data.dataset import split
from piezo_hysteresis.errors import IdentificationError
from piezo_hysteresis.identification.fit_data import whole
from piezo_hysteresis.identification.noise import (
    density,
    floor_of,
    independent,
    noise_of,
    noises_of,
    repeat_of,
)
from piezo_hysteresis.records import Record, RecordInfo

RATE, NOISE = 1000.0, 2e-8


def record(
    frequency: int,
    seconds: float = 4.0,
    seed: int = 0,
    add: FloatArray | float = 0.0,
    noise: Any = NOISE,
) -> Record:
    t = np.arange(round(seconds * RATE)) / RATE
    u = np.sin(2 * np.pi * frequency * t)
    y = 1e-4 * (u - 0.2 * u**3) + add + noise * np.random.default_rng(seed).normal(size=t.size)
    info = RecordInfo(
        excitation='sine' if frequency else 'rest', frequency=float(frequency), amplitude=1.0
    )
    return Record(f'{frequency}Hz_{seed}', 1.0 / RATE, u, y, info=info)


def sweep(add: FloatArray | float = 0.0) -> list[Any]:
    return [record(f, seed=k, add=add) for k, f in enumerate((1, 2, 4, 5, 8, 10, 20, 0))]


def test_the_scatter_of_estimates_agrees_with_their_uncertainty() -> None:
    found = floor_of(sweep())
    assert 0.0 < found.excess_deviation < 0.06
    assert (found.rms / NOISE) ** 2 == pytest.approx(1.0, abs=3.0 * found.excess_deviation)


def test_tones_and_drift_are_no_noise() -> None:
    t = np.arange(4000) / RATE
    disturbed = sweep(2e-6 * np.sin(2 * np.pi * 17.37 * t) + 1e-5 * t)
    found = floor_of(disturbed)
    assert found.rms == pytest.approx(NOISE, rel=0.06)


def test_a_record_with_noise_of_its_own_keeps_it_to_itself() -> None:
    records = sweep()
    records[2] = record(4, seed=2, noise=5.0 * NOISE)
    assert noise_of(records[2]).rms == pytest.approx(5.0 * NOISE, rel=0.1)
    found = noises_of(records)
    assert found[2].rms == pytest.approx(5.0 * NOISE, rel=0.1)
    # those that are alike tell one value together, better than each of them
    others = {noise.rms for k, noise in enumerate(found) if k != 2}
    assert len(others) == 1
    assert others.pop() == pytest.approx(NOISE, rel=0.05)


def bent(voltage: np.ndarray, seed: int = 3) -> Record:
    """Return a record of a bent gain that is driven by any voltage."""
    noise = NOISE * np.random.default_rng(seed).normal(size=voltage.size)
    return Record('any', 1.0 / RATE, voltage, 1e-4 * (voltage - 0.2 * voltage**3) + noise)


def test_records_that_never_repeat_show_their_noise() -> None:
    t = np.arange(20000) / RATE
    chirp = bent(np.sin(2 * np.pi * (1.0 + 2.0 * t) * t))
    staircase = bent(np.repeat(np.sin(np.arange(20)), 1000))
    for record in (chirp, staircase):
        assert noise_of(record).rms == pytest.approx(NOISE, rel=0.15)


@pytest.mark.parametrize('kind', ['sine', 'chirp'])
def test_spikes_and_drop_outs_move_nothing(kind: str) -> None:
    t = np.arange(12000) / RATE
    clean = bent(np.sin(2 * np.pi * (5.0 if kind == 'sine' else 5.0 + 2.0 * t) * t))
    spoilt = clean.displacement.copy()
    spoilt[6001] += 30e-6
    if kind == 'sine':
        spoilt[4000:4040] = 0.0
    record = replace(clean, displacement=spoilt)
    assert noise_of(record).rms == pytest.approx(noise_of(clean).rms, rel=0.02)
    found = whole(record)
    assert found.lost >= (41 if kind == 'sine' else 1)
    assert found.lost < 60
    assert found.valid is not None
    assert found.valid[6001] == 0.0
    assert whole(clean).lost < 10


def test_slow_noise_has_a_colour() -> None:
    rng = np.random.default_rng(1)
    slow = np.convolve(rng.normal(size=20100), np.ones(20) / 20.0, 'same')[:20000]
    t = np.arange(20000) / RATE
    u = np.sin(2 * np.pi * 5.0 * t)
    white = Record('w', 1.0 / RATE, u, 1e-4 * u + NOISE * rng.normal(size=t.size))
    red = Record('r', 1.0 / RATE, u, 1e-4 * u + 1e-7 * slow)
    assert abs(noise_of(white).colour) < 0.1
    assert noise_of(red).colour > 0.8


def test_records_that_show_no_noise_are_refused() -> None:
    short = [record(100, seconds=0.015)]
    with pytest.raises(IdentificationError, match='no record shows the noise'):
        split(short)


@pytest.mark.parametrize('frequency', [0, 5])
def test_the_steps_of_a_converter_are_noise(frequency: int) -> None:
    step = 1e-6
    seen = record(frequency, noise=0.05 * step)
    read = step * np.round(seen.displacement / step)
    noise = noise_of(replace(seen, displacement=read))
    if frequency:
        assert noise.rms == pytest.approx(step * np.hypot(0.05, 1 / np.sqrt(12.0)), rel=0.015)
    else:  # it never leaves its step, so it does not tell
        assert noise.lines == 0


def test_a_converter_adds_nothing_to_noise_that_fills_its_steps() -> None:
    seen = record(5)
    read = 0.1 * NOISE * np.round(seen.displacement / (0.1 * NOISE))
    plain, stepped = (noise_of(each).rms for each in (seen, replace(seen, displacement=read)))
    assert stepped == pytest.approx(plain, rel=0.01)


def slow_noise(count: int, seed: int, share: float = 0.9) -> Any:
    """Return noise of rms 1 of which each sample keeps a share of the last."""
    white = np.random.default_rng(seed).normal(size=count)
    return lfilter([np.sqrt(1.0 - share**2)], [1.0, -share], white)


def driven(
    period: Any,
    count: int = 6000,
    *,
    seed: int = 4,
    jump: int = 0,
    before: int = 0,
    slow: bool = True,
) -> Record:
    """Return a record of a loop that settles, of a period that may be no whole number."""
    u = np.concatenate([np.zeros(before), np.sin(2 * np.pi * np.arange(count) / period)])
    u = np.roll(u, -jump)
    y = lfilter([0.02], [1.0, -0.98], u + 0.2 * u**2)
    noise = slow_noise(u.size, seed) if slow else np.random.default_rng(seed).normal(size=u.size)
    return Record('any', 1.0 / RATE, u, 1e-4 * y + NOISE * noise)


@pytest.mark.parametrize('jump', [0, 123])
@pytest.mark.parametrize('slow', [False, True])
@pytest.mark.parametrize('period', [131.4, 611.88, 1277.3])
def test_a_period_need_not_be_a_whole_number_of_samples(
    period: float, slow: bool, jump: int
) -> None:
    found = noise_of(driven(period, slow=slow, jump=jump))
    # few lines hold most of slow noise
    assert found.rms == pytest.approx(NOISE, rel=4.0 * found.excess_deviation / 2.0)
    assert found.excess_deviation < 0.2
    assert found.colour == pytest.approx(0.9 if slow else 0.0, abs=0.06)


def test_a_fractional_period_is_found_with_a_jump() -> None:
    repeat = repeat_of(driven(611.88, jump=123))
    assert repeat is not None
    assert repeat.period == pytest.approx(611.88, abs=1e-3)
    assert repeat.first == 0
    assert repeat.last == pytest.approx(6000 - 123, abs=15)


@pytest.mark.parametrize('kind', ['chirp', 'growing', 'rest'])
def test_a_drive_that_does_not_repeat_has_no_period(kind: str) -> None:
    t = np.arange(6000) / RATE
    u = {
        'chirp': np.sin(2 * np.pi * (1.0 + 2.0 * t) * t),
        'growing': t * np.sin(2 * np.pi * 7.3 * t),
        'rest': np.zeros(t.size),
    }[kind]
    assert repeat_of(bent(u)) is None


def test_a_record_that_does_not_repeat_has_the_colour_of_the_others() -> None:
    t = np.arange(6000) / RATE
    u = np.sin(2 * np.pi * (1.0 + 0.5 * t) * t)
    chirp = Record('c', 1.0 / RATE, u, 1e-4 * u + NOISE * slow_noise(t.size, 8))
    assert noise_of(chirp).rms < 0.5 * NOISE
    found = noises_of([driven(131.4), chirp, driven(150.7, seed=5)])[1]
    assert found.rms == pytest.approx(NOISE, rel=0.15)


def test_slow_noise_has_fewer_independent_samples() -> None:
    whites = [np.random.default_rng(k).normal(size=4000) for k in range(200)]
    slows = [slow_noise(4000, k) for k in range(200)]
    for share, signals in ((0.0, whites), (0.9, slows)):
        scatter = np.std([np.mean(x**2) for x in signals])
        assert scatter == pytest.approx(np.sqrt(2.0 / independent(4000, share)), rel=0.2)
    lines = np.array([np.abs(np.fft.rfft(x)) ** 2 / x.size for x in slows]).mean(axis=0)[1:]
    expected = density(0.9, np.cos(2.0 * np.pi * np.arange(1, lines.size + 1) / 4000))
    assert np.median(lines / expected) == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize('share', [0.1, 0.2, 0.3, 0.5])
@pytest.mark.parametrize('period', [200.0, 211.37])
def test_rounding_that_repeats_with_the_drive_is_noise(share: float, period: float) -> None:
    step = 1e-6
    u = np.sin(2 * np.pi * np.arange(12000) / period)
    noise = share * step * np.random.default_rng(9).normal(size=u.size)
    read = step * np.round((1e-4 * u + noise) / step)
    found = noise_of(Record('coarse', 1.0 / RATE, u, read))
    true = np.mean((read - 1e-4 * u) ** 2)
    assert found.rms**2 == pytest.approx(true, rel=found.rounding + 0.1)
    assert found.rounding < 0.25
    assert (found.rounding == 0.0) == (period == 200.0)


@pytest.mark.parametrize('ratio', [1e-3, 0.1, 1.0, 10.0, 1e3, 1e9])
def test_noise_far_from_the_step_of_its_converter_is_estimated(ratio: float) -> None:
    step, count, t = 1e-9, 4000, np.arange(4000)
    noise = ratio * step * np.random.default_rng(8).standard_normal(count)
    clean = 1e3 * step * np.sin(2 * np.pi * t / 400)
    measured = clean + noise if ratio > 1e3 else step * np.round((clean + noise) / step)
    record = Record('r', 1e-3, np.sin(2 * np.pi * t / 400), measured)
    told = noise_of(record).rms
    assert 0.2 * max(ratio, 0.29) * step < told < 2.0 * max(ratio, 0.29) * step


def test_a_section_that_hardly_repeats_behind_its_warm_up_shows_what_differences_do() -> None:
    time = np.arange(256) * 1e-3
    voltage = np.sin(2 * np.pi * 50.0 * time) * np.minimum(time / 0.2, 1.0)
    noise = 1e-8 * np.random.default_rng(1).standard_normal(time.size)
    info = RecordInfo(excitation='sine', frequency=50.0, warm_up=0.25)
    record = Record('way in', 1e-3, voltage, 1e-4 * voltage + noise, info=info)
    repeat = repeat_of(record)
    assert repeat is not None
    assert repeat.last - record.warm_up_samples < 10
    shown = noise_of(record)
    assert shown.lines == 0 or shown.rms > 0.0
    longer = replace(record, info=replace(info, warm_up=0.1))
    assert noise_of(longer).rms == pytest.approx(1e-8, rel=0.5)


@pytest.mark.parametrize('memory', [0.0, 0.9])
def test_noise_hidden_by_rounding_is_taken_from_other_records(memory: float) -> None:
    step, t = 1e-7, np.arange(6000) / RATE

    def rounded(name: str, u: np.ndarray, seed: int) -> tuple[Record, float]:
        white = np.random.default_rng(seed).standard_normal(t.size)
        slow = lfilter([np.sqrt(1.0 - memory**2)], [1.0, -memory], white)
        read = step * np.round((1e-5 * u + 0.4 * step * slow) / step)
        return Record(name, 1.0 / RATE, u, read), float(np.std(read - 1e-5 * u))

    sines = [rounded(f'{f}', np.sin(2 * np.pi * f * t), k)[0] for k, f in enumerate((1, 2, 5))]
    growing, true = rounded('growing', t / t[-1] * np.sin(2 * np.pi * 1.3 * t), 7)
    assert noise_of(growing).hidden
    assert memory == 0.0 or noise_of(growing).rms < 0.9 * true
    assert noises_of([*sines, growing])[-1].rms == pytest.approx(true, rel=0.1)
    # alone it is what it shows, and never less than that beside quieter ones
    assert noises_of([growing])[0].rms == noise_of(growing).rms
    quiet = [replace(r, displacement=1e-3 * r.displacement) for r in sines]
    assert noises_of([*quiet, growing])[-1].rms == pytest.approx(noise_of(growing).rms)


def amplitude_record(
    amplitude: float, seed: int, *, grows: bool = True, share: float = 0.9
) -> Record:
    """Return slow noise on a sine, which follows its amplitude or does not."""
    t = np.arange(6000) / RATE
    u = amplitude * np.sin(2 * np.pi * 4.0 * t)
    slow = slow_noise(6000, seed, share)
    y = 1e-4 * u + (amplitude if grows else 1.0) * NOISE * slow
    return Record(f'{amplitude}_{seed}', 1.0 / RATE, u, y, info=RecordInfo(amplitude=amplitude))


def test_noise_that_falls_with_the_frequency_is_estimated_without_bias() -> None:
    records = [amplitude_record(1.0, seed, share=0.95) for seed in range(40)]
    # 0.92 where a median runs over a spectrum that falls
    assert np.mean([noise_of(each).rms for each in records]) == pytest.approx(NOISE, rel=0.04)


def test_noise_that_follows_the_drive_is_shared_by_none_of_another_drive() -> None:
    amplitudes = (1.0, 0.85, 0.7, 0.55) * 2
    records = [amplitude_record(a, seed) for seed, a in enumerate(amplitudes)]
    found = noises_of(records)
    for amplitude, own, noise in zip(amplitudes, map(noise_of, records), found, strict=True):
        assert noise.rms == own.rms
        assert noise.rms == pytest.approx(amplitude * NOISE, rel=3.0 * 0.5 * own.excess_deviation)
    alike = noises_of([amplitude_record(a, k, grows=False) for k, a in enumerate(amplitudes)])
    assert len({noise.rms for noise in alike}) == 1


def test_a_record_without_noise_estimate_uses_records_with_its_drive() -> None:
    def constant(record: Record) -> Record:
        return replace(record, displacement=np.full(len(record), 1e-6))

    records = [amplitude_record(a, k) for k, a in enumerate((1.0, 1.0, 0.3, 0.3, 0.3, 1.0, 0.3))]
    records[5:] = [constant(record) for record in records[5:]]
    assert not any(noise_of(record).lines for record in records[5:])
    loud, quiet = noises_of(records)[5:]
    assert loud.rms == pytest.approx(NOISE, rel=0.15)
    assert quiet.rms == pytest.approx(0.3 * NOISE, rel=0.15)
