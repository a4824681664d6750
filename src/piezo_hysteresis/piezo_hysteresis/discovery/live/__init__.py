"""Beside a running actuator: the gap as it grows, and what was found as its parameters."""
