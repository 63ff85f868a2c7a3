"""Wrappers of Gymnasium environments."""
