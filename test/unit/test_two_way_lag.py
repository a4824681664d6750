"""The measured difference between the ways of a scan, and the study of its causes."""

from __future__ import annotations

import numpy as np
import pytest

from piezo_hysteresis.identification.periods import two_way_lag
from piezo_hysteresis.records import Record
from studies.study import main
from studies.worlds.scans import Row, drawn, table

RATE = 5000.0


def scan(speed: float, *, cycles: int = 4, delay: float = 0.0, sign: float = 1.0) -> Record:
    t = np.arange(round(cycles * RATE / speed)) / RATE

    def triangle(at: np.ndarray) -> np.ndarray:
        return 80.0 * (1.0 - np.abs(2.0 * ((speed * at) % 1.0) - 1.0)) + 10.0

    return Record('scan', 1 / RATE, triangle(t), sign * 1e-7 * triangle(t - delay))


@pytest.mark.parametrize('speed', [0.7, 3.0, 20.0])
@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_a_delay_is_read_at_any_speed(speed: float, sign: float) -> None:
    lag = two_way_lag(scan(speed, delay=1.3e-3, sign=sign))
    assert lag is not None
    assert lag.delay_s == pytest.approx(1.3e-3, rel=0.02)
    assert lag.difference_m == pytest.approx(2 * 80e-7 * 2 * speed * 1.3e-3, rel=0.02)
    assert lag.first_cycle_m is None


def test_the_first_cycle_is_told_apart() -> None:
    for cause, first in (('first_cycle', True), ('hysteresis', False), ('play', False)):
        for number in (17, 23):
            drive = drawn(cause, 4, number)
            if len(drive.scans[1]) * drive.scans[1].dt < 3.0 / float(drive.scans[1].name[5:-2]):
                continue
            lags = [two_way_lag(each) for each in drive.scans]
            assert all(lag is not None for lag in lags)
            found = [lag.first_cycle_m is not None for lag in lags if lag is not None]
            assert all(found) if first else not any(found)


def test_the_share_is_that_of_the_cycles_behind_the_first() -> None:
    settled = drawn('hysteresis', 4, 21).scans[1]
    cycle = settled.section(0, round(1 / (float(settled.name[5:-2]) * settled.dt)))
    y = np.tile(cycle.displacement, 4)
    y[: len(cycle) // 2] *= 1.3  # a longer way from rest
    lags = [
        two_way_lag(Record('scan', settled.dt, np.tile(cycle.voltage, 4), each))
        for each in (y, np.tile(cycle.displacement, 4))
    ]
    assert lags[0] is not None
    assert lags[1] is not None
    assert lags[0].share == pytest.approx(lags[1].share, rel=0.02)
    assert lags[0].delay_s == pytest.approx(lags[1].delay_s, rel=0.02)
    assert lags[0].first_cycle_m is not None


def test_a_record_without_two_ways_has_none() -> None:
    t = np.arange(1000) / RATE
    rest = np.zeros(1000)
    for u in (t, np.zeros(1000), np.where(t < 0.1, 0.0, 1.0)):
        assert two_way_lag(Record('one', 1 / RATE, u, u)) is None
    assert two_way_lag(Record('still', 1 / RATE, np.sin(9 * t), rest)) is None


def test_rows_state_right_and_wrong() -> None:
    rows = [
        Row('delay', 1e-3, 1.1e-3, ('transport_delay',), False, 1.0),
        Row('first_cycle', float('nan'), float('nan'), ('hysteresis',), False, 1.0),
        Row('first_cycle', float('nan'), float('nan'), ('hysteresis',), True, 1.0),
        Row('creep', 0.02, 0.02, ('drift', 'creep'), False, 1.0),
    ]
    assert [row.right for row in rows] == [True, False, True, False]
    assert table(rows).startswith('2 of 4 right')


@pytest.mark.slow
def test_the_study_names_a_delay_and_a_lag(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['scans', '--seed', '7', '--drives', '2', '--time-limit', '60']) == 0
    assert capsys.readouterr().out.startswith('2 of 2 right')
