"""A model and its compensator as a C library: the same kernels, compiled for a target."""
