"""The ``jit`` decorator of every per-sample kernel, and the room it takes on its stack."""

from piezo_hysteresis.kernels.compile import jit, jit_sums, leaf
from piezo_hysteresis.kernels.scratch import scratch

__all__ = ['jit', 'jit_sums', 'leaf', 'scratch']
