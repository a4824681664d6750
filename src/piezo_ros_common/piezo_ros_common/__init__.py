"""What the nodes of the suite share: parameter tables, spinning, quality of service."""
