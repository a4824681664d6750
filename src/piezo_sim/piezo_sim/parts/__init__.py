"""Parts of the plant, each with its parameters, effects and compiled physics."""
