"""The report in a real browser: plots are drawn, nothing is complained about or asked for."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import matplotlib.image
import numpy as np
import pytest

from piezo_hysteresis.identification import identify
from piezo_hysteresis.models import named
from piezo_hysteresis.records import Record
from piezo_hysteresis.reporting.identification_report import identification_page
from piezo_hysteresis.reporting.page import PageSection, table, write_report
from piezo_hysteresis.reporting.plots import (
    GREY,
    PALETTE,
    Curve,
    bars_before_after,
    loop_figure,
    spectrum_figure,
    trace_figure,
    xy_figure,
)

BROWSER = next(
    filter(None, map(shutil.which, ('chromium', 'chromium-browser', 'google-chrome'))), ''
)
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not BROWSER, reason='no Chromium: apt-get install chromium'),
]

FLAGS = (
    '--headless', '--no-sandbox', '--disable-gpu', '--disable-quic', '--no-first-run',
    '--disable-background-networking', '--disable-component-update', '--disable-sync',
    '--hide-scrollbars', '--virtual-time-budget=6000', '--enable-logging=stderr',
)  # fmt: skip


def photographed(page: Path, picture: Path, width: int, height: int = 1500) -> Any:
    """Show a page in the browser; return the picture and what the console says of faults."""
    done = subprocess.run(
        [BROWSER, *FLAGS, f'--user-data-dir={picture.parent / "profile"}',
         f'--window-size={width},{height}', f'--screenshot={picture}', f'file://{page}'],
        capture_output=True, text=True, timeout=120, check=True,
    )  # fmt: skip
    messages = re.findall(r'CONSOLE[^"]*"(.*)", source', done.stderr)
    assert any('document idle' in line for line in messages)  # Bokeh has drawn
    # the browser's own remark that a layout took two rounds is harmless
    faults = [line for line in messages if '[bokeh' not in line and 'ResizeObserver' not in line]
    return matplotlib.image.imread(picture), faults


def share(image: Any, colour: str) -> float:
    wanted = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255
    return float(np.mean(np.max(np.abs(image[..., :3] - wanted), axis=-1) < 0.04))


@pytest.mark.parametrize('width', [390, 1280], ids=['phone', 'desk'])
def test_a_browser_draws_every_plot_and_finds_no_fault(tmp_path: Path, width: int) -> None:
    time = np.arange(2000) * 1e-3
    u = np.sin(2 * np.pi * 5 * time)
    curves = [
        Curve('measured', u, 5e-5 * u**3),
        Curve('a model with a long name', u, 5e-5 * u),
        Curve('another', u, -5e-5 * u),
    ]
    figures = (
        loop_figure(curves, 'Loop', 'Cubic and straight.'),
        spectrum_figure([('a', u), ('b', u**3)], 1e-3, 'Lines', 'Odd.', fundamental=5.0),
        xy_figure(
            [Curve('c', np.arange(1.0, 5.0), 1e-6 * np.arange(1.0, 5.0), 'after')], 'Few decades',
            'One decade.', 'x', 'y', log_y=True, floor=5e-7,
        ),
        bars_before_after(['1 Hz'], [1e-6], [1e-7], 5e-8),
    )  # fmt: skip
    rows = table(('a', 'b'), [[1.0, 'long words ' * 20]] * 3)
    write_report(
        tmp_path / 'r.html', 'Title', 'Verdict.', [PageSection('One', '', figures, (rows,))]
    )
    image, faults = photographed(tmp_path / 'r.html', tmp_path / 'r.png', width)
    assert faults == []
    assert share(image, GREY) > 1e-3
    assert share(image, PALETTE[1]) > 1e-4  # of the page only the third curve has it
    # what is wider than a phone scrolls in its own box: the last column of pixels stays white
    assert np.all(image[:, -1, :3] == 1.0)


def test_the_report_of_an_identification_reads_on_a_phone(tmp_path: Path) -> None:
    model, time = named('classical'), np.arange(1200) * 1e-3
    voltage = np.sin(2 * np.pi * 5 * time)
    values = {'A1': 1.6e-4, 'A': 3e-5, 'A0': 0.0, 'beta': 1.2, 'gamma': 0.2, 'offset': 0.0}
    noise = 2e-8 * np.random.default_rng(1).standard_normal(time.size)
    y = model.respond(voltage, model.pack(values), 1e-3) + noise
    record = Record('a', 1e-3, voltage, y)
    found = identify([record], model, count=1)
    (tmp_path / 'r.html').write_text(identification_page([record], found))
    image, faults = photographed(tmp_path / 'r.html', tmp_path / 'r.png', 390, 5000)
    assert faults == []
    assert share(image, '#7f3b08') > 1e-3  # the diagonal
    assert np.all(image[:, -1, :3] == 1.0)


def test_on_paper_plots_are_whole_and_few_pages_are_white(tmp_path: Path) -> None:
    time = np.arange(2000.0) * 1e-3
    curves = [Curve('a', time, 1e-6 * np.sin(20 * time)), Curve('b', time, 1e-6 * np.cos(time))]
    figures = tuple(
        trace_figure(curves, f'Plot {k}', 'A caption of some words.') for k in range(6)
    )
    write_report(
        tmp_path / 'r.html', 'Title', 'Verdict.', [PageSection('One', 'Text. ' * 20, figures)]
    )
    subprocess.run(
        [BROWSER, *FLAGS, f'--user-data-dir={tmp_path / "profile"}', '--window-size=1280,900',
         f'--print-to-pdf={tmp_path / "r.pdf"}', f'file://{tmp_path / "r.html"}'],
        capture_output=True, timeout=120, check=True,
    )  # fmt: skip
    pages = re.findall(rb'/Type\s*/Page\b', (tmp_path / 'r.pdf').read_bytes())
    assert 2 <= len(pages) <= 3  # six plots, two or three to a page
