"""A live view in Rerun: signals, robustness with bounds, verdicts and pictures of runs."""

from rtamt_gym.live.view import RerunView

__all__ = ["RerunView"]
