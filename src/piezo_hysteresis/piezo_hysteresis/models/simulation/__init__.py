"""Simulation of a chain, exact between the ticks, and its derivatives."""
