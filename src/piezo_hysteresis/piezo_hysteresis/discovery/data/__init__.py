"""Records for discovery: checked, annotated, split, with the phases of a fixed tone aligned."""
