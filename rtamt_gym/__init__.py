"""Signal temporal logic for simulations: Gymnasium environments under `rtamt` monitors."""

from rtamt_gym.signals import Step
from rtamt_gym.wrappers import StlMonitor

__all__ = ["Step", "StlMonitor"]
