"""The managers' interface, as Isaac Lab documents it, and an environment whose steps use it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import torch

__all__ = ["ManagerTermBase", "StandInEnv", "TermCfg"]


@dataclass
class TermCfg:
    """A function or a class of terms, and its parameters."""

    func: Any
    params: dict[str, Any] = field(default_factory=dict)


class ManagerTermBase:
    """A term that has a state."""

    def __init__(self, cfg: TermCfg, env: Any) -> None:  # noqa: ANN401
        self.cfg, self._env = cfg, env


class StandInEnv:
    """Points that actions push; an episode ends beyond 2, and is cut after some steps.

    Its steps have the order of ``ManagerBasedRLEnv.step``: physics, terminations, rewards, resets,
    observations.
    """

    step_dt = 0.1

    def __init__(
        self,
        num_envs: int,
        term: TermCfg,
        reward: Callable[[Any], torch.Tensor],
        observe: Callable[[Any], torch.Tensor],
        device: str = "cpu",
        length: int = 6,
    ) -> None:
        self.num_envs, self.device, self.length = num_envs, device, length
        self.extras: dict[str, Any] = {}
        self.x = torch.zeros(num_envs, device=device)
        self.action = torch.zeros(num_envs, device=device)
        self.steps = torch.zeros(num_envs, device=device)
        self.observe = observe
        observe(self)  # its shape
        self.termination_manager = self
        self.term_cfg, self.term = term, term.func(term, self)
        self.reward = reward
        self.terminated = self.time_outs = torch.zeros(num_envs, dtype=torch.bool, device=device)

    def reset(self) -> torch.Tensor:
        """Resets all."""
        self.term.reset(None)
        return self.observe(self)

    def step(self, action: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Observation, reward and where an episode is over."""
        self.action, self.x, self.steps = action, self.x + action, self.steps + 1
        self.time_outs = self.steps >= self.length
        self.violated = self.term(self, **self.term_cfg.params)
        self.fallen = self.x.abs() > 2.0
        self.terminated = self.fallen | self.violated
        reward = self.reward(self)
        over = self.terminated | self.time_outs
        if self.device != "meta":
            ids = over.nonzero()[:, 0]
            if len(ids):
                self.x = self.x.index_fill(0, ids, 0.1)
                self.steps = self.steps.index_fill(0, ids, 0.0)
                self.term.reset(ids)
        return self.observe(self), reward, over
