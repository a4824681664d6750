"""Compilation of kernels, the cache of their machine code, and notifications."""
