"""Attenuation of harmonics of the tracking error, by adaptation and by repetition."""
