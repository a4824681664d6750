"""Inverses, harmonic attenuation, feedback laws and limits."""
