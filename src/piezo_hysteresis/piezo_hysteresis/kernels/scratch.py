"""Scratch memory of a kernel on its stack, without heap allocation.

A kernel that allocates memory in every step is slower, and cannot run without a heap (an
interrupt, a library for a target). The array from `scratch` is valid during the call of the
kernel; it must not be returned or stored, and should be created outside of loops.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

try:
    from numba import types
    from numba.extending import intrinsic, overload
    from numba.np import arrayobj
except ImportError:  # pragma: no cover - exercised by a test in a subprocess
    types = None


def scratch(shape: int | tuple[int, ...]) -> npt.NDArray[np.float64]:
    """Return an uninitialised array of floats of this shape."""
    return np.empty(shape)


if types is not None:

    def _on_stack(count: int) -> Any:
        """Return the intrinsic for arrays of `count` dimensions."""

        @intrinsic
        def made(context: Any, shape: Any) -> Any:
            answer = types.Array(types.float64, count, 'C')

            def build(target: Any, builder: Any, signature: Any, arguments: Any) -> Any:
                whole, (given,) = target.get_constant(types.intp, 1), arguments
                places = [builder.extract_value(given, k) for k in range(count)]
                size = target.get_constant(types.intp, 8)
                strides = [size]
                for place in places:
                    whole = builder.mul(whole, place)
                for place in reversed(places[1:]):
                    strides.insert(0, builder.mul(strides[0], place))
                data = builder.alloca(target.get_value_type(types.float64), size=whole)
                data.align = 8
                array = target.make_array(answer)(target, builder)
                arrayobj.populate_array(
                    array, data=data, shape=places, strides=strides, itemsize=size, meminfo=None
                )
                return array._getvalue()

            return answer(types.UniTuple(types.intp, count)), build

        return made

    _MADE = tuple(_on_stack(count) for count in range(1, 5))

    @overload(scratch, inline='always')
    def _scratch(shape):  # type: ignore[no-untyped-def] # numba compares both signatures
        """Register the implementation of `scratch` in numba."""
        made = _MADE[0 if isinstance(shape, types.Integer) else len(shape) - 1]
        if isinstance(shape, types.Integer):
            return lambda shape: made((shape,))
        return lambda shape: made(shape)
