"""Every field of every message has a description, and every number a unit."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[2] / 'src' / 'piezo_interfaces'
FILES = sorted(path for kind in ('msg', 'srv', 'action') for path in FOLDER.glob(f'{kind}/*'))
FIELD = re.compile(r'^(?P<kind>\w+(/\w+)?(\[\])?) +(?P<name>\w+) *(#(?P<words>.*))?$')
NUMBERS = ('float', 'int', 'uint')


@pytest.mark.parametrize('path', FILES, ids=lambda path: path.name)
def test_every_field_has_a_sentence_and_every_number_a_unit(path: Path) -> None:
    lines = path.read_text(encoding='utf-8').splitlines()
    assert lines[0].startswith('# ')
    fields = [FIELD.match(line) for line in lines if line[:1] not in ('#', '-', '')]
    assert all(fields)
    for field in fields:
        if field is None or field['kind'] == 'std_msgs/Header':
            continue
        words = field['words'] or ''
        assert words.strip(), f'{field["name"]} says nothing'
        if field['kind'].startswith(NUMBERS):
            assert re.search(r'\[[\w/^() ]+\]|in its unit', words), f'{field["name"]}: no unit'
