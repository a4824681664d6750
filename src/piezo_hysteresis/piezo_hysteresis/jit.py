"""The ``jit`` decorator of every per-sample kernel, and the room it takes on its stack."""

from piezo_hysteresis.kernels.compile import inline_jit, jit, jit_sums
from piezo_hysteresis.kernels.scratch import scratch

__all__ = ['inline_jit', 'jit', 'jit_sums', 'scratch']
