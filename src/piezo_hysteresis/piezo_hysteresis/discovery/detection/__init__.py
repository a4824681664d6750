"""Detection limits of effects, and effects that the records cannot distinguish."""
