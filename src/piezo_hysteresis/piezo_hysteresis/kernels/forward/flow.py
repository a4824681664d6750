"""Which names of a kernel depend on which directions."""

from __future__ import annotations

import ast
from collections.abc import Mapping, Sequence
from typing import Any

from piezo_hysteresis.kernels.forward.partials import PIECEWISE, RULES, STEPS
from piezo_hysteresis.kernels.forward.source import (
    ARRAYS,
    NUMBERS,
    PARAMETERS,
    WHOLE,
    NotDifferentiable,
    answer_of,
    base_of,
    called_in,
    names_in,
)

_NONE = frozenset[int]()


class Dependences:
    """Dependences of names, accumulated over the statements."""

    def __init__(self, space: Mapping[str, Any], lanes: range, own: int) -> None:
        self._space, self.lanes, self.own = space, lanes, own
        self.deps: dict[str, frozenset[int]] = {}
        self.kinds: dict[str, str] = {}

    def settle(self, statements: Sequence[ast.stmt]) -> None:
        """Iterate over the statements until the dependences do not change."""
        while self._once(statements):
            pass

    def _once(self, statements: Sequence[ast.stmt]) -> bool:
        new = False
        for node in statements:
            if isinstance(node, ast.Assign):
                new |= self.take(node.targets[0], node.value)
            for field in ('body', 'orelse'):
                new |= self._once(getattr(node, field, []))
        return new

    def take(self, target: ast.expr, value: ast.expr) -> bool:
        """Add the dependence of a target on a value; return whether it is new."""
        if isinstance(target, ast.Tuple):
            values = value.elts if isinstance(value, ast.Tuple) else [value] * len(target.elts)
            taken = [self.take(t, v) for t, v in zip(target.elts, values, strict=True)]
            return any(taken)
        if not isinstance(target, ast.Name):
            return False
        kind, found = self.kind(value), self.on(value)
        if kind == 'array' or (kind and found):
            found = frozenset(self.lanes)  # entries of a tuple are not distinguished
        if kind:
            self.kinds.setdefault(target.id, kind)
        before = self.deps.get(target.id, _NONE)
        self.deps[target.id] = before | found
        return self.deps[target.id] != before

    def kind(self, value: ast.expr) -> str:
        """Return whether an expression is an ``array``, a ``tuple`` or a number ('')."""
        match value:
            case ast.Tuple():
                return 'tuple'
            case ast.Name(name):
                return self.kinds.get(name, '')
            case ast.Subscript(_, place):
                is_slice = any(isinstance(each, ast.Slice) for each in ast.walk(place))
                is_array = self.kinds.get(base_of(value)) == 'array'
                return 'array' if is_slice and is_array else ''
            case ast.Call(function):
                called = called_in(value, self._space)
                if called is not None:
                    return '' if answer_of(called) in {*NUMBERS, 'None'} else 'tuple'
                return 'array' if ast.unparse(function).rsplit('.', 1)[-1] in ARRAYS else ''
        return ''

    def on(self, node: ast.expr) -> frozenset[int]:
        """Return the directions on which an expression depends."""
        match node:
            case ast.Name(name):
                return self.deps.get(name, _NONE)
            case ast.Subscript():
                place = self.own_place(node)
                return self.deps.get(base_of(node), _NONE) if place < 0 else frozenset([place])
            case ast.BinOp(left, _, right):
                return self.on(left) | self.on(right)
            case ast.UnaryOp(ast.USub(), value):
                return self.on(value)
            case ast.Tuple(entries):
                return _NONE.union(*map(self.on, entries))
            case ast.Call(function, arguments):
                return self._on_call(node, ast.unparse(function), arguments)
            case ast.Constant() | ast.Compare() | ast.BoolOp() | ast.Attribute():
                return _NONE
        if any(map(self.deps.get, names_in(node))):
            raise NotDifferentiable(ast.unparse(node))
        return _NONE

    def _on_call(self, node: ast.Call, name: str, arguments: Sequence[ast.expr]) -> frozenset[int]:
        called = called_in(node, self._space)
        if name in STEPS or (called is not None and answer_of(called) in {*WHOLE, 'None'}):
            return _NONE
        found = _NONE.union(*map(self.on, arguments))
        is_known = called is not None or name in RULES or name in PIECEWISE
        if found and not is_known and name.rsplit('.', 1)[-1] not in ARRAYS:
            raise NotDifferentiable(ast.unparse(node))
        return found if is_known else _NONE

    def own_place(self, node: ast.Subscript) -> int:
        """Return which parameter an entry is that is a direction itself; -1 for others."""
        if not self.own or base_of(node) != PARAMETERS:
            return -1
        return int(ast.literal_eval(node.slice))
