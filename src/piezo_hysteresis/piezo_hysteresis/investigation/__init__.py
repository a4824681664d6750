"""Active discovery: response prediction, choice of the next experiment, and journal."""
