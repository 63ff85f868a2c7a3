"""Policies under requirements: how often each is satisfied, how sure that is, which is better."""
