"""`CostEnv`: the cost of a step beside its reward, as learners of safe control read it."""

from __future__ import annotations

from typing import Any, SupportsFloat

import gymnasium as gym
from gymnasium.core import ActType, ObsType
from gymnasium.utils import RecordConstructorArgs

from rtamt import InputError
from rtamt_gym.wrappers.monitor import StlMonitor

__all__ = ["CostEnv"]


class CostEnv(gym.Wrapper[ObsType, ActType, ObsType, ActType], RecordConstructorArgs):
    """Gives the cost of a step beside its reward, in the form of Safety-Gymnasium.

    :meth:`step` returns six values, ``obs, reward, cost, terminated, truncated, info``; the cost is
    ``info["cost"]``, which stays there. Every other method is as it was. Place it outermost: the
    wrappers of Gymnasium expect five values, the wrappers of Safety-Gymnasium six.

    Example:
        >>> import gymnasium as gym
        >>> from rtamt_gym import CostEnv, StlMonitor
        >>> env = StlMonitor(
        ...     gym.make("CartPole-v1"),
        ...     "always(abs(theta) < 0.1)",
        ...     {"theta": "obs[2]"},
        ...     on_violation="report",
        ...     at_termination="complete",
        ...     cost="violation",
        ... )
        >>> env = CostEnv(env)
        >>> obs, info = env.reset(seed=123)
        >>> terminated, costs = False, []
        >>> while not terminated:
        ...     obs, reward, cost, terminated, truncated, info = env.step(1)
        ...     costs.append(float(cost))
        >>> costs
        [0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0]

    Change logs:
     * v0.5.0 - Initially added
    """

    def __init__(self, env: gym.Env[ObsType, ActType]) -> None:
        """Looks for the monitor inside, which must give the cost.

        Args:
            env: The environment to apply the wrapper, with an :class:`StlMonitor` that has
                ``cost=``, or an :class:`StlReward` that has it

        Raises:
            InputError: If no monitor inside of the environment gives a cost
        """
        RecordConstructorArgs.__init__(self)
        gym.Wrapper.__init__(self, env)
        _check_cost(env)

    def step(  # type: ignore[override]  # six values, as the wrappers of Safety-Gymnasium return
        self, action: ActType
    ) -> tuple[ObsType, SupportsFloat, float, bool, bool, dict[str, Any]]:
        """Steps through the environment, and gives the cost of the step too."""
        obs, reward, terminated, truncated, info = self.env.step(action)
        return obs, reward, info["cost"], terminated, truncated, info


def _check_cost(env: gym.Env[Any, Any]) -> None:
    within = env
    while isinstance(within, gym.Wrapper):
        if isinstance(within, StlMonitor):
            if within.cost is not None:
                return
            raise InputError(
                f"expected a monitor with cost=, got {type(within).__name__} without; give it "
                'cost="violation", or "depth", "latched" or "first"'
            )
        within = within.env
    raise InputError(
        f"expected an environment with an StlMonitor, which gives the cost, got {env}; such as "
        'CostEnv(StlMonitor(env, specs, signals, cost="violation"))'
    )
