"""Undetermined parts are omitted or held with a message; determined parts are kept."""

from __future__ import annotations

import numpy as np
import pytest

from piezo_hysteresis.identification import identify
from piezo_hysteresis.identification.identify import Identification
from piezo_hysteresis.models import ModelFile, name_of, named
from piezo_hysteresis.records import Record

LOOP = {'A1': 140e-6, 'A': 60e-6, 'beta': 1.2, 'gamma': 0.3, 'offset': 3e-6}


def identified(model: str, rate: float, **more: float) -> Identification:
    """Return `bouc_wen_mode` identified from records of another chain."""
    chain, rng = named(model), np.random.default_rng(1)
    packed = chain.pack({**chain.defaults(), **LOOP, **more})
    records = []
    for amplitude in (0.4, 1.0):
        u = amplitude * np.sin(2 * np.pi * 5.0 * np.arange(1200) / rate)
        y = chain.respond(u, packed, 1.0 / rate) + 2e-8 * rng.standard_normal(u.size)
        records.append(Record(f'{amplitude:g} V', 1.0 / rate, u, y))
    return identify(records, named('bouc_wen_mode'), count=2)


@pytest.mark.component
def test_a_mode_that_no_record_shows_is_omitted_and_reported() -> None:
    found = identified('classical', 2000.0)
    assert found.chain.name == 'classical'
    assert 'natural_frequency' not in found.values
    assert found.values['A1'] == pytest.approx(LOOP['A1'], rel=0.01)
    assert all(row.free_run_rms < 2.2e-8 for row in found.records)
    (words,) = found.left_out
    assert words in found.warnings
    assert 'the block mode, which is removed' in words
    saved = ModelFile.parse(found.model.text())
    assert saved.provenance.notes['left_out'] == words


def test_a_mode_that_records_show_stays() -> None:
    found = identified('bouc_wen_mode', 1000.0, natural_frequency=62.0, damping_ratio=0.03)
    assert found.left_out == ()
    assert found.values['natural_frequency'] == pytest.approx(62.0, rel=0.01)


@pytest.mark.component
def test_of_values_that_only_do_something_together_one_is_held() -> None:
    found = identified('classical+amplifier_lag', 1000.0, lag_time=0.02)
    (words,) = found.left_out
    assert 'is held at' in words
    (held,) = set(found.chain.held) - {'A0'}
    assert ModelFile.parse(found.model.text()).model.held[held] == found.values[held]
    late = found.values['damping_ratio'] / (np.pi * found.values['natural_frequency'])
    assert late + found.sampling_offset == pytest.approx(0.02, rel=0.3)


def test_a_chain_is_called_what_holds_the_same() -> None:
    for name in ('classical', 'modified', 'bouc_wen_mode', 'prandtl_ishlinskii+creep'):
        assert name_of(named(name)) == name
    bare = named('linear_mode')
    for block in bare.blocks[1:]:
        bare = bare.without(block)
    assert name_of(bare) == ''
