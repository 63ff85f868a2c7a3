"""Recorded episodes for offline learning, with robustness, cost and success."""
