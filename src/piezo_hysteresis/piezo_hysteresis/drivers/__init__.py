"""Controllers of the lab: sweeps that run in the controller, at its own rate."""
