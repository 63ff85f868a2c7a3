"""Search for an input that violates a requirement, and simplification of the input."""
