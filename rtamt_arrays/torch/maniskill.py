"""Requirements for environments of ManiSkill 3, whose steps are tensors of many environments."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any, Unpack

import gymnasium as gym
import torch

from rtamt import InputError
from rtamt_arrays.monitor_set import ArrayMonitors
from rtamt_arrays.requirements import JudgedStep, RequirementOptions, StepJudge
from rtamt_arrays.selectors import ArraySignals, ArrayStep
from rtamt_arrays.torch import episode, online
from rtamt_arrays.torch.operations import TorchOperations
from rtamt_gym.judging.specs import SpecsLike
from rtamt_gym.signals.signals import SignalLike

__all__ = ["StlManiSkillWrapper"]


class StlManiSkillWrapper(gym.Wrapper[Any, Any, Any, Any]):
    """Judges the episodes of an environment of ManiSkill, on its device.

    It stands between ``gym.make`` and ``ManiSkillVectorEnv``, which begins the episodes of some
    environments again. Infos have the keys of `rtamt_arrays.jax.brax.StlWrapper`, as tensors of
    shape (num_envs,); those of a step that ends an episode are in ``info["final_info"]`` then.

    Args:
        env: What ``gymnasium.make`` gives.
        specs: One specification, or several by name, as for `rtamt_gym.StlMonitor`.
        signals: What the variables read: see `rtamt_arrays.selectors`. A function gets a step of
            all environments, whose ``state`` is the unwrapped environment, and gives a tensor.
        **options: See `rtamt_arrays.requirements.RequirementOptions`; without ``period`` a step
            takes the inverse of ``control_freq``.

    Raises:
        SpecificationError: As `rtamt.EpisodeMonitor` does.
        InputError: If an argument is wrong, on ``observe``, which is not there; at a step, if a
            selector does not fit what the environment gives.
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
        said = RequirementOptions(period=round(1.0 / base.control_freq, 12))
        said.update(options)
        monitors = ArrayMonitors(
            partial(episode, device=base.device), partial(online, device=base.device)
        )
        self._judge = StepJudge(specs, monitors, TorchOperations(base.device), said)
        if self._judge.observes:
            raise InputError(
                "expected no observe, which this wrapper does not have, got observe='state'"
            )
        self._signals = ArraySignals(signals, self._judge.variables, lambda function: function)
        self._known = self._judge.init(base.num_envs)
        self._never = torch.zeros(base.num_envs, dtype=torch.bool, device=base.device)
        self._info: dict[str, Any] | None = None

    def reset(
        self,
        *,
        seed: Any = None,  # noqa: ANN401 - one or many
        options: dict[str, Any] | None = None,
    ) -> tuple[Any, dict[str, Any]]:
        """Begins episodes, where ``options`` has ``env_idx`` those of these environments alone."""
        obs, info = self.env.reset(seed=seed, options=options)
        mask = ~self._never
        if options is not None and "env_idx" in options:
            which = torch.as_tensor(options["env_idx"], device=mask.device)
            mask = self._never.index_fill(0, which.to(torch.int64), 1)
        step = ArrayStep(obs, None, None, info, self.unwrapped)
        self._known, judged = self._judge.begin(self._known, self._signals.reset(step), mask)
        return obs, {**info, **self._told(judged, mask)}

    def step(self, action: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:  # noqa: ANN401 - tensors
        """Steps the environments and judges the step."""
        obs, reward, terminated, truncated, info = self.env.step(action)
        step = ArrayStep(obs, action, reward, info, self.unwrapped)
        self._known, judged = self._judge.step(
            self._known, self._signals.step(step), reward, terminated, truncated
        )
        told = self._told(judged, ~self._never)
        return obs, judged.reward, judged.terminated, judged.truncated, {**info, **told}

    def _told(self, judged: JudgedStep, mask: torch.Tensor) -> dict[str, Any]:
        """The keys of infos: what is new in the environments of the mask, and was in the others."""
        self._info = judged.info if self._info is None else _chosen(mask, judged.info, self._info)
        return self._info


def _chosen(mask: torch.Tensor, new: Any, old: Any) -> Any:  # noqa: ANN401 - tensors by key
    if isinstance(new, dict):
        return {key: _chosen(mask, value, old[key]) for key, value in new.items()}
    return torch.where(mask, new, old)
