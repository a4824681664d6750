"""Which effects a model lacks: what is tried, how it is fitted, and what decides."""
