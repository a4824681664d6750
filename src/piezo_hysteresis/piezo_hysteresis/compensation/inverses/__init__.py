"""Voltages from a reference by inverting a model: static laws, memories, structures, chains."""
