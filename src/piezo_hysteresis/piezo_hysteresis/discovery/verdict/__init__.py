"""What was found, in names, numbers and words."""
