"""The machine over dense time."""
