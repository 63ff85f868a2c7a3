"""Runs a simulation of any kind under specifications; the run's record, picture and file."""
