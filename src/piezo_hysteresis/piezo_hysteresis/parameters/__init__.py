"""Parameter table of each node, and its topics, services and actions."""
