"""A window inside of another: a point is to be at both ends of a corridor, again and again.

At every instant each end must be visited within the next 40 steps. What the learner has to know is
how long ago it was there, which neither its observation says nor the robustness of the formula.

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
SIGNALS = {"x": ("info['x']", 0.0)}  # at a reset info has x too
STEPS = 200  # so that the last window is seen to its end
GAMMA = 0.98


class Clocks(gym.Wrapper[Any, Any, Any, Any]):
    """Made by hand for this task: since when x was at neither end, as fractions of 40 steps."""

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        """Two more numbers are observed."""
        super().__init__(env)
        self.observation_space = gym.spaces.Box(-1.0, 1.0, (3,), np.float32)
        self._since = np.zeros(2)

    def reset(self, **options: Any) -> tuple[Any, dict[str, Any]]:
        """Starts the clocks."""
        self._since[:] = 0.0
        obs, info = self.env.reset(**options)
        return self._observed(obs), info

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Steps the clocks too."""
        self._since += 1 / 40
        obs, *others = self.env.step(action)
        return self._observed(obs), *others

    def _observed(self, obs: Any) -> Any:
        self._since[[obs[0] < -0.8, obs[0] > 0.8]] = 0.0
        return np.append(obs, np.minimum(self._since, 1.0)).astype(np.float32)


def monitored(variant: str, **more: Any) -> dict[str, Any]:
    """The arguments of a monitor that observes what the variant does, and more of them."""
    if variant.startswith("step"):
        more.update(specs=WITHIN, view="step")
    else:
        more.update(specs=REQUIRED)
    observe = next((name for name in ("state", "obligations") if variant.endswith(name)), None)
    clip = 2.0  # margins go down to -1.8
    return {"signals": SIGNALS, "period": 1, "clip": clip, "observe": observe, **more}


def made(variant: str) -> gym.Env[Any, Any]:
    """The corridor of a variant, without a monitor."""
    env: gym.Env[Any, Any] = gym.wrappers.TimeLimit(Corridor(stride=0.2), STEPS)
    return Clocks(env) if variant.endswith("clocks") else env


def seen(variant: str) -> gym.Env[Any, Any]:
    """The corridor as the policy of a variant sees it."""
    return StlMonitor(made(variant), **monitored(variant, on_violation="report"))


def trained(variant: str) -> gym.Env[Any, Any]:
    """What a variant learns in."""
    match variant.partition("-")[0]:
        case "plain":
            return made(variant)
        case "sparse":  # 1 at the end of an episode that satisfies the requirement
            return Paying(seen(variant), lambda _, ended, info: ended and info["stl_success"])
        case "naive" | "step":  # the robustness: of the samples so far, or of the newest instant
            kept = monitored(variant, on_violation="report")
            return StlReward(made(variant), mode="replace", **kept)
        case "alive":  # 1 for every step until a violation ends the episode
            return Paying(StlMonitor(made(variant), **monitored(variant)), lambda *_: 1.0)
        case _:  # a potential, and 1 less for the violation that ends the episode
            kept = monitored(variant, gamma=GAMMA, penalty=1.0)
            return StlReward(made(variant), mode="potential", **kept)


def learner(variant: str, seed: int) -> Any:
    """PPO, the same for all."""
    from stable_baselines3 import PPO
    from stable_baselines3.common.env_util import make_vec_env

    return PPO(
        "MlpPolicy",
        make_vec_env(lambda: trained(variant), 8, seed=seed),
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
    seen=seen,
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
