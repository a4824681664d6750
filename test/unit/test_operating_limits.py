"""Limits of the voltage come from the records of a model, in every place the same."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import piezo_hysteresis as ph
from piezo_hysteresis.arrays import FloatArray
from piezo_hysteresis.cli.main import main
from piezo_hysteresis.compensation.controllers import Controllers
from piezo_hysteresis.compensation.harmonics.lines import AttenuationSettings
from piezo_hysteresis.compensation.limiter import Limiter
from piezo_hysteresis.compensation.link import Limits
from piezo_hysteresis.compensation.operating_limits import (
    above_nyquist,
    limited,
    operating_limits,
    rate_of,
)
from piezo_hysteresis.errors import ModelError, PiezoError
from piezo_hysteresis.identification.identify import identify
from piezo_hysteresis.interface.compensate_runs import compensate
from piezo_hysteresis.models import ModelFile, Provenance
from piezo_hysteresis.models.schedule import OperatingRange
from piezo_hysteresis.records import Record
from piezo_hysteresis.runtime.link_health import LinkHealth, Watchdog

COVERED = OperatingRange(20.0, 140.0, 3000.0, 80.0)


def stage(mode: float = 180.0, voltage: OperatingRange | None = COVERED) -> ModelFile:
    model = ModelFile.from_name('linear_mode', A1=1e-7, natural_frequency=mode, damping_ratio=0.05)
    return ModelFile(
        model.model, model.values, provenance=Provenance(rate=4000.0, voltage=voltage)
    )


def record(low: float, high: float, rate: float = 4000.0, name: str = 'one') -> Record:
    time = np.arange(4000) / rate
    voltage = 0.5 * (low + high) + 0.5 * (high - low) * np.sin(2 * np.pi * 20.0 * time)
    moved = 1e-7 * np.concatenate([[voltage[0]], voltage[:-1]])
    return Record(name, 1.0 / rate, voltage, moved)


@pytest.mark.parametrize(
    ('ranges', 'rest'),
    [
        (((20.0, 90.0), (40.0, 140.0)), 80.0),  # never near 0 V
        (((0.0, 150.0),), 0.0),
        (((0.5, 150.0),), 0.5),  # a monitor with an offset
        (((-1.0, 1.0), (-0.2, 0.2)), 0.0),
        (((-400.0, -100.0),), -250.0),
    ],
)
def test_a_range_covers_all_records_and_rests_at_zero_or_in_its_middle(
    ranges: tuple[tuple[float, float], ...], rest: float
) -> None:
    found = OperatingRange.of([record(*each) for each in ranges])
    assert found is not None
    assert found.low == pytest.approx(min(low for low, _ in ranges), abs=1e-3)
    assert found.high == pytest.approx(max(high for _, high in ranges), abs=1e-3)
    assert found.rest == pytest.approx(rest, abs=1e-3)
    widest = max(high - low for low, high in ranges)
    assert found.slew == pytest.approx(np.pi * 20.0 * widest, rel=1e-3)
    assert OperatingRange.of([record(5.0, 5.0)]) is None


def test_an_identified_model_says_what_its_records_covered(tmp_path: Path) -> None:
    found = identify([record(20.0, 140.0)], 'classical').model_file()
    found.save(tmp_path / 'model.yaml')
    read = ModelFile.load(tmp_path / 'model.yaml')
    assert read.provenance.voltage == OperatingRange.of([record(20.0, 140.0)])
    assert read.provenance.rate == pytest.approx(4000.0)


@pytest.mark.parametrize('wrong', [{'low': 3.0}, {'slew': 0.0}, {'rest': 200.0}, {'colour': 1.0}])
def test_an_impossible_range_in_a_file_is_refused(wrong: dict[str, float]) -> None:
    content = stage().to_dict()
    content['provenance']['voltage'].update(wrong)
    if 'low' in wrong:
        del content['provenance']['voltage']['high']
    with pytest.raises(ModelError, match=r'voltage|range'):
        ModelFile.parse(yaml.safe_dump(content))


def test_the_user_comes_first_then_the_plant_then_the_records() -> None:
    plant = {'low_v': 0.0, 'high_v': 130.0}
    found = operating_limits(stage(), low=30.0, plant=plant)
    assert found.limits == Limits(30.0, 130.0, 3000.0)
    assert (found.rest, found.warnings) == (80.0, ())
    assert rate_of(stage()) == 4000.0
    assert rate_of(stage(), 500.0) == 500.0


def test_a_model_without_the_information_keeps_narrow_limits_and_says_so() -> None:
    found = operating_limits(stage(voltage=None))
    assert found.limits == Limits()
    (sentence,) = found.warnings
    assert 'does not say' in sentence
    assert 'give low, high, slew' in sentence
    assert not operating_limits(stage(voltage=None), low=0.0, high=9.0, slew=1e3).warnings


def test_nothing_is_driven_by_a_model_that_names_no_voltages(tmp_path: Path) -> None:
    def driven(voltage: FloatArray) -> FloatArray:
        raise AssertionError('a voltage was sent')

    cases: list[tuple[dict[str, Any], str]] = [
        ({}, 'low, high and slew'),
        ({'low': 0.0, 'high': 9.0}, 'slew'),
        ({'slew': 1e3}, 'low and high'),
    ]
    for given, missing in cases:
        with pytest.raises(PiezoError, match=f'does not say at which .* or give {missing}$'):
            ph.investigate(stage(voltage=None), driven, out=tmp_path / 'out', **given)
    assert not (tmp_path / 'out').exists()


@pytest.mark.component
def test_a_library_for_voltages_that_nobody_states_warns(tmp_path: Path) -> None:
    with pytest.warns(UserWarning, match='the limits are -1.2 to 1.2 V'):
        ph.export(stage(voltage=None), tmp_path / 'library')


def test_bounds_of_the_attenuation_follow_the_range() -> None:
    settings = AttenuationSettings()
    small, large = settings.within(Limits()), settings.within(Limits(20.0, 140.0, 1.0))
    assert (small.largest_step, small.largest_correction) == pytest.approx((0.1, 0.5))
    assert (large.largest_step, large.largest_correction) == pytest.approx((5.0, 25.0))
    assert AttenuationSettings(largest_step=0.3).within(Limits()).largest_step == 0.3
    chain = Controllers(1e-3, Limits(20.0, 140.0, 1.0), stage(), attenuation=settings)
    decay = 1.0 / (2.0 * np.pi * 180.0 * 0.05)
    made = chain.attenuate().settings  # type: ignore[attr-defined]
    assert made == settings.within(chain.limits, decay)
    assert made.largest_correction == large.largest_correction
    assert made.settle == pytest.approx(2.5 * decay)


def test_what_is_limited_is_the_same_sentence_in_python_and_in_diagnostics() -> None:
    found = compensate(
        stage(), 'sine:frequency=30,amplitude=5e-6,offset=8e-6,duration=0.4', attenuation='none',
        slew=400.0,
    )  # fmt: skip
    limits = found.study.limits
    assert (limits.low, limits.high, limits.slew) == (20.0, 140.0, 400.0)
    words = limited(limits)['slew_limited']
    assert any(words in each for each in found.warnings)
    assert found.limited['feedforward']['slew_limited'] > 0
    assert words in repr(found)
    watchdog = Watchdog(Limiter(limits, 1e-3), 10, 0.0, 1.0)
    health = LinkHealth(limits, lambda: 0.0)
    seen = health.judge({'sample': 1, 'active': True}, {'slew_limited': 4}, watchdog)
    assert words in seen.message


def test_a_mode_that_the_loop_cannot_sample_is_said() -> None:
    assert above_nyquist(stage(180.0), 1e-3) == ()
    (sentence,) = above_nyquist(stage(800.0), 1e-3)
    assert '800 Hz' in sentence
    found = compensate(
        stage(800.0), 'sine:frequency=3,amplitude=2e-6,offset=8e-6,duration=0.5', rate=1000.0,
        attenuation='none',
    )  # fmt: skip
    assert sentence in found.warnings


def test_the_command_writes_the_voltage_and_prints_what_is_limited(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stage().save(tmp_path / 'model.yaml')
    path, out = str(tmp_path / 'model.yaml'), tmp_path / 'out'
    wanted = 'sine:frequency=30,amplitude=5e-6,offset=8e-6,duration=0.4'
    given = [
        '--model',
        path,
        '--plant',
        path,
        '--reference',
        wanted,
        '--set',
        'attenuation.enabled=false',
    ]
    assert main(['compensate', *given, '--slew', '400', '--out', str(out)]) == 0
    assert limited(Limits(20.0, 140.0, 400.0))['slew_limited'] in capsys.readouterr().out
    first, *rows = (out / 'voltage.csv').read_text('utf-8').splitlines()
    assert first.split(',') == ['time_s', 'voltage_V', 'displacement_m', 'reference_m']
    assert len(rows) == 1600
    voltage = np.array([float(row.split(',')[1]) for row in rows])
    assert voltage.min() >= 20.0
    assert voltage.max() <= 140.0
