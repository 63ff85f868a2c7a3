"""Specifications and their monitors, for one environment or many."""
