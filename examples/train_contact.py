"""A contact between two observations: a finger must press a plate, and never with 50 N or more.

Observations are 0.1 s apart, and the peak of a hard contact lasts a tenth of that. Does an end at
the violation keep the limit if the monitor sees the observations, and if it sees every physics
step?

Run: python examples/train_contact.py --seeds 10 --output contact.csv
"""

from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.envs.mujoco import MujocoEnv
from gymnasium.spaces import Box
from gymnasium.wrappers import TimeLimit
from numpy.typing import NDArray
from training import Task, main

from rtamt_gym import StlMonitor

MODEL = Path(__file__).with_name("models") / "finger.xml"
STEPS = 15
GENTLE, THERE = "always(force < 50)", "eventually[0:1.5](x > -0.01)"
REQUIRED = {"gentle": GENTLE, "there": THERE}
FORCE = {"force": "contact:tip,plate.force"}
SIGNALS = {**FORCE, "x": "joint:slide.qpos"}


class Finger(MujocoEnv):
    """A finger of 1 kg on a rail, driven with up to 2 N, before a plate that it touches at x = 0.

    It starts about 0.55 m before the plate, and observes its position and speed every 0.1 s. The
    reward grows near the plate, to at most 1 per step.
    """

    metadata = {  # noqa: RUF012 - as Gymnasium declares it
        "render_modes": ["human", "rgb_array", "depth_array", "rgbd_tuple"],
        "render_fps": 10,
    }

    def __init__(self) -> None:
        """Load the model; a step of the environment has 50 physics steps."""
        space = Box(-np.inf, np.inf, (2,), np.float64)
        super().__init__(str(MODEL), frame_skip=50, observation_space=space)

    def reset_model(self) -> NDArray[np.float64]:
        """Start at rest, anywhere within 4 cm."""
        position = self.np_random.uniform(-0.57, -0.53, 1)
        self.set_state(position, np.zeros(1))  # type: ignore[no-untyped-call]
        return self._observation()

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[NDArray[np.float64], np.float64, bool, bool, dict[str, np.float64]]:
        """Push with a constant force for 0.1 s."""
        self.do_simulation(action, self.frame_skip)
        reward = np.float64(1.0 - abs(self.data.qpos[0]) / 0.6)
        return self._observation(), reward, False, False, {}

    def _observation(self) -> NDArray[np.float64]:
        return np.concatenate([self.data.qpos, self.data.qvel])


def make_env() -> gym.Env[Any, Any]:
    """Return the environment without a monitor, for 1.5 s."""
    return TimeLimit(Finger(), STEPS)


def training_env(variant: str) -> gym.Env[Any, Any]:
    """Return the training environment of a variant, which may end at a violation."""
    if variant == "plain":
        return make_env()
    return StlMonitor(
        make_env(), GENTLE, FORCE, on_violation="terminate", substeps=variant == "substeps"
    )


def learner(variant: str, seed: int) -> Any:
    """Return SAC, with the same parameters for all variants."""
    from stable_baselines3 import SAC

    return SAC(
        "MlpPolicy",
        training_env(variant),
        learning_rate=2e-3,
        buffer_size=10_000,
        learning_starts=200,
        batch_size=64,
        gamma=0.95,
        policy_kwargs={"net_arch": [64, 64]},
        seed=seed,
        device="cpu",
    )


TASK = Task(
    name="contact",
    required=REQUIRED,
    signals=SIGNALS,
    period=None,
    policy_env=lambda _: make_env(),
    learner=learner,
    variants=("plain", "observed", "substeps"),
    ours="substeps",
    drawn=("plain", "observed", "substeps"),
    first_seed=50_000,
    steps=2400,
    points=3,
    episodes=100,
    substeps=True,
)

if __name__ == "__main__":
    main(TASK, __doc__)
