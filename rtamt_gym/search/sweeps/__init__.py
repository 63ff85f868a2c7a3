"""Runs a system on many points of a space, and says what moves its robustness."""
