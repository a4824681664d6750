"""Additions of the Python interface: plots and reports of results, and studies in one call."""
