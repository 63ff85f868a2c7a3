"""The managers of Isaac Lab and mjlab, by their documentation, and an environment.

It contains only the parts that terms use. Positions of bodies lag, as in mjlab: `Points.forward`
computes them.
"""

from __future__ import annotations

import copy
import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import torch

__all__ = ["ManagerTermBase", "Points", "StandInEnv", "TermCfg"]


@dataclass
class TermCfg:
    """The configuration of a term.

    Attributes:
        func: A function, or a class that the manager instantiates.
        params: The arguments of each call, next to the environment.
        time_out: Whether a termination term truncates.
    """

    func: Any
    params: dict[str, Any] = field(default_factory=dict)
    time_out: bool = False


class ManagerTermBase:
    """A term with a state."""

    def __init__(self, cfg: TermCfg, env: StandInEnv) -> None:
        self.cfg, self._env = cfg, env


class Manager:
    """A manager of terms, which it copies and instantiates."""

    def __init__(self, terms: Mapping[str, TermCfg], env: StandInEnv) -> None:
        self._env = env
        self._terms = {name: copy.deepcopy(cfg) for name, cfg in terms.items()}
        for cfg in self._terms.values():
            if inspect.isclass(cfg.func):
                if not issubclass(cfg.func, ManagerTermBase):
                    raise TypeError(f"expected a subclass of ManagerTermBase, got {cfg.func}")
                cfg.func = cfg.func(cfg=cfg, env=env)

    @property
    def active_terms(self) -> list[str]:
        return list(self._terms)

    def get_term_cfg(self, name: str) -> TermCfg:
        return self._terms[name]

    def reset(self, env_ids: torch.Tensor | slice | None = None) -> None:
        """Reset the terms with a state; like mjlab, pass a slice for all environments."""
        for cfg in self._terms.values():
            if hasattr(cfg.func, "reset"):
                cfg.func.reset(env_ids=slice(None) if env_ids is None else env_ids)

    def values(self) -> dict[str, torch.Tensor]:
        return {name: cfg.func(self._env, **cfg.params) for name, cfg in self._terms.items()}


class TerminationManager(Manager):
    """A manager of terms that end episodes."""

    def __init__(self, terms: Mapping[str, TermCfg], env: StandInEnv) -> None:
        super().__init__(terms, env)
        self.terminated = self.time_outs = env.none

    def compute(self) -> torch.Tensor:
        self.terminated, self.time_outs = self._env.none, self._env.none
        self.dones = self.values()
        for name, cfg in self._terms.items():
            if cfg.time_out:
                self.time_outs = self.time_outs | self.dones[name]
            else:
                self.terminated = self.terminated | self.dones[name]
        return self.terminated | self.time_outs


class ObservationManager(Manager):
    """A manager of observations, which reads their shapes first."""

    def __init__(self, terms: Mapping[str, TermCfg], env: StandInEnv) -> None:
        super().__init__(terms, env)
        self.shape = self.compute().shape

    def compute(self) -> torch.Tensor:
        observation = torch.cat(list(self.values().values()), dim=-1)
        assert observation.shape == getattr(self, "shape", observation.shape)
        return observation


class Points:
    """Points that actions push. Positions of bodies lag until `forward`.

    Args:
        num_envs: The number of points.
        device: The device of the tensors.
        start: The positions after a reset of the environments ``ids``.
    """

    def __init__(
        self, num_envs: int, device: str, start: Callable[[torch.Tensor], torch.Tensor]
    ) -> None:
        self.start = start
        self.x = torch.zeros(num_envs, device=device)
        self.body_x = self.x

    def step(self, action: torch.Tensor) -> None:
        """Move the points; bodies get the positions before the last of two substeps."""
        self.body_x = self.x + action / 2
        self.x = self.x + action

    def reset(self, ids: torch.Tensor) -> None:
        self.x = self.x.index_copy(0, ids, self.start(ids).to(self.x))

    def forward(self) -> None:
        self.body_x = self.x


class StandInEnv:
    """An environment whose episodes terminate beyond 2, and truncate after a number of steps.

    Its steps have the order of ``ManagerBasedRlEnv.step`` of mjlab: physics, terminations, rewards,
    resets, forward, observations.

    Args:
        num_envs: The number of environments.
        terminations: Terms by name, added to the terms of this environment.
        rewards: Terms by name.
        observations: Terms by name.
        device: The device of the tensors.
        length: The steps of an episode without a termination.
        start: See `Points`; 0.1 by default.
        computes: How often a step computes its observations, after the reset. Recorders of Isaac
            Lab compute them once more before it, and this environment does too.
    """

    step_dt = 0.1

    def __init__(
        self,
        num_envs: int,
        terminations: Mapping[str, TermCfg],
        rewards: Mapping[str, TermCfg] | None = None,
        observations: Mapping[str, TermCfg] | None = None,
        *,
        device: str = "cpu",
        length: int = 6,
        start: Callable[[torch.Tensor], torch.Tensor] = lambda ids: torch.full(ids.shape, 0.1),
        computes: int = 1,
    ) -> None:
        self.num_envs, self.device, self.length, self.computes = num_envs, device, length, computes
        self.extras: dict[str, Any] = {}
        self.none = torch.zeros(num_envs, dtype=torch.bool, device=device)
        self.points = Points(num_envs, device, start)
        self.action = torch.zeros(num_envs, device=device)
        self.steps = torch.zeros(num_envs, device=device)
        own = {"nothing": TermCfg(lambda env: torch.zeros(env.num_envs, 1, device=device))}
        self.observation_manager = ObservationManager({**own, **(observations or {})}, self)
        ends = {
            "time_out": TermCfg(lambda env: env.steps >= env.length, time_out=True),
            "fallen": TermCfg(lambda env: env.points.x.abs() > 2.0),
        }
        self.termination_manager = TerminationManager({**ends, **terminations}, self)
        self.reward_manager = Manager(rewards or {}, self)

    def reset(self, env_ids: torch.Tensor | None = None) -> torch.Tensor:
        """Reset environments, all by default."""
        ids = torch.arange(self.num_envs) if env_ids is None else env_ids
        self._reset(ids.to(self.device))
        self.points.forward()
        return self.observation_manager.compute()

    def step(self, action: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Return the observation, the reward and the ends of episodes."""
        self.action, self.steps = action, self.steps + 1
        self.points.step(action)
        over = self.termination_manager.compute()
        rewards = self.reward_manager.values().values()
        reward = sum(rewards, torch.zeros(self.num_envs, device=self.device))
        self.observation_manager.compute()
        if self.device != "meta" and over.any():
            self._reset(over.nonzero()[:, 0])
        self.points.forward()
        for _ in range(self.computes):
            observation = self.observation_manager.compute()
        return observation, reward, over

    def _reset(self, ids: torch.Tensor) -> None:
        self.points.reset(ids)
        self.steps = self.steps.index_fill(0, ids, 0.0)
        self.observation_manager.reset(ids)
        self.termination_manager.reset(None if len(ids) == self.num_envs else ids)
        self.reward_manager.reset(ids)
