"""Simulations of a system on many points of a space, and the effects on its robustness."""
