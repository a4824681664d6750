"""The ``jit`` decorator of every per-sample kernel."""

from piezo_kernels.compile import jit

__all__ = ['jit']
