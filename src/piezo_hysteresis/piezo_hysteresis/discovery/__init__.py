"""Finds what a model misses: check, locate, compete, verdict, advise."""
