"""Automatic differentiation of kernels: derivatives are generated from their source.

Forward mode by tangent-linear code: `normal` gives every call a separate statement, `flow` finds
the dependences on the directions, `partials` differentiates one expression, `writer` assembles the
text, and `generate` compiles it. Every number ``v`` that depends on a direction j gets a companion
``v_dj``, every array one with one more leading axis.
"""

from piezo_hysteresis.kernels.forward.generate import (
    Directional,
    directional,
    directions_of,
    jacobian,
)
from piezo_hysteresis.kernels.forward.source import NotDifferentiable

__all__ = ['Directional', 'NotDifferentiable', 'directional', 'directions_of', 'jacobian']
