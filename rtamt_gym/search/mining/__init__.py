"""Finds the tightest constant for which a requirement holds on all traces."""
