"""The derivative of one expression by the names and entries in it, as text."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator

from piezo_hysteresis.kernels.forward.source import NotDifferentiable

#: Derivative of a function of one number `a` whose value is `v`.
RULES = {
    'exp': '{v}',
    'expm1': '({v} + 1.0)',
    'log': '(1.0 / ({a}))',
    'log1p': '(1.0 / (1.0 + ({a})))',
    'sqrt': '(0.5 / {v})',
    'sin': 'math.cos({a})',
    'cos': '(-math.sin({a}))',
    'tan': '(1.0 + {v} * {v})',
    'sinh': 'math.cosh({a})',
    'cosh': 'math.sinh({a})',
    'tanh': '(1.0 - {v} * {v})',
    'asin': '(1.0 / math.sqrt(1.0 - ({a}) * ({a})))',
    'asinh': '(1.0 / math.sqrt(({a}) * ({a}) + 1.0))',
    'atan': '(1.0 / (1.0 + ({a}) * ({a})))',
}
#: Functions that are straight between their kinks.
PIECEWISE = ('abs', 'min', 'max', 'float', 'copysign')
#: Piecewise constant functions: their derivative is zero.
STEPS = ('int', 'bool', 'ceil', 'floor', 'round', 'len', 'range', 'isfinite')
#: Name of the value of a function, which `RULES` may use.
VALUE = '_w'

Term = tuple[ast.expr, str]


class Partials:
    """Differentiates expressions in normal form."""

    def __init__(self, moves: Callable[[ast.expr], object]) -> None:
        self._moves = moves

    def of(self, node: ast.expr) -> list[Term]:
        """Return names and entries in an expression, each with its derivative by it."""
        found: dict[str, tuple[ast.expr, list[str]]] = {}
        for leaf, weight in self._terms(node, '1.0'):
            found.setdefault(ast.unparse(leaf), (leaf, []))[1].append(weight)
        return [(leaf, ' + '.join(weights)) for leaf, weights in found.values()]

    def _terms(self, node: ast.expr, factor: str) -> Iterator[Term]:
        if not self._moves(node):
            return
        match node:
            case ast.Name() | ast.Subscript():
                yield node, factor
            case ast.UnaryOp(ast.USub(), value):
                yield from self._terms(value, times('-1.0', factor))
            case ast.BinOp():
                yield from self._of_two(node, factor)
            case ast.Call():
                yield from self._of_call(node, factor)
            case _:
                raise NotDifferentiable(ast.unparse(node))

    def _of_two(self, node: ast.BinOp, factor: str) -> Iterator[Term]:
        x, y = f'({ast.unparse(node.left)})', f'({ast.unparse(node.right)})'
        match node.op:
            case ast.Add():
                by_x, by_y = factor, factor
            case ast.Sub():
                by_x, by_y = factor, times('-1.0', factor)
            case ast.Mult():
                by_x, by_y = times(factor, y), times(factor, x)
            case ast.Div():
                by_x, by_y = f'({factor} / {y})', f'(-{factor} * {x} / ({y} * {y}))'
            case ast.Pow():
                by_x = times(factor, f'({y} * {x} ** ({y} - 1.0))')
                by_y = times(factor, f'({x} ** {y} * math.log({x}) if {x} > 0.0 else 0.0)')
            case _:
                raise NotDifferentiable(ast.unparse(node))
        yield from self._terms(node.left, by_x)
        yield from self._terms(node.right, by_y)

    def _of_call(self, node: ast.Call, factor: str) -> Iterator[Term]:
        name, (first, *others) = ast.unparse(node.func), node.args
        a = ast.unparse(first)
        if name in RULES:
            yield from self._terms(first, times(factor, RULES[name].format(a=a, v=VALUE)))
        elif name == 'float':
            yield from self._terms(first, factor)
        elif name == 'abs':
            yield from self._terms(first, times(factor, f'(1.0 if ({a}) >= 0.0 else -1.0)'))
        elif name == 'copysign':
            same = f'(1.0 if ({a}) * ({ast.unparse(others[0])}) >= 0.0 else -1.0)'
            yield from self._terms(first, times(factor, same))
        elif name in ('min', 'max'):
            second = f'({ast.unparse(others[0])}) {"<" if name == "min" else ">"} ({a})'
            yield from self._terms(first, times(factor, f'(0.0 if {second} else 1.0)'))
            yield from self._terms(others[0], times(factor, f'(1.0 if {second} else 0.0)'))
        else:
            raise NotDifferentiable(ast.unparse(node))


def times(one: str, other: str) -> str:
    """Return the text of a product."""
    if '1.0' in (one, other):
        return other if one == '1.0' else one
    return f'{one} * {other}'
