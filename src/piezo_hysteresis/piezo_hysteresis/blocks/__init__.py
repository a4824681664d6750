"""The pieces a model is made of, one file each, with their compiled kernels."""

from piezo_hysteresis.blocks.base import Block, Parameter, Slot

__all__ = ['Block', 'Parameter', 'Slot']
