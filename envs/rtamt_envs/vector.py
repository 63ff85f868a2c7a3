"""The vector environment of a scenario."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, SupportsIndex

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike

from rtamt import InputError
from rtamt_envs.environment import box, numbers
from rtamt_envs.scenario import Bools, Declared, Floats, scenario_of
from rtamt_envs.scenario_batch import ScenarioBatch


class ScenarioVectorEnv(Declared, VectorEnv[Floats, Floats, Any]):
    """A batch of simulations of a scenario: ``gym.make_vec("rtamt/ChasingCars-v0", 100)``.

    Environment i of a batch that is reset with seed s equals a `ScenarioEnv` that is reset with
    seed s + i, to the last bit. Rewards are 0, no episode terminates, and all are truncated after
    ``max_episode_steps``.

    Attributes:
        scenario: The declaration, with units and source.
        dt: Seconds of a step.
        requirements: The requirements by name, as specifications.
        signals: The selector of each name of the observation, for wrappers.
        parameters: The parameters of the current episodes by name, an array for each.
        action_names: The names of the components of an action.

    Args:
        num_envs: The number of environments.
        scenario: The name of the scenario; ``gym.make_vec`` sets it.
        max_episode_steps: The steps of an episode; ``gym.make_vec`` takes them from the scenario.
        parameters: Values of parameters in all episodes, by name.
        autoreset_mode: When a truncated environment starts a new episode, as in Gymnasium.
        render_mode: None; only `ScenarioEnv` draws.

    Raises:
        InputError: If a parameter is unknown, or its value is not a number.
    """

    def __init__(
        self,
        num_envs: int,
        scenario: str,
        max_episode_steps: int,
        parameters: Mapping[str, float] | None = None,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        render_mode: None = None,
    ) -> None:
        self.scenario = scenario_of(scenario)
        if render_mode is not None:
            raise InputError(
                f"a vector environment has no render_mode={render_mode!r}; draw an environment of "
                f'gym.make({self.scenario.id!r}, render_mode="rgb_array")'
            )
        if num_envs < 1:
            raise InputError(f"expected num_envs of 1 or more, got {num_envs}")
        self.num_envs = num_envs
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        self.metadata = {"autoreset_mode": self.autoreset_mode, "render_modes": []}
        self.single_action_space = box(self.scenario.actions)
        self.single_observation_space = box(self.scenario.observations)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self._limit = max_episode_steps
        self._defaults = self.scenario.parameter_row(parameters or {}, self.scenario.defaults)
        self._entries = ScenarioBatch(self.scenario, self._defaults, num_envs)
        self._generators = [np.random.default_rng() for _ in range(num_envs)]
        self._all = np.ones(num_envs, np.bool_)
        self._ended = np.zeros(num_envs, np.bool_)

    @property
    def parameters(self) -> dict[str, Floats]:
        """The parameters of the current episodes by name; copies of shape (num_envs,)."""
        names = [parameter.name for parameter in self.scenario.parameters]
        return dict(zip(names, self._entries.parameters.T.copy(), strict=True))

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Floats, dict[str, Any]]:
        """Start an episode in every environment.

        Args:
            seed: Environment i gets ``seed + i``, or element i of a sequence. None continues the
                random numbers.
            options: Values of parameters by name, a number or an array with a number per
                environment; and ``"reset_mask"``, an array of booleans that selects the
                environments to reset.

        Raises:
            InputError: If the seeds, the mask or a parameter are wrong.
        """
        values: Any = options or {}
        mask = None
        if isinstance(values, Mapping):
            mask = values.get("reset_mask")
            values = {name: value for name, value in values.items() if name != "reset_mask"}
        selected = self._mask("options['reset_mask']", mask)
        row = self.scenario.parameter_row(values, np.tile(self._defaults, (self.num_envs, 1)))
        seeds = [None] * self.num_envs if seed is None else seed
        if isinstance(seeds, SupportsIndex):
            seeds = [int(seeds) + entry for entry in range(self.num_envs)]
        if len(seeds) != self.num_envs:
            raise InputError(
                f"expected a seed for each of {self.num_envs} environments, got {len(seeds)}"
            )
        for entry in np.flatnonzero(selected).tolist():
            if seeds[entry] is not None:
                self._generators[entry] = gym.utils.seeding.np_random(seeds[entry])[0]
        self._entries.start(selected, self._generators, row)
        self._ended[selected] = False
        return self._entries.observations.copy(), {}

    def step(self, actions: ArrayLike) -> tuple[Floats, Floats, Bools, Bools, dict[str, Any]]:
        """Make a step of ``dt`` seconds in every environment.

        Args:
            actions: An array of shape (num_envs, actions).

        Raises:
            InputError: If the shape of the actions is wrong, or an action is nan; the state is
                unchanged. If an episode has ended, and the caller must reset it.
            StateError: Before the first `reset`.
        """
        array = numbers(actions, (self.num_envs, len(self.action_names)), self.scenario)
        begins = self._ended.copy()
        if self.autoreset_mode is AutoresetMode.DISABLED and begins.any():
            raise InputError(
                f"environment {int(begins.argmax())} has ended; reset it with "
                "options={'reset_mask': ...} before the next step"
            )
        self._entries.step(array, ~begins, self._generators)
        self._begin(begins)
        truncated = self._entries.steps >= self._limit
        self._ended = truncated.copy()
        info: dict[str, Any] = {}
        if self.autoreset_mode is AutoresetMode.SAME_STEP and truncated.any():
            final = np.full(self.num_envs, None, object)
            for entry in np.flatnonzero(truncated):
                final[entry] = self._entries.observations[entry].copy()
            info = {"final_obs": final, "_final_obs": truncated.copy()}
            info |= {"final_info": {}, "_final_info": truncated.copy()}
            self._begin(truncated)
            self._ended[:] = False
        terminated = np.zeros(self.num_envs, np.bool_)
        rewards = np.zeros(self.num_envs)
        return self._entries.observations.copy(), rewards, terminated, truncated, info

    def rollout(self, actions: ArrayLike | int, active: ArrayLike | None = None) -> Floats:
        """Make many steps in one call, without autoreset or time limit, for searches.

        Args:
            actions: An array of shape (steps, num_envs, actions), or a number of steps under the
                baseline of the scenario.
            active: Booleans of shape (num_envs,) that select the environments to step; None for
                all.

        Returns:
            The observations after each step, shape (steps, num_envs, observations); nan in inactive
            environments.

        Raises:
            InputError: If an argument has a wrong shape, or an action of an active environment is
                nan; the state is unchanged.
            StateError: Before the first `reset` of an active environment.
        """
        selected = self._mask("active", active)
        if isinstance(actions, SupportsIndex) and not isinstance(actions, np.ndarray):
            if int(actions) < 0:
                raise InputError(f"expected a number of steps of 0 or more, got {int(actions)}")
            return self._entries.follow(int(actions), selected, self._generators)
        steps = len(np.atleast_1d(np.asarray(actions)))
        shape = steps, self.num_envs, len(self.action_names)
        return self._entries.roll(
            numbers(actions, shape, self.scenario), selected, self._generators
        )

    def baseline(self, observations: object = None) -> Floats:  # noqa: ARG002 - as any policy
        """Return the actions of the baseline, shape (num_envs, actions)."""
        return self._entries.baseline()

    def _begin(self, selected: Bools) -> None:
        """Start episodes with the default parameters, as `ScenarioEnv.reset` without options."""
        if selected.any():
            defaults = np.tile(self._defaults, (self.num_envs, 1))
            self._entries.start(selected, self._generators, defaults)

    def _mask(self, name: str, mask: ArrayLike | None) -> Bools:
        """Return the environments that a mask selects; None selects all."""
        if mask is None:
            return self._all
        mask = np.asarray(mask)
        if mask.shape != (self.num_envs,) or mask.dtype != np.bool_:
            raise InputError(
                f"expected {name} as {self.num_envs} booleans, got {mask.dtype} of shape "
                f"{mask.shape}"
            )
        return mask
