"""Mutants of requirements: one change each, by which a suite of traces is judged."""
