"""The nodes of the voltage chain: feedforward, attenuation, feedback, and all in one process."""
