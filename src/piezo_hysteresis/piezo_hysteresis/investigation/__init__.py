"""Discovery that chooses its own experiments: catalogue, prediction, choice, belief, journal."""
