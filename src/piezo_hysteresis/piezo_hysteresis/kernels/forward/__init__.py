"""Derivatives of kernels, generated from their source: a law is written once.

Forward mode, as tangent-linear code: `normal` gives every call a statement of its own, `flow`
finds what depends on which direction, `partials` differentiates one expression, `writer` puts the
text together, and `generate` compiles it. Every number ``v`` that depends on a direction j gets a
companion ``v_dj``, every array one with one more leading axis.
"""

from piezo_hysteresis.kernels.forward.generate import (
    Directional,
    directional,
    directions_of,
    jacobian,
)
from piezo_hysteresis.kernels.forward.source import NotDifferentiable

__all__ = ['Directional', 'NotDifferentiable', 'directional', 'directions_of', 'jacobian']
