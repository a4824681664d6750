"""Actuators of several coupled axes: records with a matrix of voltages and of displacements."""
