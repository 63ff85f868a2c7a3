"""Searches for an input that violates a requirement, and simplifies what it finds."""
