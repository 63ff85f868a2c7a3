"""A speed limit by early termination: HalfCheetah must run, and never faster than 1.5 m/s.

The environment rewards speed. With which rewards or ends of episodes does the learner keep the
limit and still run 10 m in 25 s?

Run: python examples/train_speed_limit.py --seeds 10 --jobs 2 --output speed_limit.csv
"""

from typing import Any

import gymnasium as gym
from training import Paying, Task, main

from rtamt_gym import StlMonitor, StlReward

SLOW, FAR = "always(v < 1.5)", "eventually[0:25](x > 10)"
REQUIRED = {"slow": SLOW, "far": FAR}
SPEED = {"v": "qvel[0]"}
SIGNALS = {"v": "qvel[0]", "x": "qpos[0]"}


def make_env() -> gym.Env[Any, Any]:
    """Return the environment without a monitor, for half the usual time, which is enough."""
    return gym.make("HalfCheetah-v5", max_episode_steps=500)


def training_env(variant: str) -> gym.Env[Any, Any]:
    """Return the training environment of a variant."""
    env = make_env()
    slow: dict[str, Any] = {"specs": SLOW, "signals": SPEED, "on_violation": "report"}
    both: dict[str, Any] = {"specs": REQUIRED, "signals": SIGNALS, "on_violation": "report"}
    match variant:
        case "plain":
            return env
        case "sparse":  # 1 at the end of an episode that satisfies both, and nothing else
            env = StlMonitor(env, **both)
            return Paying(env, lambda _, ended, info: ended and info["stl_success"])
        case "naive" | "naive-wide":  # the robustness of the samples so far, of both
            clip = 3.0 if variant == "naive-wide" else 1.0
            return StlReward(env, mode="replace", clip=clip, weights={"far": 0.1}, **both)
        case "add":
            return StlReward(env, mode="add", clip=1.0, **slow)
        case "add-step":
            return StlReward(env, mode="add", clip=1.0, weight=2.0, view="step", **slow)
        case "cost":  # 1 less for every sample beyond the limit
            env = StlMonitor(env, cost="violation", **slow)
            return Paying(env, lambda reward, _, info: reward - info["cost"])
        case "truncate":
            return StlMonitor(env, SLOW, SPEED, on_violation="truncate")
        case _:
            return StlMonitor(env, SLOW, SPEED, on_violation="terminate")


def learner(variant: str, seed: int) -> Any:
    """Return PPO, with the same parameters for all variants."""
    from stable_baselines3 import PPO
    from stable_baselines3.common.env_util import make_vec_env
    from stable_baselines3.common.vec_env import VecNormalize

    return PPO(
        "MlpPolicy",
        VecNormalize(make_vec_env(lambda: training_env(variant), 4, seed=seed)),
        n_steps=512,
        batch_size=512,
        learning_rate=5e-4,
        policy_kwargs={"log_std_init": -0.5},
        seed=seed,
        device="cpu",
    )


TASK = Task(
    name="speed_limit",
    required=REQUIRED,
    signals=SIGNALS,
    period=None,
    policy_env=lambda _: make_env(),
    learner=learner,
    variants=(
        "plain",
        "sparse",
        "naive",
        "naive-wide",
        "add",
        "add-step",
        "cost",
        "truncate",
        "terminate",
    ),
    ours="terminate",
    drawn=("plain", "naive", "truncate", "terminate"),
    first_seed=100,
    steps=163_840,
    points=4,
    episodes=10,
)

if __name__ == "__main__":
    main(TASK, __doc__)
