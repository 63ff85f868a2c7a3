"""Scenario environments for Gymnasium, in the namespace ``rtamt/``."""
