"""Zeros that lie apart pass for no effect."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from piezo_hysteresis.discovery import discover
from piezo_hysteresis.discovery.data.dataset import split
from piezo_hysteresis.discovery.data.tones import annotated
from piezo_hysteresis.discovery.selection.start import zeros_apart
from piezo_hysteresis.identification.initial_conditions.revision import RecordAssumptions
from piezo_hysteresis.models import named
from piezo_hysteresis.records import Record
from piezo_sim.sweep import simulate

HIDDEN = {'effects.sensor_nonlinearity': True}
PLAN = [
    {'kind': 'sine', 'frequency': f, 'amplitude': a, 'duration': 1.0}
    for f, a in ((2, 1.0), (7, 0.5), (19, 1.0), (43, 0.7))
]
#: Shares of the largest stroke by which a sensor was shifted between the records.
SHIFTS = (0.05, -0.04, 0.0, 0.07)


@pytest.fixture(scope='module')
def records() -> list[Record]:
    return simulate('generic_bouc_wen', PLAN, HIDDEN, 2)


def shifted(records: list[Record]) -> list[Record]:
    stroke = max(float(np.ptp(r.displacement)) for r in records)
    return [
        replace(r, displacement=r.displacement + shift * stroke)
        for r, shift in zip(records, SHIFTS, strict=True)
    ]


@pytest.mark.slow
def test_zeros_that_lie_apart_pass_for_no_effect(records: list[Record]) -> None:
    data = split(annotated(shifted(records)))
    assert zeros_apart(RecordAssumptions(), data).zero == 'record'
    assert zeros_apart(RecordAssumptions(zero='common'), data).zero == 'common'
    found = discover(shifted(records), named('classical'), seed=1)
    assert [effect.name for effect in found.verdict.effects] == ['sensor_nonlinearity']
    assert found.verdict.held_out.after_in_floors < 1.1


def test_one_record_has_the_zero_of_its_model(records: list[Record]) -> None:
    assert zeros_apart(RecordAssumptions(), split(annotated(records[:1]))).zero == 'auto'
