"""Thin rclpy wrappers; the only room that imports rclpy or piezo_interfaces."""

from piezo_hysteresis.memory import kept_for_arrays
from piezo_hysteresis.threads import one_for_linear_algebra

one_for_linear_algebra()
kept_for_arrays()
