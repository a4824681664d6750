"""A model that predicts, chosen without asking; `selection` finds effects that have a name."""
