"""Monitors inside loops of ``mj_step``."""

from typing import TYPE_CHECKING

from rtamt_gym.checks.extras import lazy_names

if TYPE_CHECKING:
    from rtamt_gym.mujoco.rollouts import evaluate_rollouts

__all__ = ["evaluate_rollouts"]

if not TYPE_CHECKING:  # a type checker would accept any name
    __getattr__ = lazy_names(
        __name__, {"evaluate_rollouts": "rtamt_gym.mujoco.rollouts.evaluate_rollouts"}
    )
