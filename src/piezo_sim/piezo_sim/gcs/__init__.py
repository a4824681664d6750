"""Simulated piezo controllers with an actuator of `piezo_sim`: GCS 2 and NV200."""
