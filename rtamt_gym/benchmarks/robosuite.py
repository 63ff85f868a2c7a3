"""Tasks of robosuite as environments of Gymnasium that monitors can read.

robosuite 1.5 needs MuJoCo below 3.10 and ``h5py``: ``pip install robosuite 'mujoco<3.10' h5py``.
Importing this module registers ``robosuite/Lift-v0`` and the other tasks of `TASKS`. ``robots`` and
the arguments of ``robosuite.make`` are arguments of ``gymnasium.make``.
"""

from __future__ import annotations

from typing import Any, Final

import gymnasium as gym
import numpy as np
from gymnasium import spaces

from rtamt import InputTypeError
from rtamt_gym.benchmarks import benchmark

__all__ = ["TASKS", "RobosuiteEnv", "make"]

TASKS: Final = (
    "Door",
    "Lift",
    "NutAssembly",
    "NutAssemblyRound",
    "NutAssemblySquare",
    "PickPlace",
    "PickPlaceBread",
    "PickPlaceCan",
    "PickPlaceCereal",
    "PickPlaceMilk",
    "PickPlaceSingle",
    "Stack",
    "ToolHang",
    "Wipe",
)
"""The tasks of one arm, with the ids ``robosuite/NAME-v0``."""


class RobosuiteEnv(gym.Env[dict[str, Any], Any]):
    """An environment of robosuite as an environment of Gymnasium.

    * ``info["success"]`` is 1.0 if the task is done, otherwise 0.0; also in the info of a reset.
    * The end of the horizon truncates an episode, so windows that it cuts stay open. robosuite's
      own ``GymWrapper`` terminates it.
    * A seed repeats an episode: ``reset(seed=)`` seeds the generator of robosuite.
    * ``dt`` is the time between two steps; ``model`` and ``data`` are MuJoCo's own, for selectors
      such as ``body:cube_main.xpos[2]``. robosuite replaces them at a reset.

    Observations are a dictionary of arrays. Selectors read them as ``obs['cube_pos'][2]``.

    Args:
        env: An environment from ``robosuite.make``; it is reset once to learn its observations.

    Raises:
        InputTypeError: If it is not an environment of robosuite.
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012 - as Gymnasium has it

    def __init__(self, env: Any) -> None:  # noqa: ANN401 - robosuite is not typed
        missing = [name for name in _NEEDED if not hasattr(env, name)]
        if missing or isinstance(env, gym.Env):
            raise InputTypeError(
                "expected an environment that robosuite.make has made, without GymWrapper, got "
                f"{type(env).__name__}"
            )
        self.robosuite = env
        low, high = env.action_spec
        self.action_space = spaces.Box(low.astype(np.float32), high.astype(np.float32))
        self.observation_space = spaces.Dict(
            {name: _space(value) for name, value in _arrays(env.reset()).items()}
        )

    @property
    def dt(self) -> float:
        """Seconds between two steps."""
        return float(self.robosuite.control_timestep)

    @property
    def model(self) -> Any:  # noqa: ANN401 - MuJoCo is optional
        """MuJoCo's model of the episode."""
        return self.robosuite.sim.model._model  # noqa: SLF001 - what it wraps has no other name

    @property
    def data(self) -> Any:  # noqa: ANN401 - see `model`
        """MuJoCo's state of the episode."""
        return self.robosuite.sim.data._data  # noqa: SLF001 - as `model`

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Start an episode; a seed determines everything that is random in it."""
        super().reset(seed=seed, options=options)
        if seed is not None:
            # In place, for samplers of positions hold the generator.
            fresh = np.random.default_rng(seed).bit_generator.state
            self.robosuite.rng.bit_generator.state = fresh
        return _arrays(self.robosuite.reset()), self._info({})

    def step(self, action: Any) -> tuple[dict[str, Any], float, bool, bool, dict[str, Any]]:  # noqa: ANN401
        """Make a step; the end of the horizon is a truncation."""
        env = self.robosuite
        shown, reward, done, info = env.step(action)
        over = bool(done) and env.timestep >= env.horizon
        return _arrays(shown), float(reward), bool(done) and not over, over, self._info(info)

    def close(self) -> None:
        """Close the simulation."""
        self.robosuite.close()

    def _info(self, info: dict[str, Any]) -> dict[str, Any]:
        return {**info, "success": float(self.robosuite._check_success())}  # noqa: SLF001 - its only name


_NEEDED: Final = ("_check_success", "action_spec", "control_timestep", "horizon", "rng", "sim")


def make(task: str, robots: Any = "Panda", **arguments: Any) -> RobosuiteEnv:  # noqa: ANN401 - robosuite's own
    """Return a task of robosuite, without images unless ``arguments`` request them.

    Args:
        task: Its name, such as ``"Lift"``.
        robots: The robot, or several.
        **arguments: Further arguments of ``robosuite.make``, such as ``horizon=200``.
    """
    robosuite = benchmark("robosuite", "robosuite 'mujoco<3.10' h5py")
    drawn = dict.fromkeys(("has_renderer", "has_offscreen_renderer", "use_camera_obs"), False)
    return RobosuiteEnv(robosuite.make(task, robots=robots, **{**drawn, **arguments}))


def _arrays(shown: Any) -> dict[str, Any]:  # noqa: ANN401 - robosuite's dictionary
    """Return an observation as a dictionary of arrays."""
    return {name: np.atleast_1d(np.asarray(value)) for name, value in shown.items()}


def _space(value: Any) -> spaces.Box:  # noqa: ANN401 - an array
    if value.dtype.kind == "u":  # a picture
        return spaces.Box(0, np.iinfo(value.dtype).max, value.shape, value.dtype)
    return spaces.Box(-np.inf, np.inf, value.shape, value.dtype)


for _task in TASKS:
    if f"robosuite/{_task}-v0" not in gym.registry:
        gym.register(
            f"robosuite/{_task}-v0", f"{__name__}:make", kwargs={"task": _task}, order_enforce=False
        )
