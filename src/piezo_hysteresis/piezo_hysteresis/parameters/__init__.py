"""The one table of parameters of each node, and what each node speaks."""
