"""Automatic selection of a model for prediction; `selection` searches effects with a name."""
