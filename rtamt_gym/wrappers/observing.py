"""What the wrappers share that append the state of monitors to observations."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal, get_args

import gymnasium as gym
import numpy as np
from gymnasium.vector import VectorEnv, VectorWrapper
from gymnasium.vector.utils import batch_space

from rtamt import InputError
from rtamt_gym.checks.arguments import check_choice, check_number
from rtamt_gym.checks.callers import caller_level
from rtamt_gym.judging.obligations import Obligation
from rtamt_gym.judging.values import MonitorValues
from rtamt_gym.signals.columns import Lanes
from rtamt_gym.wrappers.clipping import ObservedWatch
from rtamt_gym.wrappers.features import StateFeatures, append, appended_space

__all__ = ["Observe", "Observing"]

Observe = Literal["state", "obligations"]
"""What is appended to the observation."""


class Observing:
    """A base of wrappers of one environment, and of wrappers of many."""

    _state: StateFeatures | None = None
    """What is appended to the observation; None if nothing is."""
    _observe: Observe | None
    _shown_of: tuple[str, ...]

    def _set_up_observations(
        self,
        env: Any,  # noqa: ANN401 - an environment, or many
        observe: Observe | None,
        clip: float,
        monitors: Mapping[str, tuple[Any, Any]],
        track: Callable[[], list[list[Obligation]]],
        weights: Sequence[float] | None = None,
        *,
        whole: bool = False,
    ) -> None:
        """Checks what is to be observed, and makes the spaces of it.

        Args:
            env: The environment inside of the wrapper.
            observe: The argument of the wrapper.
            clip: The argument of the wrapper: the bound of the numbers appended.
            monitors: The monitors of each specification: ``(robustness source, judge)``.
            track: Makes the monitors follow what temporal operators owe.
            weights: A factor of the robustness of each specification; None: 1.
            whole: Whether the robustness shown judges the whole episode in every view.

        Raises:
            InputError: If ``observe`` or ``clip`` is not what it can be, if nothing can be
                appended, or if a wrapper inside appends the state already.
        """
        check_choice("observe", observe, (None, *get_args(Observe)))
        bound = check_number("clip", clip)
        self._state, self._observe, self._shown_of = None, observe, tuple(monitors)
        self._looking: ObservedWatch | None = None
        if observe is None:
            return
        _refuse_twice(env, type(self).__name__, observe)
        horizons = _horizons(monitors)
        factors = (1.0,) * len(horizons) if weights is None else tuple(weights)
        operators = tuple(map(tuple, track())) if observe == "obligations" else None
        self._state = StateFeatures(factors, bound, horizons, whole=whole, operators=operators)
        num = env.num_envs if isinstance(env, VectorEnv) else 1
        self._looking = ObservedWatch(observe, self._shown_of, factors, bound, num)
        wrapper: Any = self  # of one environment, or of many
        if isinstance(env, VectorEnv):
            space = appended_space(env.single_observation_space, self._state.box, observe)
            wrapper.single_observation_space = space
            wrapper.observation_space = batch_space(space, env.num_envs)
        else:
            wrapper.observation_space = appended_space(
                env.observation_space, self._state.box, observe
            )

    def _follow_monitors(
        self, monitors: Mapping[str, tuple[Any, Any]], track: Callable[[], list[list[Obligation]]]
    ) -> None:
        """Shows other monitors from now on, of as many operators: constants have changed."""
        state = self._state
        if state is not None:
            operators = None if state.operators is None else tuple(map(tuple, track()))
            self._state = replace(state, horizons=_horizons(monitors), operators=operators)

    @property
    def observed(self) -> list[str]:
        """What each number is that is appended to the observation, in their order.

        Example:
            >>> import gymnasium as gym
            >>> from rtamt_gym import StlMonitor
            >>> env = StlMonitor(
            ...     gym.make("CartPole-v1"),
            ...     "always(eventually[0:1](x > 0))",
            ...     {"x": "obs[0]"},
            ...     observe="obligations",
            ... )
            >>> for what in env.observed:
            ...     print(what)
            spec: robustness
            spec: lower
            spec: upper
            spec: time left
            spec: verdict
            spec: clock of eventually[0:1](x > 0)
            spec: margin of x > 0
        """
        return [] if self._state is None else self._state.names(self._shown_of)

    def _observed(self, obs: Any, values: MonitorValues[Any]) -> Any:  # noqa: ANN401
        """The observation, or the batch of them, with what is to be appended."""
        return obs if self._state is None else append(obs, self._state.read(values))

    def _look_at_reset(self, values: MonitorValues[Any], lanes: Lanes | None = None) -> None:
        """Sees what is observed at the resets of the environments of the mask; None: of all."""
        if self._looking is not None:
            self._looking.reset(self._shown_robustness(values), lanes)
            self._tell_of_clip()

    def _look(self, values: MonitorValues[Any], ended: Any) -> None:  # noqa: ANN401 - a bool, or many
        """Sees what is observed after a step, which has ended some episodes."""
        watch = self._looking
        if watch is None:
            return
        robustness = self._shown_robustness(values)
        watch.step(robustness)
        if ended is not False and np.any(ended):
            watch.end(robustness, np.atleast_1d(ended))
            self._tell_of_clip()

    def _shown_robustness(self, values: MonitorValues[Any]) -> Sequence[Any]:
        whole = self._state is not None and self._state.whole
        return values.judged if whole else values.robustness

    def _tell_of_clip(self) -> None:
        """Warns once ten episodes have ended, if most samples were clipped."""
        watch = self._looking
        if watch is not None and watch.finished:
            self._looking = None
            if watch.report is not None:
                warnings.warn(watch.report, UserWarning, stacklevel=caller_level())

    def _observed_last(
        self,
        infos: dict[str, Any],
        values: MonitorValues[Any] | None,
        ended: Lanes | None,
    ) -> None:
        """Appends to the observations from before the resets in a step: ``final_obs``.

        ``values`` are those from before the resets, ``ended`` says where; None: there were none.
        """
        if self._state is None or values is None or ended is None or "final_obs" not in infos:
            return
        final, numbers = infos["final_obs"], self._state.read(values)
        if not isinstance(final, np.ndarray) or final.dtype != object:
            infos["final_obs"] = append(final, numbers)
            return
        # An object for each environment, as Gymnasium has them.
        shown = final.copy()
        for lane in np.flatnonzero(ended):
            shown[lane] = append(final[lane], numbers[lane])
        infos["final_obs"] = shown


def _horizons(monitors: Mapping[str, tuple[Any, Any]]) -> tuple[int | None, ...]:
    return tuple(judge.program.latency for _, judge in monitors.values())


def _refuse_twice(env: Any, name: str, observe: Observe) -> None:  # noqa: ANN401 - an environment, or many
    while isinstance(env, gym.Wrapper | VectorWrapper):
        if isinstance(env, Observing) and env._state is not None:  # noqa: SLF001 - the same class
            inner = type(env).__name__
            raise InputError(
                f"observe={observe!r} of {name} would append what observe={env._observe!r} of "  # noqa: SLF001 - the same class
                f"the {inner} inside of it has appended already; give observe= to one of them"
            )
        env = env.env
