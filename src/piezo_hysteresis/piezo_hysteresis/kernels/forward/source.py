"""Analysis of the source of a kernel: arguments, calls and use of parameters."""

from __future__ import annotations

import ast
import inspect
import textwrap
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from typing import Any

#: Names of the input and of the parameters of a kernel.
INPUT, PARAMETERS = 'x', 'p'
#: What makes an array.
ARRAYS = ('scratch', 'zeros', 'empty', 'empty_like', 'zeros_like')
#: Hints of single numbers, and those of them that have no derivative.
NUMBERS, WHOLE = {'int', 'float', 'bool'}, {'int', 'bool'}


class NotDifferentiable(Exception):
    """A kernel uses something that has no rule here."""


@cache
def definition(function: Callable[..., Any]) -> ast.FunctionDef:
    """Return the syntax tree of a function, compiled or not."""
    source = inspect.getsource(getattr(function, 'py_func', function))
    found = ast.parse(textwrap.dedent(source)).body[0]
    assert isinstance(found, ast.FunctionDef)
    return found


def hints_of(function: Callable[..., Any]) -> dict[str, str]:
    """Return the hint of every argument; one without is a number."""
    arguments = definition(function).args.args
    return {a.arg: ast.unparse(a.annotation) if a.annotation else 'float' for a in arguments}


def answer_of(function: Callable[..., Any]) -> str:
    """Return the type hint of the return value of a function."""
    hint = definition(function).returns
    return ast.unparse(hint) if hint else 'None'


def space_of(function: Callable[..., Any]) -> dict[str, Any]:
    """Return the namespace of a Python function."""
    cells = [cell.cell_contents for cell in function.__closure__ or ()]
    return {**function.__globals__, **dict(zip(function.__code__.co_freevars, cells, strict=True))}


def called_in(node: ast.AST, space: Mapping[str, Any]) -> Callable[..., Any] | None:
    """Return the called function if it has a source that can be differentiated."""
    if not isinstance(node, ast.Call) or not isinstance(node.func, ast.Name):
        return None
    found = space.get(node.func.id)
    is_ours = inspect.isfunction(getattr(found, 'py_func', found)) and node.func.id not in ARRAYS
    return found if is_ours else None


def names_in(node: ast.AST) -> Iterator[str]:
    """Yield every name in an expression."""
    return (each.id for each in ast.walk(node) if isinstance(each, ast.Name))


def base_of(node: ast.expr) -> str:
    """Return the name of the array that an expression indexes at any depth; else ''."""
    while isinstance(node, ast.Subscript):
        node = node.value
    return node.id if isinstance(node, ast.Name) else ''


def numbers_alone(function: Callable[..., Any]) -> bool:
    """Return whether a function takes numbers and returns one, or a tuple written as such."""
    if not set(hints_of(function).values()) <= NUMBERS:
        return False
    hint, tree = answer_of(function), definition(function)
    returns = [each.value for each in ast.walk(tree) if isinstance(each, ast.Return)]
    several = hint.startswith('tuple[') and all(isinstance(r, ast.Tuple) for r in returns)
    return hint == 'float' or several


def passes_unchanged(function: Callable[..., Any], call: ast.Call) -> bool:
    """Return whether a call passes input, output, state and parameters unchanged."""
    pairs = zip(hints_of(function), call.args, strict=True)
    same = {name for name, each in pairs if ast.unparse(each) == name}
    return {INPUT, 'y', 'state', PARAMETERS} <= same


@cache
def names_each(kernel: Callable[..., Any]) -> bool:
    """Return whether a kernel names each of its parameters by its place, or hands all on."""
    tree, space = definition(kernel), space_of(getattr(kernel, 'py_func', kernel))
    known = set[int]()
    for node in ast.walk(tree):
        if isinstance(node, ast.Subscript) and isinstance(node.slice, ast.Constant):
            known.add(id(node.value))
        called = called_in(node, space)
        if called is not None and isinstance(node, ast.Call) and passes_unchanged(called, node):
            known |= {id(each) for each in node.args} if names_each(called) else set()
    own = [n for n in ast.walk(tree) if isinstance(n, ast.Name) and n.id == PARAMETERS]
    return all(id(each) in known for each in own)
