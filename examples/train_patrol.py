"""A window inside a window: a point must visit both ends of a corridor again and again.

At every instant, each end must be visited within the next 40 steps. The learner needs the time
since its last visits, which neither its observation nor the robustness of the formula contains.

Run: python examples/train_patrol.py --seeds 10 --jobs 2 --output patrol.csv
"""

from typing import Any

import gymnasium as gym
import numpy as np
from corridor import Corridor
from training import Paying, Task, main

from rtamt_gym import StlMonitor, StlReward

WITHIN = {"left": "eventually[0:40](x < -0.8)", "right": "eventually[0:40](x > 0.8)"}
REQUIRED = {name: f"always[0:160]({text})" for name, text in WITHIN.items()}
SIGNALS = {"x": ("info['x']", 0.0)}  # info has x also at a reset
STEPS = 200  # so that the last window ends within the episode
GAMMA = 0.98


class Clocks(gym.Wrapper[Any, Any, Any, Any]):
    """Clocks for this task: the time since x was at each end, as a fraction of 40 steps."""

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        """Add two numbers to the observation."""
        super().__init__(env)
        self.observation_space = gym.spaces.Box(-1.0, 1.0, (3,), np.float32)
        self._since = np.zeros(2)

    def reset(self, **options: Any) -> tuple[Any, dict[str, Any]]:
        """Start the clocks."""
        self._since[:] = 0.0
        obs, info = self.env.reset(**options)
        return self._observation(obs), info

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Step the environment and the clocks."""
        self._since += 1 / 40
        obs, *others = self.env.step(action)
        return self._observation(obs), *others

    def _observation(self, obs: Any) -> Any:
        self._since[[obs[0] < -0.8, obs[0] > 0.8]] = 0.0
        return np.append(obs, np.minimum(self._since, 1.0)).astype(np.float32)


def monitored(variant: str, **more: Any) -> dict[str, Any]:
    """Return the arguments of the monitor of a variant, with further arguments."""
    if variant.startswith("step"):
        more.update(specs=WITHIN, view="step")
    else:
        more.update(specs=REQUIRED)
    observe = next((name for name in ("state", "obligations") if variant.endswith(name)), None)
    clip = 2.0  # margins go down to -1.8
    return {"signals": SIGNALS, "period": 1, "clip": clip, "observe": observe, **more}


def make_env(variant: str) -> gym.Env[Any, Any]:
    """Return the corridor of a variant, without a monitor."""
    env: gym.Env[Any, Any] = gym.wrappers.TimeLimit(Corridor(stride=0.2), STEPS)
    return Clocks(env) if variant.endswith("clocks") else env


def policy_env(variant: str) -> gym.Env[Any, Any]:
    """Return the corridor with the observations of a variant."""
    return StlMonitor(make_env(variant), **monitored(variant, on_violation="report"))


def training_env(variant: str) -> gym.Env[Any, Any]:
    """Return the training environment of a variant."""
    match variant.partition("-")[0]:
        case "plain":
            return make_env(variant)
        case "sparse":  # 1 at the end of an episode that satisfies the requirement
            return Paying(policy_env(variant), lambda _, ended, info: ended and info["stl_success"])
        case "naive" | "step":  # the robustness: of the samples so far, or of the newest instant
            options = monitored(variant, on_violation="report")
            return StlReward(make_env(variant), mode="replace", **options)
        case "alive":  # 1 for every step until a violation ends the episode
            return Paying(StlMonitor(make_env(variant), **monitored(variant)), lambda *_: 1.0)
        case _:  # a potential, and 1 less for the violation that ends the episode
            options = monitored(variant, gamma=GAMMA, penalty=1.0)
            return StlReward(make_env(variant), mode="potential", **options)


def learner(variant: str, seed: int) -> Any:
    """Return PPO, with the same parameters for all variants."""
    from stable_baselines3 import PPO
    from stable_baselines3.common.env_util import make_vec_env

    return PPO(
        "MlpPolicy",
        make_vec_env(lambda: training_env(variant), 8, seed=seed),
        n_steps=256,
        batch_size=256,
        learning_rate=1e-3,
        gamma=GAMMA,
        seed=seed,
        device="cpu",
    )


TASK = Task(
    name="patrol",
    required=REQUIRED,
    signals=SIGNALS,
    period=1.0,
    policy_env=policy_env,
    learner=learner,
    variants=(
        "plain",
        "sparse",
        "naive",
        "step",
        "step-state",
        "step-obligations",
        "step-clocks",
        "alive-obligations",
        "penalty-state",
        "penalty-obligations",
    ),
    ours="penalty-obligations",
    drawn=("plain", "naive", "penalty-state", "penalty-obligations", "step-clocks"),
    first_seed=400,
    steps=81_920,
    points=10,
    episodes=10,
)

if __name__ == "__main__":
    main(TASK, __doc__)
