"""Searches and sweeps: many simulations of a system with varied inputs, and their analysis."""
