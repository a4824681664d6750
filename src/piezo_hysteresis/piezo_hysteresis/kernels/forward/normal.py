"""Normal form of a kernel: every call with a derivative is a separate statement."""

from __future__ import annotations

import ast
import copy
from collections.abc import Mapping, Sequence
from typing import Any

from piezo_hysteresis.kernels.forward.partials import PIECEWISE, RULES
from piezo_hysteresis.kernels.forward.source import NotDifferentiable, called_in

_ATOMS = ast.Name | ast.Constant | ast.Compare | ast.BoolOp | ast.Attribute


class Normal:
    """Rewrites statements: calls, powers and conditional expressions get names."""

    def __init__(self, space: Mapping[str, Any]) -> None:
        self._space = space
        self._count = 0

    def fresh(self) -> ast.Name:
        """Return a new name."""
        self._count += 1
        return ast.Name(f'_v{self._count}', ast.Load())

    def statements(self, nodes: Sequence[ast.stmt]) -> list[ast.stmt]:
        """Return statements in normal form."""
        return [each for node in nodes for each in self._statement(node)]

    def _statement(self, node: ast.stmt) -> list[ast.stmt]:
        before: list[ast.stmt] = []
        match node:
            case ast.AugAssign(target, operation, value):
                read = ast.BinOp(copy.deepcopy(target), operation, value)
                return self._statement(ast.Assign([target], read))
            case ast.Assign([target], value) | ast.AnnAssign(target, _, ast.expr() as value):
                flat, after = self._flat(target)
                last: ast.stmt = ast.Assign([flat], self._value(value, before, whole=True))
                return [*before, last, *after]
            case ast.Return(ast.expr() as value):
                last = ast.Return(self._names_of(self._value(value, before), before))
            case ast.If(test, body, other):
                last = ast.If(test, self.statements(body), self.statements(other))
            case ast.For(target, iterated, body):
                last = ast.For(target, iterated, self.statements(body), [])
            case ast.While(test, body):
                last = ast.While(test, self.statements(body), [])
            case ast.Expr(ast.Call() as value):
                last = ast.Expr(self._value(value, before, whole=True))
            case ast.Expr():
                return []  # a docstring
            case ast.Return() | ast.Break() | ast.Continue() | ast.Pass():
                last = node
            case _:
                raise NotDifferentiable(ast.unparse(node))
        return [*before, last]

    def _flat(self, target: ast.expr) -> tuple[ast.expr, list[ast.stmt]]:
        """Return a target without tuples in a tuple, and statements that take these apart."""
        if not isinstance(target, ast.Tuple):
            return target, []
        names = [self.fresh() if isinstance(e, ast.Tuple) else e for e in target.elts]
        pairs = zip(target.elts, names, strict=True)
        after = [ast.Assign([e], n) for e, n in pairs if isinstance(e, ast.Tuple)]
        return ast.Tuple(names, ast.Store()), self.statements(after)

    def _value(self, node: ast.expr, before: list[ast.stmt], *, whole: bool = False) -> ast.expr:
        """Return an expression whose inner calls have become statements `before` it.

        The outermost call remains if it is the `whole` right-hand side of a statement.
        """
        match node:
            case _ if isinstance(node, _ATOMS):
                return node
            case ast.Subscript(value, place):
                return ast.Subscript(self._value(value, before), place, ast.Load())
            case ast.Tuple(entries):
                return ast.Tuple([self._value(each, before) for each in entries], ast.Load())
            case ast.UnaryOp(operation, value):
                return ast.UnaryOp(operation, self._value(value, before))
            case ast.BinOp(left, operation, right):
                new = ast.BinOp(self._value(left, before), operation, self._value(right, before))
                is_power = isinstance(operation, ast.Pow)
                return self._named(new, before) if is_power and not whole else new
            case ast.Call():
                return self._call(node, before, whole)
            case ast.IfExp(test, value, other):
                name = self.fresh()
                branches = []
                for each in (value, other):
                    branch: list[ast.stmt] = []
                    branch.append(ast.Assign([name], self._value(each, branch)))
                    branches.append(branch)
                before.append(ast.If(test, *branches))
                return name
        raise NotDifferentiable(ast.unparse(node))

    def _call(self, node: ast.Call, before: list[ast.stmt], whole: bool) -> ast.expr:
        name = ast.unparse(node.func)
        is_kernel = called_in(node, self._space) is not None
        if not is_kernel and name not in RULES and name not in PIECEWISE:
            return node
        arguments = [self._value(each, before) for each in node.args]
        if is_kernel:
            plain = ast.Name | ast.Constant | ast.Subscript
            arguments = [a if isinstance(a, plain) else self._named(a, before) for a in arguments]
        new = ast.Call(node.func, arguments, [])
        return new if whole or name in PIECEWISE else self._named(new, before)

    def _named(self, value: ast.expr, before: list[ast.stmt]) -> ast.Name:
        name = self.fresh()
        before.append(ast.Assign([name], value))
        return name

    def _names_of(self, value: ast.expr, before: list[ast.stmt]) -> ast.expr:
        if isinstance(value, ast.Tuple):
            return ast.Tuple([self._names_of(each, before) for each in value.elts], ast.Load())
        return self._named(value, before)
