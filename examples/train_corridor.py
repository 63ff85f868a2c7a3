"""Memory: a point in a corridor must visit both ends, and does not observe earlier positions.

The monitor remembers them. Its state in the observation is compared with no memory, a stack of the
last four observations, and a recurrent policy. Rewards from robustness are compared with rewards
for success alone.

Run: python examples/train_corridor.py --seeds 10 --jobs 2 --output corridor.csv
"""

from typing import Any

import gymnasium as gym
import numpy as np
from corridor import Corridor
from training import Paying, Task, main

from rtamt_gym import StlMonitor, StlReward

REQUIRED = {"left": "eventually[0:50](x < -0.8)", "right": "eventually[0:50](x > 0.8)"}
SIGNALS = {"x": ("info['x']", 0.0)}  # info has x also at a reset
STEPS = 50
GAMMA = 0.98
BONUS = 5.0  # paid once, as soon as both ends have been visited


def make_env(variant: str) -> gym.Env[Any, Any]:
    """Return the corridor of a variant, without a monitor."""
    env: gym.Env[Any, Any] = gym.wrappers.TimeLimit(Corridor(stride=0.1), STEPS)
    if variant.endswith("stack"):
        frames = gym.wrappers.FrameStackObservation(env, 4, padding_type="reset")
        env = gym.wrappers.FlattenObservation(frames)
    if variant.startswith("dqn"):  # left, stay, right
        env = gym.wrappers.TransformAction(
            env, lambda action: np.array([action - 1.0]), gym.spaces.Discrete(3)
        )
    return env


def monitored(variant: str) -> dict[str, Any]:
    """Return the arguments of the monitor, which ends no episode."""
    return {
        "specs": REQUIRED,
        "signals": SIGNALS,
        "period": 1,
        "on_violation": "report",
        "observe": "state" if variant.endswith("state") else None,
        "clip": 2.0,  # margins go down to -1.8
    }


def policy_env(variant: str) -> gym.Env[Any, Any]:
    """Return the corridor with the observations of a variant."""
    return StlMonitor(make_env(variant), **monitored(variant))


def training_env(variant: str) -> gym.Env[Any, Any]:
    """Return the training environment of a variant."""
    mode = variant.removeprefix("dqn-").partition("-")[0]
    shaped: dict[str, Any]
    match mode:
        case "plain":
            return make_env(variant)
        case "naive":  # the robustness of the samples so far
            shaped = {"mode": "replace"}
        case "sparse":  # the bonus alone, at the end
            return Paying(
                policy_env(variant), lambda _, ended, info: BONUS * (ended and info["stl_success"])
            )
        case _:
            # Progress counts twice: while windows are open, only the lower bound rises.
            weight = 2.0 if mode == "progress" else 1.0
            shaped = {"mode": mode, "weight": weight, "gamma": GAMMA, "bonus": BONUS}
    return StlReward(make_env(variant), **shaped, **monitored(variant))


def learner(variant: str, seed: int) -> Any:
    """Return PPO with the same parameters for all variants, recurrent PPO, or DQN."""
    from sb3_contrib import RecurrentPPO
    from stable_baselines3 import DQN, PPO
    from stable_baselines3.common.env_util import make_vec_env

    envs = make_vec_env(lambda: training_env(variant), 8, seed=seed)
    options: dict[str, Any] = {"learning_rate": 1e-3, "gamma": GAMMA, "seed": seed, "device": "cpu"}
    if variant.startswith("dqn"):
        options.update(exploration_initial_eps=0.2, exploration_final_eps=0.2, buffer_size=50_000)
        options.update(learning_starts=1000, batch_size=64, train_freq=1, gradient_steps=2)
        return DQN("MlpPolicy", envs, target_update_interval=1000, **options)
    options.update(n_steps=128)
    if variant.endswith("lstm"):  # batches of whole episodes and one memory, for speed
        size: dict[str, Any] = {
            "lstm_hidden_size": 64,
            "shared_lstm": True,
            "enable_critic_lstm": False,
        }
        return RecurrentPPO("MlpLstmPolicy", envs, batch_size=512, policy_kwargs=size, **options)
    return PPO("MlpPolicy", envs, batch_size=256, **options)


TASK = Task(
    name="corridor",
    required=REQUIRED,
    signals=SIGNALS,
    period=1.0,
    policy_env=policy_env,
    learner=learner,
    variants=(
        "plain",
        "sparse",
        "naive",
        "progress",
        "sparse-state",
        "naive-state",
        "terminal-state",
        "potential-state",
        "progress-state",
        "sparse-stack",
        "progress-stack",
        "sparse-lstm",
        "progress-lstm",
        "dqn-sparse",
        "dqn-sparse-state",
        "dqn-progress-state",
    ),
    ours="progress-state",
    drawn=("plain", "naive", "sparse-state", "progress-state"),
    first_seed=300,
    steps=98_304,
    points=12,
    episodes=20,
)

if __name__ == "__main__":
    main(TASK, __doc__)
