"""Thin rclpy wrappers; the only package that imports rclpy or piezo_interfaces."""

from piezo_hysteresis.process_setup import kept_for_arrays, one_for_linear_algebra

one_for_linear_algebra()
kept_for_arrays()
