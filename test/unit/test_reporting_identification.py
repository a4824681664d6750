"""The report of `identify`: its verdict agrees with the numbers, and the next step is on top."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from piezo_hysteresis.cli.main import main
from piezo_hysteresis.identification import identify
from piezo_hysteresis.identification.identify import Identification
from piezo_hysteresis.models import named
from piezo_hysteresis.records import Record, RecordInfo, write_csv
from piezo_hysteresis.reporting.identification_report import (
    harmonics,
    identification_page,
    next_section,
    sentence_of,
    where_section,
)

DT = 1e-3
VALUES = {'A1': 1.6e-4, 'A': 3e-5, 'A0': 0.0, 'beta': 1.2, 'gamma': 0.2, 'offset': 2e-6}


def sine(frequency: float, added: float = 0.0) -> Record:
    """Simulate a classical actuator; `added` is an amplitude at three times the frequency [m]."""
    model, time = named('classical'), np.arange(1500) * DT
    voltage = np.sin(2 * np.pi * frequency * time)
    y = model.respond(voltage, model.pack(VALUES), DT)
    y += 2e-8 * np.random.default_rng(3).standard_normal(time.size)
    y += added * np.sin(6 * np.pi * frequency * time)
    info = RecordInfo(excitation='sine', frequency=frequency, amplitude=1.0, warm_up=0.2)
    return Record(f'sine_{frequency:g}Hz', DT, voltage, y, info=info)


@pytest.fixture(scope='module')
def records() -> list[Record]:
    return [sine(4.0), sine(8.0), sine(10.0, added=1e-6)]


@pytest.fixture(scope='module')
def found(records: list[Record]) -> Identification:
    return identify(records, named('classical'), count=1)


def text_of(page: str) -> str:
    body = re.sub(r'<(script|style)\b.*?</\1>', ' ', page, flags=re.DOTALL)
    return ' '.join(re.sub(r'<[^>]+>', ' ', body).split())


def test_the_verdict_is_that_of_the_worst_record(found: Identification) -> None:
    worst = max(found.records, key=lambda row: row.nrmse_percent)
    text = sentence_of(found)
    assert worst.record == 'sine_10Hz'
    assert f'{1e6 * worst.free_run_rms:.3g} µm rms' in text
    assert 'the model is incomplete' in text


def test_the_verdict_warns_of_what_cannot_be_used(found: Identification) -> None:
    assert 'did not converge' in sentence_of(replace(found, converged=False))
    rows = (replace(found.records[0], free_run_rms=np.inf, nrmse_percent=np.inf),)
    assert 'diverges' in sentence_of(replace(found, records=(*rows, *found.records[1:])))
    quiet = replace(found, noise_floor=found.records[2].free_run_rms)
    assert 'lacks' not in sentence_of(quiet)


def test_what_comes_next_depends_on_what_was_found(found: Identification) -> None:
    first = next_section(found, ['sweep'], 'out/own').text.splitlines()[0]
    assert f'discover sweep --baseline {found.chain.name} ' in first
    quiet = replace(found, noise_floor=found.records[2].free_run_rms)
    assert 'validate' in next_section(quiet).text.splitlines()[0]


@pytest.mark.component
def test_the_page_has_its_order_and_the_location_of_the_error(
    records: list[Record], found: Identification
) -> None:
    page = identification_page(records, found, data=['sweep'])
    titles = re.findall(r'<h2>(.*?)</h2>', page)
    assert titles == [
        'Measured and simulated displacement',
        'Error by record and harmonic',
        'Parameters',
        'Parameter correlations',
        'Next steps',
    ]
    words = text_of(page)
    largest = re.search(r'sine_10Hz (?:[\d.]+ ){4}3×: ([\d.]+) µm', words)
    assert largest
    assert float(largest.group(1)) == pytest.approx(0.8, abs=0.3)  # what was added, less the fit
    for name in found.std:
        assert name in words
    i, j = np.unravel_index(
        np.argmax(np.abs(found.correlation - np.eye(len(found.names)))), found.correlation.shape
    )
    assert f'{found.correlation[i, j]:+.3f}' in words
    shown = re.sub(r'<(script|style)\b.*?</\1>', ' ', page, flags=re.DOTALL)
    assert re.findall(r'(?:src|href)=', shown) == []


def test_harmonics_of_known_size() -> None:
    time = np.arange(1003) * DT
    error = 3.0 + 2.0 * np.cos(2 * np.pi * 5 * time) - 0.5 * np.sin(2 * np.pi * 15 * time)
    sizes = harmonics(error, 5.0, DT)
    assert sizes[0] == pytest.approx(3.0)
    assert sizes[1] == pytest.approx(2.0)
    assert sizes[3] == pytest.approx(0.5)
    assert sizes[2] == pytest.approx(0.0, abs=1e-9)
    assert harmonics(error[:100], 5.0, DT) == {}


@pytest.mark.component
def test_the_verb_writes_the_report_next_to_the_model(
    tmp_path: Path, records: list[Record], capsys: pytest.CaptureFixture[str]
) -> None:
    write_csv(tmp_path / 'mine.csv', records[0])
    out = tmp_path / 'out'
    words = ['identify', str(tmp_path / 'mine.csv'), '--model', 'classical', '--out', str(out)]
    assert main(words) == 0
    assert str(out / 'report.html') in capsys.readouterr().out
    page = (out / 'report.html').read_text()
    row = json.loads((out / 'summary.json').read_text())['records'][0]
    assert f'{1e6 * row["free_run_rms_m"]:.3g} µm rms' in page
    assert str(out / 'model.yaml') in text_of(page)


def test_one_report_has_one_worst_record(records: list[Record], found: Identification) -> None:
    """The record of the sentence is drawn, also if another has the larger error in µm."""
    rows = (replace(found.records[0], free_run_rms=9e-6), *found.records[1:])
    simulated = {each.name: np.zeros_like(each.displacement) for each in records}
    section = where_section(records, replace(found, records=rows), simulated)
    drawn = ' '.join(each.caption for each in section.figures)
    assert 'sine_10Hz' in drawn
    assert 'sine_4Hz' not in drawn
