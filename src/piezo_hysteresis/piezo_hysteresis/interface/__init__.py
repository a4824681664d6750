"""What only the Python interface has: plots and reports of results, and studies in one call."""
