"""The same seed gives the same verdict, with any number of workers."""

from __future__ import annotations

import json
from typing import Any

import pytest

from piezo_hysteresis.discovery import discover
from piezo_hysteresis.models import named
from piezo_hysteresis.records import Record
from piezo_sim.sweep import simulate


def records() -> list[Record]:
    plan = [
        {'kind': 'sine', 'frequency': f, 'amplitude': a, 'duration': 1.0}
        for f, a in ((2, 1.0), (9, 1.0), (31, 1.0), (9, 0.5))
    ]
    hidden = {'effects.transport_delay': True, 'amplifier.delay': 0.0015}
    return simulate('generic_bouc_wen', plan, hidden, 3)


def verdict(data: list[Record], workers: int, seed: int = 11) -> dict[str, Any]:
    found = discover(data, named('classical'), seed=seed, workers=workers).verdict.to_dict()
    assert found.pop('seconds') > 0.0
    return found


@pytest.mark.component
def test_workers_do_not_change_the_verdict() -> None:
    data = records()
    one, two = verdict(data, 1), verdict(data, 2)
    assert one['verdict'] == 'named'
    # bit for bit: the order of sums must not depend on which thread came first
    assert json.dumps(one) == json.dumps(two)
