"""Scenarios: models with requirements, as environments of Gymnasium.

Importing the package registers them as ``rtamt/NAME-v0``. `scenario_of` also works without
Gymnasium.

    >>> import gymnasium as gym, rtamt_envs
    >>> env = gym.make("rtamt/ChasingCars-v0")
    >>> sorted(env.unwrapped.requirements)
    ['CC1', 'CC2', 'CC3', 'CC4', 'CC5', 'CCx']
"""

from __future__ import annotations

from importlib.util import find_spec

from rtamt_envs.scenario import SCENARIOS, scenario_of

__all__ = ["SCENARIOS", "scenario_of"]

if find_spec("gymnasium") is not None:
    import gymnasium as gym

    for _name, (_, _steps) in SCENARIOS.items():
        if f"rtamt/{_name}-v0" not in gym.registry:
            gym.register(
                f"rtamt/{_name}-v0",
                entry_point="rtamt_envs.environment:ScenarioEnv",
                vector_entry_point="rtamt_envs.vector:ScenarioVectorEnv",
                kwargs={"scenario": _name},
                max_episode_steps=_steps,
                disable_env_checker=True,  # an error of the first reset would leave it unusable
            )
