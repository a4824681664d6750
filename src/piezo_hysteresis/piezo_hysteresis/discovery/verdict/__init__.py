"""Verdict of a discovery: effects, numbers and sentences."""
