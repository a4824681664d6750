"""The bench of exported libraries: its loops agree, and its page says what it found."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from bench import export, export_beside
from piezo_hysteresis.models import ModelFile, named

pytestmark = pytest.mark.slow


def test_the_library_tracks_like_compensate_on_the_same_actuator(tmp_path: Path) -> None:
    model = named('bouc_wen_mode')
    path = tmp_path / 'model.yaml'
    ModelFile(model, {**model.defaults(), 'natural_frequency': 68.0}).save(path)
    offline = export_beside.offline(ModelFile.load(path), 900)
    library, alone = export_beside.library(path, tmp_path / 'lib', 900, 1000)
    assert library.rms == offline.rms
    assert library.rms is not None
    assert library.rms > 0.0
    assert offline.cpu > library.cpu > alone.cpu


def test_the_page_shows_the_figures_of_the_last_run() -> None:
    found = json.loads(export.FIGURES.read_text('utf-8'))
    page = export.PAGE.read_text('utf-8')
    assert export.written(page, found) == page
    none, forward, both = found['example']
    assert none > 10.0 * forward > 100.0 * both  # um; the three orders of the demo
    assert found['steps']['inverse + afc of 5 orders + PID + limits']['median_ns'] < 2000.0
    errors = {row['name']: row['rms'] for row in found['beside'] if row['rms'] is not None}
    assert len(errors) == 4
    for error in errors.values():
        assert error == pytest.approx(errors['`compensate`'], rel=1e-6)
    readme = (export.ROOT / 'README.md').read_text('utf-8')
    (figure,) = re.findall(r'takes ([\d.]+) µs in the median', readme)
    step = found['steps']['inverse + afc of 5 orders + PID + limits']['median_ns']
    assert float(figure) == pytest.approx(1e-3 * step, abs=0.051)
