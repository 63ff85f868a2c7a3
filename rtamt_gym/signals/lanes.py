"""Functions that read a vector environment: called for each environment, or once for all."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import compress
from typing import Any, NoReturn

import numpy as np
from gymnasium.vector import SyncVectorEnv
from gymnasium.vector.utils import iterate
from numpy.typing import NDArray

from rtamt import InputError, RtamtError
from rtamt_gym.signals.batches import batch_of_one
from rtamt_gym.signals.signals import ParsedSignal, Step

__all__ = ["Apart", "AtOnce", "EachLane"]


class Apart:
    """Takes a step of many environments apart, once for all functions that read it.

    Args:
        env: The vector environment, or what stands for it.
        same_step: Whether it resets an environment in the step that ends its episode.
    """

    def __init__(self, env: Any, *, same_step: bool) -> None:  # noqa: ANN401
        self._env = env
        base = getattr(env, "unwrapped", None)
        self._envs: list[Any]
        if isinstance(base, SyncVectorEnv) and not same_step:
            self._envs = [*base.envs]
        else:
            why = "with AutoresetMode.SAME_STEP they are reset before the end is seen"
            why = why if same_step else "its environments cannot be looked into"
            self._envs = [_Hidden(env, lane, why) for lane in range(env.num_envs)]
        self._steps: dict[bool, list[Step]] = {}

    def forget(self) -> None:
        """Forgets the last step: the environment may write into the same arrays."""
        self._steps = {}

    def steps(self, step: Step) -> list[Step]:
        """The step of each environment.

        Between two calls of `forget` all steps have the same observations and infos, but at a reset
        no action and no reward.
        """
        begins = step.action is None
        if begins not in self._steps:
            num, env = self._env.num_envs, self._env
            other = self._steps.get(not begins)
            if other is None:
                shown = list(iterate(env.observation_space, step.obs))
                told = _apart(step.info, num)
            else:
                shown, told = [each.obs for each in other], [each.info for each in other]
            nothing = [None] * num
            actions = nothing if begins else list(iterate(env.action_space, step.action))
            rewards = nothing if step.reward is None else list(step.reward)
            self._steps[begins] = [
                Step(*each) for each in zip(shown, actions, rewards, told, self._envs, strict=True)
            ]
        return self._steps[begins]

    def alone(self, step: Step, lane: int) -> Step:
        """The step of one environment as a batch of one."""
        one = batch_of_one(
            self.steps(step)[lane],
            self._env.single_observation_space,
            self._env.single_action_space,
        )
        whole: Step = one._replace(env=step.env)
        return whole


class EachLane:
    """Reads a function of one environment: called for each of the mask."""

    def __init__(self, signal: ParsedSignal, apart: Apart) -> None:
        self._signal = signal
        self._function: Any = signal.reads
        self._apart = apart

    def __call__(self, step: Step, lanes: NDArray[np.bool_]) -> NDArray[np.float64]:
        """The column of the signal; 0 outside of the mask."""
        function, num = self._function, len(lanes)
        steps: Iterable[Step] = self._apart.steps(step)
        if not lanes.all():
            steps = compress(steps, lanes.tolist())
        try:
            values = [function(each) for each in steps]
        except Exception as error:
            self._tell_of_batches(step, num, error)
            raise self._signal.raised(error) from error
        column = np.zeros(num)
        column[lanes] = self._numbers(step, values, num)
        return column

    def _numbers(self, step: Step, values: list[Any], num: int) -> Any:  # noqa: ANN401
        try:
            found = np.array(values)
        except ValueError:  # of arrays of several shapes
            found = np.array(None)
        if found.shape == (len(values),) and found.dtype.kind in "biuf":
            return found
        try:
            return [self._signal.number(value, _OF_ONE) for value in values]
        except RtamtError as error:
            self._tell_of_batches(step, num, error)
            raise

    def _tell_of_batches(self, step: Step, num: int, error: Exception) -> None:
        """Raises an error that names `batched`, if the function is one of the whole batch."""
        signal = self._signal
        try:
            signal.numbers(signal.call(step), num)
        except RtamtError:
            return
        raise InputError(
            f"{signal.raised(error)}; the function is called for each environment, and for the "
            f"batch of all it gives {num} numbers: mark it, rtamt_gym.batched({signal})"
        ) from error


_OF_ONE = (
    "; a function is given the rtamt_gym.Step of one environment, such as lambda step: step.obs[0]"
)


class AtOnce:
    """Reads a function of all environments.

    Its first calls, at a reset and at a step, are compared with calls for each environment alone.
    """

    def __init__(self, signal: ParsedSignal, apart: Apart, *, compare: bool) -> None:
        self._signal = signal
        self._apart = apart
        self._left = {True, False} if compare else set()

    def __call__(self, step: Step, lanes: NDArray[np.bool_]) -> NDArray[Any]:
        """The column of the signal."""
        found = self._signal.numbers(self._signal.call(step), len(lanes))
        at_reset = step.action is None
        if at_reset in self._left:
            self._compare(step, found, lanes.nonzero()[0].tolist())
            self._left.discard(at_reset)
        return found

    def _compare(self, step: Step, found: NDArray[Any], at: Iterable[int]) -> None:
        num = len(found)
        for lane in at:
            try:
                alone = np.asarray(self._signal.call(self._apart.alone(step, lane)), np.float64)
            except (RtamtError, TypeError, ValueError) as error:
                what = str(error).removeprefix(f"signal {self._signal.name!r}: ")
                self._refuse(found, lane, f"for it alone: {what}", error)
            # What reads the vector environment itself still sees all of its environments.
            if alone.shape == (num,) and num > 1:
                alone = alone[lane : lane + 1]
            if alone.shape != (1,):
                self._refuse(found, lane, f"for it alone an array of shape {alone.shape}")
            # Sums of a batch are rounded in another order than those of one.
            if not np.allclose(alone, found[lane], rtol=1e-4, atol=1e-6, equal_nan=True):
                self._refuse(found, lane, f"{alone[0]:.6g} for it alone")

    def _refuse(
        self, found: NDArray[Any], lane: int, what: str, cause: Exception | None = None
    ) -> NoReturn:
        raise InputError(
            f"signal {self._signal.name!r}: {self._signal} gives {found[lane]:.6g} for environment "
            f"{lane} among all {len(found)}, and {what}; a function of batches keeps environments "
            "apart, as lambda step: step.obs[:, 0] does; leave batched out for a function of one "
            "environment"
        ) from cause


class _Hidden:
    """Stands for an environment of a vector environment that cannot be looked into."""

    def __init__(self, env: Any, lane: int, why: str) -> None:  # noqa: ANN401
        self._hidden = env, lane, why

    def __getattr__(self, name: str) -> NoReturn:
        if name.startswith("__"):  # of a protocol that is asked for
            raise AttributeError(name)
        env, lane, why = self._hidden
        raise InputError(
            f"step.env.{name} of environment {lane} cannot be read from {env}: {why}; read "
            "step.obs or step.info, or wrap each environment: "
            "gym.make_vec(..., vectorization_mode='sync', wrappers=[...]) with StlMonitor"
        )


def _apart(infos: Mapping[str, Any], num: int) -> list[dict[str, Any]]:
    """The info of each environment."""
    made: list[dict[str, Any]] = [{} for _ in range(num)]
    for key, value in infos.items():
        if key.startswith("_") or key in {"final_info", "final_obs"}:
            continue
        there = infos.get(f"_{key}")
        each: Any = value
        if isinstance(value, Mapping):
            each = _apart(value, num)
        elif not hasattr(value, "__len__") or len(value) != num:  # one for all
            each = [value] * num
        for lane in range(num):
            if there is None or there[lane]:
                made[lane][key] = each[lane]
    return made
