"""Bags from topics, topics from bags."""
