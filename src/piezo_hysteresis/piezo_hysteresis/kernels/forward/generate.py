"""Derivatives of kernels along several directions in one pass, and Jacobians of functions."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

from piezo_hysteresis.kernels.compile import generated
from piezo_hysteresis.kernels.forward.source import hints_of, names_each
from piezo_hysteresis.kernels.forward.writer import Writer

#: Directions per pass, with and without those of the parameters: a compromise between the number
#: of passes and the time to compile one.
LANES, WIDE = 2, 4


@dataclass(frozen=True)
class Directional:
    """A kernel with derivatives."""

    run: Callable[..., Any]
    own: int
    lanes: int  # number of given directions


@cache
def directional(kernel: Callable[..., Any], parameters: int) -> Directional:
    """Return a kernel ``(x, y, state, p, ...)`` with the derivatives of its outputs.

    Numbers, arrays of floats and tuples are known, ``if``, ``for``, ``while``, early returns, the
    functions of `partials.RULES` and `partials.PIECEWISE`, and other kernels: those of a few
    numbers are differentiated by their own Jacobian, worked out once per call. Conditions and
    integers are not differentiated: at a kink the derivative is that of the branch taken.
    """
    own = parameters if names_each(kernel) else 0
    lanes = LANES if own else WIDE
    made = _made(kernel, lanes, False, _numbers(kernel), own, False)
    return Directional(made.function, own, lanes)


def directions_of(kernel: Callable[..., Any], lanes: int) -> Callable[..., Any]:
    """Return a kernel of arrays that takes one more for each, its derivatives, `lanes` rows."""
    return _made(kernel, lanes, False, _numbers(kernel), 0, False).function


def jacobian(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function of numbers that returns its value and its derivative by each of them."""
    return _made(function, 0, True, (), 0, False).function


def _numbers(kernel: Callable[..., Any]) -> tuple[str, ...]:
    """Return the arguments of a kernel that are no arrays."""
    return tuple(name for name, hint in hints_of(kernel).items() if 'Array' not in hint)


@dataclass(frozen=True)
class _Made:
    """A generated function, see `writer.Generated`."""

    function: Callable[..., Any]
    shape: int | None
    digest: str


@cache
def _made(
    function: Callable[..., Any],
    lanes: int,
    local: bool,
    still: tuple[str, ...],
    own: int,
    inner: bool = True,
) -> _Made:
    """Generate the derivative of a function; see `Writer` for the arguments."""
    source = getattr(function, 'py_func', function)
    writer = Writer(source, lanes, local, still, own, _made)
    text = writer.text()
    digest = hashlib.sha256(''.join([text, *writer.used]).encode()).hexdigest()
    compiled = generated(writer.name, text, writer.space, source, digest, inner=inner)
    return _Made(compiled, writer.shape, digest)
