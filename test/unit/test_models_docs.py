"""The pages name what exists: models, blocks, effects, parameters; their example runs."""

import re
from pathlib import Path

import pytest

from piezo_hysteresis import models
from piezo_hysteresis.blocks import BLOCKS

DOCS = Path(__file__).parents[2] / 'docs'


def test_every_model_and_block_is_on_the_page_of_models():
    page = (DOCS / 'models.md').read_text(encoding='utf-8')
    for name in models.NAMES:
        assert f'| `{name}` |' in page, name
    listed = set(re.findall(r'^\| `(\w+)` \| `\w+` \| [^|]* \| [-+.\de]+ \|', page, re.M))
    assert listed | {'nonlocal_memory_fine'} == set(BLOCKS)


def test_the_parameter_table_has_the_units_and_bounds_of_the_code():
    page = (DOCS / 'models.md').read_text(encoding='utf-8')
    row = re.compile(r'^\| `(\w+)` \| `(\w+)` \| (\S+) \| (\S+) \| (\S+) \.\. (\S+) \|', re.M)
    rows = row.findall(page)
    assert len(rows) > 80
    for block, name, unit, default, low, high in rows:
        parameter = next(q for q in BLOCKS[block].parameters if q.name == name)
        assert unit == parameter.unit, (block, name)
        for text, value in ((default, 'default'), (low, 'low'), (high, 'high')):
            assert text == f'{getattr(parameter, value):g}', (block, name, value)


@pytest.mark.parametrize('name', models.EFFECT_NAMES)
def test_every_effect_has_a_page_that_matches_the_code(name):
    page = (DOCS / 'effects' / f'{name}.md').read_text(encoding='utf-8')
    for effect in models.described(name):
        assert f'`{effect.variant}`' in page
        assert effect.physics in page
        assert effect.experiment in page
        for other in effect.mistaken_for:
            assert f'[{other}]({other}.md)' in page
    for heading in ('What it is', 'How it shows', 'What it is mistaken for', 'What settles it'):
        assert f'**{heading}.**' in page
    assert {path.stem for path in (DOCS / 'effects').glob('*.md')} == set(models.EFFECT_NAMES)


def test_the_example_of_the_page_runs():
    page = (DOCS / 'models.md').read_text(encoding='utf-8')
    (code,) = re.findall(r'```python\n(.*?)```', page, re.S)
    scope: dict[str, object] = {}
    exec(code, scope)
    displacement = scope['displacement']
    assert 1e-4 < abs(displacement).max() < 2e-4
