"""Active discovery: experiment catalogue, response prediction, design criterion and journal."""
