"""Selection of the effects that a model lacks: screening, fits and decision rules."""
