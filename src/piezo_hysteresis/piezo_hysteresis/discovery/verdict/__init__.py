"""The verdict: effects, numbers and sentences."""
