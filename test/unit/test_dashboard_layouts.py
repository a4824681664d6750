"""Layouts of PlotJuggler and Foxglove name topics and fields that there are."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / 'tools'))

from write_docs import TYPES

ROOT = Path(__file__).resolve().parents[2]
MESSAGES = ROOT / 'src' / 'piezo_interfaces' / 'msg'
SPACE = '/piezo/'


def fields_of(kind: str) -> dict[str, str]:
    """Return type by name of the fields of one of our messages."""
    text = (MESSAGES / f'{kind}.msg').read_text(encoding='utf-8')
    rows = (line.split('#')[0].split() for line in text.splitlines())
    return {row[1]: row[0] for row in rows if len(row) >= 2}


def field_type(topic: str, field: str) -> str:
    """Return the type of a field of a topic, '' where there is none."""
    if not topic.startswith(SPACE) or topic.removeprefix(SPACE) not in TYPES:
        return ''
    kind = TYPES[topic.removeprefix(SPACE)]
    assert kind.startswith('piezo_interfaces/msg/')
    return fields_of(kind.rpartition('/')[2]).get(field, '')


def plotjuggler_series() -> list[str]:
    layout = ElementTree.parse(ROOT / 'config' / 'plotjuggler.xml').getroot()
    found = []
    for plot in layout.iter('plot'):
        for curve in plot.iter('curve'):
            across = plot.get('mode') == 'XYPlot'
            names = ('curve_x', 'curve_y') if across else ('name',)
            found += [str(curve.get(name)) for name in names]
    return found


def foxglove() -> dict[str, dict[str, object]]:
    text = (ROOT / 'config' / 'foxglove.json').read_text(encoding='utf-8')
    return dict(json.loads(text))


def foxglove_paths() -> list[str]:
    return re.findall(r'"value": "(/[^"]*)"', json.dumps(foxglove()))


def test_the_check_finds_what_is_wrong() -> None:
    assert field_type('/piezo/actuator/state', 'voltage') == 'float64'
    assert field_type('/piezo/actuator/state', 'voltge') == ''
    assert field_type('/piezo/actuator/stat', 'voltage') == ''
    assert field_type('/elsewhere/actuator/state', 'voltage') == ''


@pytest.mark.parametrize('series', plotjuggler_series())
def test_plotjuggler_names_numbers_that_are_published(series: Any) -> None:
    topic, _, field = series.rpartition('/')
    assert re.fullmatch(r'u?int\d+|float64|bool', field_type(topic, field))


@pytest.mark.parametrize('path', foxglove_paths())
def test_foxglove_names_numbers_that_are_published(path: Any) -> None:
    topic, _, field = path.partition('.')
    kind = field_type(topic, field.removesuffix('[:]'))
    assert re.fullmatch(r'u?int\d+|float64|bool', kind.removesuffix('[]'))
    assert kind.endswith('[]') == field.endswith('[:]')


def test_the_foxglove_layout_shows_every_panel_once() -> None:
    layout = foxglove()
    placed = re.findall(r'"(?:first|second)": "([^"]+)"', json.dumps(layout['layout']))
    assert sorted(placed) == sorted(layout['configById'])


def test_the_same_signals_stand_in_both() -> None:
    def topics(paths: list[str], mark: str) -> set[str]:
        return {path.rpartition(mark)[0] for path in paths}

    juggled = topics(plotjuggler_series(), '/')
    assert juggled == topics(foxglove_paths(), '.')
    assert len(juggled) == 8
