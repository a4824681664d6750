"""One name, one thing; what is known of a block stands with it; public names load."""

from __future__ import annotations

import ast
import importlib
from ast import Module
from collections import Counter, defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from piezo_hysteresis.blocks import BLOCKS, EFFECTS

ROOT = Path(__file__).parents[2] / 'src'


def classes() -> defaultdict[str, list[tuple[str, ...]]]:
    """Return the files in which each public class is defined."""
    found = defaultdict(list)
    for path in sorted(ROOT.rglob('*.py')):
        for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
            if isinstance(node, ast.ClassDef) and not node.name.startswith('_'):
                found[node.name].append(path.relative_to(ROOT).parts)
    return found


@pytest.mark.component
def test_no_class_is_called_like_another() -> None:
    assert {name: places for name, places in classes().items() if len(places) > 1} == {}


# they say nothing of what they hold
VAGUE = {'told', 'said', 'wanted', 'words'}


def variables(tree: Module) -> Iterator[str]:
    """Return the names of the variables that the functions of a module set."""
    for function in ast.walk(tree):
        if isinstance(function, ast.FunctionDef):
            for node in ast.walk(function):
                if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
                    yield node.id


@pytest.mark.component
def test_no_variable_of_the_source_has_a_meaningless_name() -> None:
    found = {}
    for path in sorted(ROOT.rglob('*.py')):
        names = set(variables(ast.parse(path.read_text(encoding='utf-8')))) & VAGUE
        if names:
            found[str(path.relative_to(ROOT))] = sorted(names)
    assert found == {}


def private_uses(tree: Module) -> Any:
    """Return attributes and imports of others that begin with an underscore."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and not isinstance(node.ctx, ast.Store):
            own = isinstance(node.value, ast.Name) and node.value.id in ('self', 'cls', 'os')
            names = [] if own else [node.attr]
        elif isinstance(node, ast.ImportFrom):
            names = [alias.name for alias in node.names]
        else:
            continue
        yield from (n for n in names if n.startswith('_') and not n.startswith('__'))


@pytest.mark.component
def test_tests_use_what_is_public() -> None:
    of_others = {'_replace', '_asdict', '_fields', '_repr_html_'}  # tuples, notebooks
    found = {}
    for path in sorted((ROOT.parent / 'test').rglob('*.py')):
        # one slows the compiler itself down, one ends a process in the order of Python's own end
        if path.name in ('sitecustomize.py', 'fork_server.py'):
            continue
        used = set(private_uses(ast.parse(path.read_text(encoding='utf-8')))) - of_others
        if used:
            found[path.name] = sorted(used)
    assert found == {}


def test_no_test_file_is_called_like_another() -> None:
    """Pytest takes a second one for the first, and refuses to collect the whole of test/."""
    files = [path.name for path in Path(__file__).parents[1].rglob('test_*.py')]
    assert sorted(name for name in set(files) if files.count(name) > 1) == []


def test_no_module_is_called_like_another() -> None:
    """A verb may be called like the module that does what it says, ``identify``."""
    package = ROOT / 'piezo_hysteresis' / 'piezo_hysteresis'
    modules = [path for path in package.rglob('*.py') if path.stem[:2] != '__']
    names = Counter(path.stem for path in modules if path.parent.name != 'cli')
    assert [name for name, count in names.items() if count > 1] == []


CORE = Path(__file__).parents[2] / 'src' / 'piezo_hysteresis' / 'piezo_hysteresis'
# Where blocks are named: their own room, and the table of models that are made of them.
OWN = ('blocks/', 'models/named.py', 'common/recipes.py')  # the last: of what named models consist
# Words that happen to be the name of a block, and what they mean there.
OTHER_MEANING = {
    'mode': ('nodes/', 'dashboard/', 'parameters/', 'cli/loop.py'),  # parameter of the excitation
    'resonance': ('cli/compensate.py',),  # an option of the attenuation
    'bouc_wen': ('identification/rls_ud.py',),  # a kind of recursion
}
LABELS = {  # of a line in a figure or a text
    'mode': ('reporting/identification_report.py', 'axes/modal_search.py'),
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


PACKAGES = ('piezo_sim', 'piezo_hysteresis', 'piezo_hysteresis.discovery')


@pytest.mark.parametrize('package', PACKAGES)
def test_every_public_name_can_be_loaded(package: str) -> None:
    module = importlib.import_module(package)
    assert module.__all__
    for name in module.__all__:
        assert getattr(module, name) is not None
