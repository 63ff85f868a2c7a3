"""Memory: a point in a corridor is to visit both ends, and cannot see where it has been.

The monitor knows. Its state in the observation is compared with no memory, a stack of the last four
observations, and a recurrent policy; what robustness pays is compared with what success alone pays.

Run: python examples/train_corridor.py --seeds 10 --jobs 2 --output corridor.csv
"""

from typing import Any

import gymnasium as gym
import numpy as np
from corridor import Corridor
from training import Paying, Task, main

from rtamt_gym import StlMonitor, StlReward

REQUIRED = {"left": "eventually[0:50](x < -0.8)", "right": "eventually[0:50](x > 0.8)"}
SIGNALS = {"x": ("info['x']", 0.0)}  # at a reset info has x too
STEPS = 50
GAMMA = 0.98
BONUS = 5.0  # paid once, as soon as both ends have been visited


def made(variant: str) -> gym.Env[Any, Any]:
    """The corridor of a variant, without a monitor."""
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
    """The arguments of the monitor, which ends no episode and observes what the variant does."""
    return {
        "specs": REQUIRED,
        "signals": SIGNALS,
        "period": 1,
        "on_violation": "report",
        "observe": "state" if variant.endswith("state") else None,
        "clip": 2.0,  # margins go down to -1.8
    }


def seen(variant: str) -> gym.Env[Any, Any]:
    """The corridor as the policy of a variant sees it."""
    return StlMonitor(made(variant), **monitored(variant))


def trained(variant: str) -> gym.Env[Any, Any]:
    """What a variant learns in."""
    mode = variant.removeprefix("dqn-").partition("-")[0]
    shaped: dict[str, Any]
    match mode:
        case "plain":
            return made(variant)
        case "naive":  # the robustness of the samples so far
            shaped = {"mode": "replace"}
        case "sparse":  # the bonus alone, at the end
            return Paying(
                seen(variant), lambda _, ended, info: BONUS * (ended and info["stl_success"])
            )
        case _:
            # progress counts twice: while windows are open only the lower bound gains.
            weight = 2.0 if mode == "progress" else 1.0
            shaped = {"mode": mode, "weight": weight, "gamma": GAMMA, "bonus": BONUS}
    return StlReward(made(variant), **shaped, **monitored(variant))


def learner(variant: str, seed: int) -> Any:
    """PPO, the same for all but the two that need another: a recurrent one, and DQN."""
    from sb3_contrib import RecurrentPPO
    from stable_baselines3 import DQN, PPO
    from stable_baselines3.common.env_util import make_vec_env

    envs = make_vec_env(lambda: trained(variant), 8, seed=seed)
    same: dict[str, Any] = {"learning_rate": 1e-3, "gamma": GAMMA, "seed": seed, "device": "cpu"}
    if variant.startswith("dqn"):
        same.update(exploration_initial_eps=0.2, exploration_final_eps=0.2, buffer_size=50_000)
        same.update(learning_starts=1000, batch_size=64, train_freq=1, gradient_steps=2)
        return DQN("MlpPolicy", envs, target_update_interval=1000, **same)
    same.update(n_steps=128)
    if variant.endswith("lstm"):  # batches of whole episodes, and one memory, or it takes too long
        size: dict[str, Any] = {
            "lstm_hidden_size": 64,
            "shared_lstm": True,
            "enable_critic_lstm": False,
        }
        return RecurrentPPO("MlpLstmPolicy", envs, batch_size=512, policy_kwargs=size, **same)
    return PPO("MlpPolicy", envs, batch_size=256, **same)


TASK = Task(
    name="corridor",
    required=REQUIRED,
    signals=SIGNALS,
    period=1.0,
    seen=seen,
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
