"""Initial conditions of records and their other nuisances: zero, weight, sampling clock."""
