"""Feedback laws on the tracking error: PID, fuzzy PID, H-infinity."""
