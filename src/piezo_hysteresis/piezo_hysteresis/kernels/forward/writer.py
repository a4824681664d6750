"""Writes the text of the derivative of one function."""

from __future__ import annotations

import ast
import math
from collections.abc import Callable, Sequence
from typing import Any, Protocol

from piezo_hysteresis.kernels.forward.flow import Dependences
from piezo_hysteresis.kernels.forward.normal import Normal
from piezo_hysteresis.kernels.forward.partials import RULES, VALUE, Partials, Term, times
from piezo_hysteresis.kernels.forward.source import (
    INPUT,
    NUMBERS,
    PARAMETERS,
    WHOLE,
    answer_of,
    base_of,
    called_in,
    definition,
    hints_of,
    names_in,
    numbers_alone,
    passes_unchanged,
    space_of,
)

#: Arguments up to which a called function is differentiated by its own Jacobian.
_LOCAL = 8


class Generated(Protocol):
    """The derivative of another function."""

    @property
    def function(self) -> Callable[..., Any]:
        """Compiled."""

    @property
    def shape(self) -> int | None:
        """Length of the returned tuple; None if it returns one number."""

    @property
    def digest(self) -> str:
        """Digest of its dependencies."""


Make = Callable[[Callable[..., Any], int, bool, tuple[str, ...], int], Generated]


class Writer:
    """The derivative of one function, as text."""

    def __init__(
        self, source: Callable[..., Any], lanes: int, local: bool, still: tuple[str, ...],
        own: int, make: Make,
    ) -> None:  # fmt: skip
        hints = hints_of(source)
        moving = [n for n, hint in hints.items() if hint not in WHOLE and n not in still]
        self._source, self._local, self._make = source, local, make
        self._moving = [n for n in moving if not own or n != PARAMETERS]
        self._arguments = list(hints)
        self.space = {**space_of(source), 'math': math}
        self._normal = Normal(self.space)
        self.lanes = range(len(moving) if local else own + lanes)
        self._flow = flow = Dependences(self.space, self.lanes, own)
        for i, name in enumerate(moving):
            flow.deps[name] = frozenset([i] if local else self.lanes)
        if own:
            flow.deps[INPUT] = frozenset(self.lanes[own:])
        known = {n: 'array' if 'Array' in h else 'tuple' for n, h in hints.items()}
        flow.kinds.update({n: kind for n, kind in known.items() if hints[n] not in NUMBERS})
        self._partials = Partials(flow.on)
        kept = ''.join('01'[n in moving] for n in hints)
        kind = 'jacobian' if local else f'along{own}_{lanes}'
        name = source.__qualname__.replace('<locals>.', '').replace('.', '_')
        self.name = f'{name}_{kind}_{kept}'
        self.used: list[str] = []
        self.shape: int | None = None
        self._lines, self._depth = list[str](), 1

    def text(self) -> str:
        """Return the source of the derivative."""
        body = self._normal.statements(definition(self._source).body)
        self._flow.settle(body)
        heads = list(self._arguments)
        for i, each in enumerate(self._moving):
            if self._flow.kinds.get(each) == 'array':
                heads.append(f'{each}_d')
            elif not self._local:
                heads += [f'{each}_d{lane}' for lane in self.lanes]
            else:
                for lane in sorted(self._flow.deps[each]):
                    self._put(f'{each}_d{lane} = {1.0 if lane == i else 0.0}')
        self._write(body)
        return '\n'.join([f'def {self.name}({", ".join(heads)}):', *self._lines, ''])

    def _put(self, line: str) -> None:
        self._lines.append('    ' * self._depth + line)

    def _write(self, statements: Sequence[ast.stmt]) -> None:
        for node in statements:
            match node:
                case ast.If(test, body, other):
                    self._block(f'if {ast.unparse(test)}:', body)
                    if other:
                        self._block('else:', other)
                case ast.For(target, iterated, body):
                    self._block(f'for {ast.unparse(target)} in {ast.unparse(iterated)}:', body)
                case ast.While(test, body):
                    self._block(f'while {ast.unparse(test)}:', body)
                case ast.Return(ast.expr() as value):
                    lanes = ', '.join(self._lane(value, lane) for lane in self.lanes)
                    self.shape = len(value.elts) if isinstance(value, ast.Tuple) else None
                    self._put(f'return {ast.unparse(value)}, {lanes}')
                case ast.Assign([target], value):
                    self._assign(target, value)
                case ast.Expr(ast.Call() as call):
                    self._call(call, None)
                case _:
                    self._put(ast.unparse(node))

    def _block(self, head: str, statements: Sequence[ast.stmt]) -> None:
        self._put(head)
        self._depth += 1
        self._write(statements)
        if not statements:
            self._put('pass')
        self._depth -= 1

    # --- names of derivatives -------------------------------------------------------------

    def _lane(self, node: ast.expr, lane: int) -> str:
        """Return the derivative of a name, an entry or a tuple of them along a direction."""
        if isinstance(node, ast.Tuple):
            return '(' + ''.join(f'{self._lane(each, lane)}, ' for each in node.elts) + ')'
        if lane not in self._flow.on(node):
            return '0.0'
        if isinstance(node, ast.Name):
            return f'{node.id}_d{lane}'
        assert isinstance(node, ast.Subscript)
        if self._flow.own_place(node) >= 0:
            return '1.0'
        base = base_of(node)
        if self._flow.kinds.get(base) == 'array':
            places = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
            return f'{base}_d[{", ".join([str(lane), *map(ast.unparse, places)])}]'
        return f'{base}_d{lane}{ast.unparse(node).removeprefix(base)}'

    def _companion(self, node: ast.expr) -> str:
        """Return the array of derivatives of an array or of a slice of one."""
        if isinstance(node, ast.Name):
            return f'{node.id}_d'
        assert isinstance(node, ast.Subscript)
        return f'{base_of(node)}_d[:, {ast.unparse(node.slice)}]'

    def _lanes_of(self, target: ast.expr) -> list[int]:
        return sorted(self._flow.deps.get(base_of(target), ()))

    # --- assignments ----------------------------------------------------------------------

    def _assign(self, target: ast.expr, value: ast.expr) -> None:
        if called_in(value, self.space) is not None:
            assert isinstance(value, ast.Call)
            self._call(value, target)
        elif self._flow.kind(value) == 'array':
            self._array(ast.unparse(target), value)
        elif isinstance(target, ast.Tuple):
            self._several(target, value)
        elif isinstance(value, ast.Tuple):
            self._tuple(target, value)
        else:
            self._rows(target, self._partials.of(value), value)
            self._put(f'{ast.unparse(target)} = {ast.unparse(value)}')

    def _take(self, value: ast.expr) -> ast.Name:
        """Assign a value to a new name."""
        name = self._normal.fresh()
        self._flow.take(name, value)
        self._assign(name, value)
        return name

    def _several(self, target: ast.Tuple, value: ast.expr) -> None:
        """Write an assignment to several targets."""
        if not isinstance(value, ast.Tuple):
            for k, each in enumerate(target.elts):
                for lane in self._lanes_of(each):
                    self._put(f'{self._lane(each, lane)} = {self._lane(value, lane)}[{k}]')
            self._put(f'{ast.unparse(target)} = {ast.unparse(value)}')
            return
        values = value.elts
        if {*names_in(target)} & {*names_in(value)}:
            values = [self._take(each) for each in values]
        for place, each in zip(target.elts, values, strict=True):
            self._assign(place, each)

    def _tuple(self, target: ast.expr, value: ast.Tuple) -> None:
        """Assign a tuple of expressions to one name."""
        plain = ast.Name | ast.Subscript | ast.Constant
        entries = (e if isinstance(e, plain) else self._take(e) for e in value.elts)
        flat = ast.Tuple([*entries], ast.Load())
        for lane in self._lanes_of(target):
            self._put(f'{self._lane(target, lane)} = {self._lane(flat, lane)}')
        self._put(f'{ast.unparse(target)} = {ast.unparse(flat)}')

    def _array(self, name: str, value: ast.expr) -> None:
        """Make an array, or name a part of one."""
        self._put(f'{name} = {ast.unparse(value)}')
        if not isinstance(value, ast.Call):
            self._put(f'{name}_d = {self._companion(value)}')
            return
        made, shape = ast.unparse(value.func), value.args[0]
        if made.endswith('_like'):
            self._put(f'{name}_d = np.zeros(({len(self.lanes)}, *{ast.unparse(shape)}.shape))')
            return
        sizes = shape.elts if isinstance(shape, ast.Tuple) else [shape]
        self._put(f'{name}_d = {made}(({len(self.lanes)}, {", ".join(map(ast.unparse, sizes))}))')

    def _rows(
        self, target: ast.expr, partials: Sequence[Term], value: ast.expr | None = None
    ) -> None:
        """Write the derivatives of a target by the chain rule."""
        lanes = self._lanes_of(target)
        if not lanes:
            return
        if isinstance(value, ast.Call) and ast.unparse(value.func) in RULES:
            self._put(f'{VALUE} = {ast.unparse(value)}')
        weights = []
        for leaf, weight in partials:
            if not weight.replace('_', '').replace('.', '').lstrip('-').isalnum():
                name = self._normal.fresh().id
                self._put(f'{name} = {weight}')
                weights.append((leaf, name))
            else:
                weights.append((leaf, weight))
        for lane in lanes:
            terms = [times(w, self._lane(leaf, lane)) for leaf, w in weights
                     if lane in self._flow.on(leaf)]  # fmt: skip
            self._put(f'{self._lane(target, lane)} = {" + ".join(terms) or "0.0"}')

    # --- calls ----------------------------------------------------------------------------

    def _call(self, node: ast.Call, target: ast.expr | None) -> None:
        """Write the call of another function, by its Jacobian or along the same directions."""
        called = called_in(node, self.space)
        hints = {} if called is None else hints_of(called)
        is_array = {n: 'Array' in hint for n, hint in hints.items()}
        if called is None or not (any(is_array.values()) or self._flow.on(node)):
            head = '' if target is None else f'{ast.unparse(target)} = '
            self._put(head + ast.unparse(node))
            return
        pairs = list(zip(hints, node.args, strict=True))
        still = tuple(n for n, a in pairs if not is_array[n] and not self._flow.on(a))
        moving = [(n, a) for n, a in pairs if n not in still and hints[n] not in WHOLE]
        if target is not None and numbers_alone(called) and len(moving) <= _LOCAL:
            made = self._made(called, 0, True, still, 0)
            self._by_jacobian(node, target, made, [a for _, a in moving])
            return
        own = self._flow.own if passes_unchanged(called, node) else 0
        made = self._made(called, len(self.lanes) - own, False, still, own)
        given = [ast.unparse(each) for each in node.args]
        for name, argument in moving:
            if not is_array[name]:
                given += [self._lane(argument, lane) for lane in self.lanes]
            elif not own or name != PARAMETERS:
                given.append(self._companion(argument))
        text = f'{made.function.__name__}({", ".join(given)})'
        if target is None or answer_of(called) == 'None':
            self._put(text)
            return
        answer = self._normal.fresh().id
        self._put(f'{answer} = {text}')
        several = isinstance(target, ast.Tuple)
        for k, each in enumerate(target.elts if isinstance(target, ast.Tuple) else [target]):
            entry = f'[{k}]' if several else ''
            for lane in self._lanes_of(each):
                self._put(f'{self._lane(each, lane)} = {answer}[{lane + 1}]{entry}')
            self._put(f'{ast.unparse(each)} = {answer}[0]{entry}')

    def _made(
        self, called: Callable[..., Any], lanes: int, local: bool, still: tuple[str, ...], own: int
    ) -> Generated:
        made = self._make(called, lanes, local, still, own)
        self.space[made.function.__name__] = made.function
        self.used.append(made.digest)
        return made

    def _by_jacobian(
        self, node: ast.Call, target: ast.expr, made: Generated, moving: Sequence[ast.expr]
    ) -> None:
        """Assign what a function returns, its derivatives by the chain rule."""
        answer = self._normal.fresh().id
        given = ', '.join(map(ast.unparse, node.args))
        self._put(f'{answer} = {made.function.__name__}({given})')
        several, places = made.shape is not None, [target]
        if isinstance(target, ast.Tuple):
            places = target.elts
        elif made.shape is not None:
            places = [self._normal.fresh() for _ in range(made.shape)]
        on, pairs = self._flow.on(node), []
        for k, each in enumerate(places):
            if isinstance(each, ast.Name):
                self._flow.deps.setdefault(each.id, on)
            entry, name = f'[{k}]' if several else '', each
            if several:  # one of them may be what the next depends on
                name = self._normal.fresh()
                self._flow.deps[name.id] = self._flow.deps.get(base_of(each), on)
            self._rows(name, [(a, f'{answer}[{j + 1}]{entry}') for j, a in enumerate(moving)])
            pairs.append((each, name, entry))
        for each, name, entry in pairs:
            for lane in self._lanes_of(name) if name is not each else ():
                self._put(f'{self._lane(each, lane)} = {self._lane(name, lane)}')
            self._put(f'{ast.unparse(each)} = {answer}[0]{entry}')
        if several and not isinstance(target, ast.Tuple):
            self._tuple(target, ast.Tuple(places, ast.Load()))
