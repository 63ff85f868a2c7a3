"""Requirements for environments of ManiSkill 3, whose steps are tensors of a batch."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any, Unpack

import gymnasium as gym
import torch

from rtamt import InputError
from rtamt_arrays.judging import JudgedStep, RequirementOptions, StepJudge
from rtamt_arrays.monitor_set import ArrayLibrary
from rtamt_arrays.selectors import ArraySignals, ArrayStep
from rtamt_arrays.torch import episode, online
from rtamt_arrays.torch.operations import TorchOperations
from rtamt_gym.judging.specs import SpecsLike
from rtamt_gym.signals.signals import SignalLike

__all__ = ["StlManiSkillWrapper"]


class StlManiSkillWrapper(gym.Wrapper[Any, Any, Any, Any]):
    """Monitor the episodes of an environment of ManiSkill, on its device.

    It belongs between ``gym.make`` and ``ManiSkillVectorEnv``, which restarts environments. Infos
    have the keys of `rtamt_arrays.jax.brax.StlWrapper`, as tensors of shape (num_envs,). At the end
    of an episode they are in ``info["final_info"]``.

    Args:
        env: The environment that ``gymnasium.make`` returned.
        specs: One specification, or several by name, as for `rtamt_gym.StlMonitor`.
        signals: The selector of each variable; see `rtamt_arrays.selectors`. A function gets a step
            of all environments, whose ``state`` is the unwrapped environment, and returns a tensor.
        **options: See `rtamt_arrays.judging.RequirementOptions`. The default of ``period`` is
            the inverse of ``control_freq``.

    Raises:
        SpecificationError: As `rtamt.EpisodeMonitor` does.
        InputError: If an argument is wrong, or ``observe`` is set; at a step, if a selector does
            not fit the environment.
    """

    def __init__(
        self,
        env: gym.Env[Any, Any],
        specs: SpecsLike,
        signals: Mapping[str, SignalLike],
        **options: Unpack[RequirementOptions],
    ) -> None:
        super().__init__(env)
        base: Any = env.unwrapped
        period = RequirementOptions(period=round(1.0 / base.control_freq, 12))
        library = ArrayLibrary(
            partial(episode, device=base.device),
            partial(online, device=base.device),
            TorchOperations(base.device),
        )
        self._judge = StepJudge(specs, library, {**period, **options})
        if self._judge.observes:
            raise InputError("StlManiSkillWrapper has no observe='state'. Remove the option.")
        self._signals = ArraySignals(signals, self._judge.variables, lambda function: function)
        self._state = self._judge.init(base.num_envs)
        self._never = torch.zeros(base.num_envs, dtype=torch.bool, device=base.device)
        self._info: dict[str, Any] | None = None

    def reset(
        self,
        *,
        seed: Any = None,  # noqa: ANN401 - a number or a list of numbers
        options: dict[str, Any] | None = None,
    ) -> tuple[Any, dict[str, Any]]:
        """Start episodes; in the environments of ``options["env_idx"]`` only, if it is set."""
        obs, info = self.env.reset(seed=seed, options=options)
        mask = ~self._never
        if options is not None and "env_idx" in options:
            indices = torch.as_tensor(options["env_idx"], device=mask.device)
            mask = self._never.index_fill(0, indices.to(torch.int64), 1)
        step = ArrayStep(obs, None, None, info, self.unwrapped)
        self._state, judged = self._judge.begin(self._state, self._signals.reset(step), mask)
        return obs, {**info, **self._infos(judged, mask)}

    def step(self, action: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:  # noqa: ANN401 - tensors
        """Step the environments and judge the step."""
        obs, reward, terminated, truncated, info = self.env.step(action)
        step = ArrayStep(obs, action, reward, info, self.unwrapped)
        self._state, judged = self._judge.step(
            self._state, self._signals.step(step), reward, terminated, truncated
        )
        infos = self._infos(judged, ~self._never)
        return obs, judged.reward, judged.terminated, judged.truncated, {**info, **infos}

    def _infos(self, judged: JudgedStep, mask: torch.Tensor) -> dict[str, Any]:
        """Return the keys of infos, with new values in the masked environments only."""
        self._info = judged.info if self._info is None else _select(mask, judged.info, self._info)
        return self._info


def _select(mask: torch.Tensor, new: Any, old: Any) -> Any:  # noqa: ANN401 - tensors by key
    if isinstance(new, dict):
        return {key: _select(mask, value, old[key]) for key, value in new.items()}
    return torch.where(mask, new, old)
