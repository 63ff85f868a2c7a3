"""Inputs of simulations: signals and parameters with their ranges, and cases of them."""
