"""Experiments that a rig can run: waveforms within limits, and the catalogue of all of them."""
