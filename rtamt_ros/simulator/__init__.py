"""Simulated robots and their controllers as nodes, to try a monitor."""
