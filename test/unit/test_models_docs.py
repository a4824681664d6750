"""The pages name what exists: models, blocks, effects, parameters; their example runs."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

import pytest

from piezo_hysteresis import models
from piezo_hysteresis.blocks import BLOCKS

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
    written = [write_models.MODELS, write_models.PARAMETERS]
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


def test_no_page_is_of_an_effect_that_is_not_there() -> None:
    assert {path.stem for path in (DOCS / 'effects').glob('*.md')} == set(models.EFFECT_NAMES)


@pytest.mark.parametrize('name', models.EFFECT_NAMES)
def test_every_effect_has_a_page_that_matches_the_code(name: Any) -> None:
    page = (DOCS / 'effects' / f'{name}.md').read_text(encoding='utf-8')
    for effect in models.described(name):
        assert f'`{effect.variant}`' in page
        assert effect.physics in page
        assert effect.experiment in page
        for other in effect.mistaken_for:
            assert f'[{other}]({other}.md)' in page
    for heading in ('Physical cause', 'Signature', 'Similar effects', 'Distinguishing experiment'):
        assert f'**{heading}.**' in page


def test_the_example_of_the_page_runs() -> None:
    page = (DOCS / 'models.md').read_text(encoding='utf-8')
    (code,) = re.findall(r'```python\n(.*?)```', page, re.S)
    scope: dict[str, Any] = {}
    exec(code, scope)
    displacement = scope['displacement']
    assert 1e-4 < abs(displacement).max() < 2e-4
