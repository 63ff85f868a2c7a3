"""The Gymnasium environment of a scenario."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, cast

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike, NDArray

from rtamt import InputError, InputTypeError
from rtamt_envs.scenario import Declared, EpisodeSoFar, Floats, Quantity, Scenario, scenario_of
from rtamt_envs.scenario_batch import ScenarioBatch
from rtamt_gym.checks.extras import naming_extra

_ONE = np.ones(1, np.bool_)


class ScenarioEnv(Declared, gym.Env[Floats, Floats]):
    """A scenario as an environment: ``gym.make("rtamt/ChasingCars-v0")``.

    An episode never terminates; ``gym.make`` truncates it after the duration of the scenario, or
    after ``max_episode_steps=``. The reward is 0; `rtamt_gym.StlReward` adds a reward. Actions out
    of bounds are clipped. Actions and observations are arrays of float64.

    Attributes:
        scenario: The declaration, with units and source.
        dt: Seconds of a step.
        requirements: The requirements by name, as specifications.
        signals: The selector of each name of the observation, for wrappers and `simulate`.
        parameters: The parameters of the current episode by name.
        action_names: The names of the components of an action.

    Args:
        scenario: The name of the scenario; ``gym.make`` sets it.
        parameters: Values of parameters in all episodes, by name. ``reset(options={...})`` sets
            them for one episode.
        render_mode: ``"rgb_array"`` for `render`, or None.

    Raises:
        InputError: If a parameter is unknown, or its value is not a number.

    Example:
        >>> import gymnasium as gym, rtamt_envs
        >>> from rtamt_gym import simulate
        >>> env = gym.make("rtamt/AutomaticTransmission-v0")
        >>> run = simulate(env, env.unwrapped.requirements["AT2"], policy=lambda obs: [100, 0])
        >>> run.histories
        {'AT2': <History of always[0:10](rpm < 4750): VIOLATED at sample 611, robustness -1.41>}
    """

    metadata = {  # noqa: RUF012 - as Gymnasium declares it
        "render_modes": ["rgb_array"],
        "render_fps": 30,
    }

    def __init__(
        self,
        scenario: str,
        parameters: Mapping[str, float] | None = None,
        render_mode: Literal["rgb_array"] | None = None,
    ) -> None:
        self.scenario = scenario_of(scenario)
        if render_mode not in {None, "rgb_array"}:
            raise InputError(f"expected render_mode None or 'rgb_array', got {render_mode!r}")
        self.render_mode = render_mode
        self.action_space = box(self.scenario.actions)
        self.observation_space = box(self.scenario.observations)
        self._defaults = self.scenario.parameter_row(parameters or {}, self.scenario.defaults)
        self._entries = ScenarioBatch(self.scenario, self._defaults, 1)
        self._observations: list[Floats] = []
        self._actions: list[Floats] = []

    @property
    def parameters(self) -> dict[str, float]:
        """The parameters of the current episode by name; a copy."""
        names = [parameter.name for parameter in self.scenario.parameters]
        return dict(zip(names, self._entries.parameters[0].tolist(), strict=True))

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Floats, dict[str, Any]]:
        """Start an episode; ``options`` sets parameters for it, by name.

        Raises:
            InputError: If a parameter is unknown, or its value is not a number.
        """
        row = self.scenario.parameter_row(options or {}, self._defaults)
        super().reset(seed=seed)
        self._entries.start(_ONE, (self.np_random,), row[None])
        self._observations, self._actions = [], []
        return self._observation(), {}

    def step(self, action: ArrayLike) -> tuple[Floats, float, bool, bool, dict[str, Any]]:
        """Make a step of ``dt`` seconds.

        Raises:
            InputError: If the shape of the action is wrong, or it is nan; the state is unchanged.
            StateError: Before the first `reset`.
        """
        array = numbers(action, (len(self.scenario.actions),), self.scenario)
        self._entries.step_first(array, self.np_random)
        if self.render_mode:
            self._actions.append(array.copy())
        return self._observation(), 0.0, False, False, {}

    def baseline(self, observation: object = None) -> Floats:  # noqa: ARG002 - as any policy
        """Return the action of the scenario's baseline: a policy for `simulate`."""
        action: Floats = self._entries.baseline()[0]
        return action

    def render(self) -> NDArray[np.uint8] | None:
        """Draw the episode so far as an array of shape (height, width, 3).

        Needs Matplotlib, the extra ``plot``.
        """
        if self.render_mode is None:
            gym.logger.warn('to draw, create the environment with render_mode="rgb_array"')
            return None
        try:
            from rtamt_envs.pictures import frame
        except ModuleNotFoundError as error:
            raise naming_extra(error, "render") from error
        return frame(self.scenario, self.episode())

    def episode(self) -> EpisodeSoFar:
        """Return the episode so far, which an environment with a ``render_mode`` records.

        Raises:
            InputError: If the environment has no ``render_mode``, or no episode has started.
        """
        if not self._observations:
            raise InputError(
                "no episode has started; call reset() first"
                if self.render_mode
                else "the environment records no episode; create it with render_mode='rgb_array'"
            )
        return EpisodeSoFar(
            np.arange(len(self._observations), dtype=np.float64) * self.dt,
            np.array(self._observations),
            np.array(self._actions).reshape(-1, len(self.scenario.actions)),
            self.parameters,
        )

    def _observation(self) -> Floats:
        observation: Floats = self._entries.observations[0].copy()
        if self.render_mode:
            self._observations.append(observation.copy())
        return observation


def box(quantities: tuple[Quantity, ...]) -> gym.Space[Floats]:
    """Return the space of float64 vectors of these quantities."""
    low = np.array([quantity.low for quantity in quantities], np.float64)
    high = np.array([quantity.high for quantity in quantities], np.float64)
    return cast("gym.Space[Floats]", gym.spaces.Box(low, high, dtype=np.float64))


def numbers(action: ArrayLike, shape: tuple[int, ...], scenario: Scenario) -> Floats:
    """Return an action as a float64 array of the shape, or raise an error."""
    names = ", ".join(quantity.name for quantity in scenario.actions)
    try:
        array = np.ascontiguousarray(action, np.float64)
    except (TypeError, ValueError):
        raise InputTypeError(
            f"expected an action ({names}) of {scenario.id}, got {action!r}"
        ) from None
    if array.shape != shape:
        raise InputError(
            f"expected an action ({names}) of shape {shape} for {scenario.id}, got shape "
            f"{array.shape}"
        )
    return array
