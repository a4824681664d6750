"""Pages, pictures and figures name and show what exists and was measured."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from piezo_hysteresis import models
from piezo_hysteresis.blocks import BLOCKS
from studies.per_frequency import METHODS, Row, measured, table

DOCS = Path(__file__).parents[2] / 'docs'
sys.path.insert(0, str(DOCS.parent / 'tools'))
import write_models  # noqa: E402


def test_every_model_and_block_is_on_the_page_of_models() -> None:
    page = (DOCS / 'models.md').read_text(encoding='utf-8')
    for name in models.NAMES:
        assert f'| `{name}` |' in page, name
    page = write_models.PARAMETERS.read_text(encoding='utf-8')
    for name, block in BLOCKS.items():
        assert f'| `{name}` | `{block.parameters[0].name}` | {block.parameters[0].unit} |' in page


def test_tables_and_pages_agree_with_the_blocks() -> None:
    pages = write_models.model_pages()
    written = [write_models.MODELS, write_models.PARAMETERS, write_models.EFFECTS]
    assert list(pages) == written, 'run python tools/write_docs.py'
    for path in written:
        assert pages[path] == path.read_text(encoding='utf-8')


def test_of_a_long_series_of_parameters_the_first_is_shown() -> None:
    shown = [q.name for q in write_models.shown_parameters(BLOCKS['prandtl_ishlinskii'])]
    assert shown == ['pi_range', 'w0', 'w1']
    assert [q.name for q in write_models.shown_parameters(BLOCKS['autoregressive'])] == [
        'c1',
        'c2',
    ]


def test_the_sections_are_of_the_effects_that_are_there() -> None:
    assert list(write_models.sections()) == sorted(models.EFFECT_NAMES)


def test_an_effect_without_a_section_gets_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = write_models.EFFECTS.read_text(encoding='utf-8')
    begin, end = page.index('## creep'), page.index('## drift')
    (tmp_path / 'effects.md').write_text(page[:begin] + page[end:], encoding='utf-8')
    monkeypatch.setattr(write_models, 'EFFECTS', tmp_path / 'effects.md')
    written = write_models.model_pages()[write_models.EFFECTS]
    assert written[:begin] + written[written.index('## drift') :] == page[:begin] + page[end:]
    assert '| `creep_pair` | `creep_pair` |' in written[begin : written.index('## drift')]


@pytest.mark.parametrize('name', models.EFFECT_NAMES)
def test_every_effect_has_a_section_that_matches_the_code(name: Any) -> None:
    page = write_models.sections()[name]
    for effect in models.described(name):
        assert f'`{effect.variant}`' in page
        assert effect.physics in page
        assert effect.experiment in page
        for other in effect.mistaken_for:
            assert f'[{other}](#{other})' in page
    for heading in ('Physical cause', 'Signature', 'Similar effects', 'Distinguishing experiment'):
        assert f'**{heading}.**' in page


def test_the_example_of_the_page_runs() -> None:
    page = (DOCS / 'models.md').read_text(encoding='utf-8')
    (code,) = re.findall(r'```python\n(.*?)```', page, re.S)
    scope: dict[str, Any] = {}
    exec(code, scope)
    displacement = scope['displacement']
    assert 1e-4 < abs(displacement).max() < 2e-4


ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / 'tools'))
import draw_effects  # noqa: E402


@pytest.fixture(scope='module')
def changes() -> dict[Any, Any]:
    """Return by effect what it changes at each drive [m]."""
    return {name: draw_effects.draw(name)[1] for name in models.EFFECT_NAMES}


def harmonic(changes: Any, name: Any, order: int) -> np.ndarray:
    """Return an amplitude of each drive, slow to fast [m]."""
    sizes = changes[name].items()
    return np.array([draw_effects.amplitude(change, order * f) for f, change in sizes])


@pytest.mark.component
@pytest.mark.parametrize('name', models.EFFECT_NAMES)
def test_every_section_shows_a_picture_of_a_change(changes: dict[Any, Any], name: Any) -> None:
    assert f'](pictures/effects/{name}.png)' in write_models.sections()[name]
    assert (ROOT / 'docs/pictures/effects' / f'{name}.png').stat().st_size > 10_000
    assert max(np.abs(change).max() for change in changes[name].values()) > 1e-8


@pytest.mark.parametrize('name', ['transport_delay', 'amplifier_lag', 'rate_dependence'])
def test_what_is_dynamic_grows_with_frequency(changes: dict[Any, Any], name: str) -> None:
    first = harmonic(changes, name, 1)
    assert np.all(np.diff(first) > 0)


@pytest.mark.parametrize('name', ['saturation', 'stiffness', 'nonlocal_memory', 'friction'])
def test_what_is_static_is_the_same_at_every_frequency(changes: dict[Any, Any], name: str) -> None:
    third = harmonic(changes, name, 3)
    assert third.min() > 1e-7
    np.testing.assert_allclose(third, third.mean(), rtol=0.1)


def test_odd_effects_have_no_even_harmonics_and_electrostriction_has(
    changes: dict[Any, Any],
) -> None:
    for name in ('saturation', 'stiffness', 'odd_harmonic'):
        assert harmonic(changes, name, 2).max() < 0.02 * harmonic(changes, name, 3).max()
    even = harmonic(changes, 'electrostriction', 2)
    np.testing.assert_allclose(even, harmonic(changes, 'electrostriction', 0), rtol=0.05)


def test_creep_shows_at_low_frequency_drift_in_the_mean_and_hum_on_no_harmonic(
    changes: dict[Any, Any],
) -> None:
    creep = harmonic(changes, 'creep', 1)
    assert np.all(np.diff(creep) < 0)
    slow = changes['drift'][draw_effects.DRIVES[0]]
    assert slow[-1] == pytest.approx(2 * slow[len(slow) // 2], rel=1e-2)
    hum = changes['mains_hum'][draw_effects.DRIVES[0]]
    assert draw_effects.rest(hum, draw_effects.DRIVES[0]) == pytest.approx(
        np.abs(hum).max(), rel=0.02
    )


sys.path.insert(0, str(ROOT / 'tools'))
import draw_tutorials  # noqa: E402


@pytest.mark.parametrize('name', draw_tutorials.NAMES)
def test_every_tutorial_of_the_verbs_shows_its_picture(name: Any) -> None:
    assert (
        f'](../pictures/tutorials/{name}.png)' in (draw_tutorials.PAGES / f'{name}.md').read_text()
    )
    assert (draw_tutorials.FOLDER / f'{name}.png').stat().st_size > 10_000


PAGE = Path(__file__).resolve().parents[2] / 'docs' / 'tutorials' / 'online.md'


def test_recorded_frequencies_are_apart_from_those_between() -> None:
    rows = [
        Row('1 Hz', True, (4e-6, 3e-6, 2e-6, 1e-6)),
        Row('3 Hz', False, (8e-6, 6e-6, 4e-6, 2e-6)),
        Row('7 + 19 Hz', False, (9e-6, 9e-6, 9e-6, 9e-6)),
    ]
    lines = table({'m': rows})
    assert lines[2] == '| recorded, median (worst) | m | 4 (4) | 3 (3) | 2 (2) | 1 (1) |'
    assert lines[3] == '| between, median (worst) | m | 8 (8) | 6 (6) | 4 (4) | 2 (2) |'
    assert lines[4] == '| 7 + 19 Hz | m | 9 | 9 | 9 | 9 |'


@pytest.mark.slow
def test_the_page_states_what_the_study_measures() -> None:
    stated = re.findall(r'^\| .*\| (?:Fujii 2018|rls_ud) \|.*$', PAGE.read_text('utf-8'), re.M)
    found = table({method: measured(method, 20.0, 6.0) for method in METHODS})[2:]
    for line, other in zip(stated, found, strict=True):
        assert line.split('|')[:3] == other.split('|')[:3]
        numbers = [[float(x) for x in re.findall(r'[\d.]+', row.split('|', 3)[3])]
                   for row in (line, other)]  # fmt: skip
        assert numbers[0] == pytest.approx(numbers[1], rel=0.05)
