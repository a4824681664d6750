"""What is known of an effect or block stands with it; no other room calls one by its name."""

from __future__ import annotations

import ast
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from piezo_hysteresis.blocks import BLOCKS, EFFECTS

CORE = Path(__file__).parents[2] / 'src' / 'piezo_hysteresis' / 'piezo_hysteresis'
# Where blocks are named: their own room, and the table of models that are made of them.
OWN = ('blocks/', 'models/named.py', 'common/recipes.py')  # the last: of what named models consist
# Words that happen to be the name of a block, and what they mean there.
OTHER_MEANING = {
    'mode': ('nodes/', 'dashboard/', 'parameters/', 'cli/loop.py'),  # parameter of the excitation
    'resonance': ('cli/compensate.py',),  # an option of the attenuation
    'bouc_wen': ('identification/rls_ud.py',),  # a kind of recursion
}
LABELS = {  # of a line in a figure
    'mode': ('reporting/identification_report.py',),
    'resonance': ('reporting/demo_report.py',),
}


def names() -> set[str]:
    """Return the names that can only mean a block or an effect; parameters have names, too."""
    known = {*BLOCKS, *(e.name for e in EFFECTS), *(e.variant for e in EFFECTS)}
    parameters = {q.name for block in BLOCKS.values() for q in block.parameters}
    return known - parameters - {'input', 'gain'}


def literals(path: Path) -> Iterator[Any]:
    """Return line and text of every string in the code of a file, docstrings left out."""
    tree = ast.parse(path.read_text(encoding='utf-8'))
    docstrings = {
        id(node.body[0].value)
        for node in ast.walk(tree)
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef)
        and node.body
        and isinstance(node.body[0], ast.Expr)
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and id(node) not in docstrings:
            yield node.lineno, str(node.value)


def named_outside() -> defaultdict[str, list[str]]:
    found = defaultdict(list)
    known = names()
    for path in sorted(CORE.rglob('*.py')):
        place = path.relative_to(CORE).as_posix()
        if place.startswith(OWN):
            continue
        for line, text in literals(path):
            excused = (*OTHER_MEANING.get(text, ()), *LABELS.get(text, ()))
            if text in known and not (excused and place.startswith(excused)):
                found[place].append(f'{line}: {text}')
    return found


@pytest.mark.component
def test_no_other_room_names_a_block_or_an_effect() -> None:
    assert dict(named_outside()) == {}


def test_a_name_that_is_written_elsewhere_is_noticed(tmp_path: Path) -> None:
    file = tmp_path / 'other.py'
    file.write_text('"""creep"""\nLIST = ("creep", "mode")\n')
    assert [text for _, text in literals(file) if text in names()] == ['creep', 'mode']


def test_a_record_at_rest_does_not_determine_a_curved_sensor() -> None:
    from piezo_hysteresis.blocks.effect import Residual
    from piezo_hysteresis.blocks.sensor_curve import guess

    still = np.zeros(100)
    seen = Residual(still, still, np.linspace(-1e-9, 1e-9, 100), 1e-3, 0.0, 0.0, {})
    assert guess(seen) == []
