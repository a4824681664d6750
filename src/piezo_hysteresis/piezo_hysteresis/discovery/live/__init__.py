"""Online monitoring of the gap of a running actuator, and parameter export of a result."""
