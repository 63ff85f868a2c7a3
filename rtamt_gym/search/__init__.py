"""Runs a system many times: what is varied, the record of all runs, and what follows from it."""
