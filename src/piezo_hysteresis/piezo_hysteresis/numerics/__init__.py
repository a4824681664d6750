"""Numerical methods shared by several packages, independent of actuators."""
