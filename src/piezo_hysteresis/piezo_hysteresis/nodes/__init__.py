"""Thin rclpy wrappers; the only room that imports rclpy or piezo_interfaces."""
