"""What is true of the simulated world must not stand in what finds out about it.

No import shows a formula that was copied, so the sources are read.
"""

from __future__ import annotations

import ast
from collections import defaultdict
from pathlib import Path

import pytest

from piezo_hysteresis.blocks import BLOCKS, EFFECTS
from piezo_hysteresis.parameters.node_tables import (
    ATTENUATION,
    FEEDBACK,
    FEEDFORWARD,
    IDENTIFICATION,
)
from piezo_sim.presets import load_preset, preset_names

SOURCES = Path(__file__).parents[2] / 'src'
WORLD = SOURCES / 'piezo_sim' / 'piezo_sim'
OURS = SOURCES / 'piezo_hysteresis' / 'piezo_hysteresis'
# Factors of textbooks and of integration schemes, which everybody writes.
TEXTBOOK = {0.0, 0.5, 1.0, 2.0, 3.0, 4.0, 6.0, 8.0}


class Nameless(ast.NodeTransformer):
    """Calls what a formula speaks of a, b, c in the order in which it does."""

    def __init__(self) -> None:
        self.known: dict[str, str] = {}

    def generic_visit(self, node: ast.AST) -> ast.AST:
        if isinstance(node, ast.Name | ast.Attribute | ast.Subscript):
            word = ast.unparse(node)
            return ast.Name(id=self.known.setdefault(word, f'v{len(self.known)}'))
        return super().generic_visit(node)


def formulas(folder: Path) -> dict[str, list[str]]:
    """Return the assignments and answers that hold a number of their own, without their names."""
    found = defaultdict(list)
    for path in sorted(folder.rglob('*.py')):
        for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
            if not isinstance(node, ast.Assign | ast.AugAssign | ast.Return) or not node.value:
                continue
            parts = list(ast.walk(node.value))
            numbers = {
                float(each.value)
                for each in parts
                if isinstance(each, ast.Constant)
                and isinstance(each.value, int | float)
                and not isinstance(each.value, bool)
            }
            operations = sum(isinstance(each, ast.BinOp) for each in parts)
            if operations < 2 or numbers <= TEXTBOOK:
                continue
            text = ast.unparse(node.value)
            bare = ast.unparse(Nameless().visit(ast.parse(text, mode='eval')))
            found[bare].append(f'{path.name}:{node.lineno}: {text}')
    return found


@pytest.mark.component
@pytest.mark.parametrize('room', ['blocks', 'models', 'discovery', 'compensation'])
def test_no_formula_with_a_number_of_its_own_is_in_both(room: str) -> None:
    world, ours = formulas(WORLD), formulas(OURS / room)
    assert world
    assert {bare: (world[bare], ours[bare]) for bare in world.keys() & ours.keys()} == {}


def test_a_copied_guard_would_be_found(tmp_path: Path) -> None:
    guard = '    stretch = 0.8 * stretch / (0.8 - stretch)\n'
    (tmp_path / 'block.py').write_text(
        f'def f(stretch, bent):\n{guard}'.replace('stretch', 'bent')
    )
    assert formulas(WORLD).keys() & formulas(tmp_path).keys()


def truths() -> dict[str, set[float]]:
    """Return the numbers of all presets, by the last part of their names."""
    found = defaultdict(set)
    for name in preset_names():
        for key, value in load_preset(name).parameters.items():
            if value:
                found[key.rpartition('.')[2]].add(value)
    return found


def test_no_start_or_default_is_the_truth_of_a_preset() -> None:
    known = truths()
    modes = known['natural_frequency'] | known['frequency']
    dampings = known['damping_ratio']
    assert {68.0, 353.3} <= modes
    assert 0.015 in dampings
    wrong = []
    for block in BLOCKS.values():
        for row in block.parameters:
            if 'frequency' in row.name and modes & {row.default, row.scale}:
                wrong.append(f'{block.name}.{row.name}')
            if 'damping' in row.name and dampings & {row.default, row.scale}:
                wrong.append(f'{block.name}.{row.name}')
    for effect in EFFECTS:
        for values in effect.starts:
            for name, value in values.items():
                if value in (modes if 'frequency' in name else dampings if 'damp' in name else ()):
                    wrong.append(f'{effect.name} ({effect.variant}): {name}')
    for table in (FEEDFORWARD, ATTENUATION, FEEDBACK, IDENTIFICATION):
        for spec in table.specs:
            word = spec.name.rpartition('.')[2]
            if word in ('natural_frequency', 'damping_ratio') and spec.default in known[word]:
                wrong.append(spec.name)
    assert wrong == []
