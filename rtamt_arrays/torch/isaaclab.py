"""Requirements for environments of Isaac Lab: terms of a ``ManagerBasedRLEnv``.

`Violated` is a termination term and judges the episodes; `shaped_reward` is a reward term and
`monitor_state` an observation term, which read what it found. They are written against the
documented interface of Isaac Lab, and tested on a stand-in with that interface: Isaac Lab itself
runs in its simulator alone, and was not run.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any
from weakref import WeakKeyDictionary

import torch
from isaaclab.managers import ManagerTermBase

from rtamt import InputError
from rtamt_arrays.monitors import ArrayMonitors
from rtamt_arrays.panel import Taken
from rtamt_arrays.requirements import (
    JudgedStep,
    RequirementOptions,
    RequirementState,
    StepJudge,
)
from rtamt_arrays.torch import episode, online
from rtamt_arrays.torch.operations import TorchOperations
from rtamt_gym.judging.specs import SpecsLike

__all__ = ["Violated", "monitor_state", "shaped_reward"]

EnvSignal = Callable[[Any], torch.Tensor] | tuple[Callable[[Any], torch.Tensor], float]
"""A function of the environment with a number of each, and where wanted its value at a reset."""


class Violated(ManagerTermBase):
    """A termination term: where a requirement is certainly violated.

    Signals are functions ``(env) -> tensor[num_envs]``, as terms are; ``(function, 0.0)`` gives a
    value for the sample of the reset, which is read when the managers are reset. What the simulator
    derives, such as poses of bodies, may still be that from before the reset there.

    After each step ``env.extras["stl"]`` has the keys of `rtamt_arrays.jax.brax.StlWrapper`, as
    tensors of shape (num_envs,), if there is a `shaped_reward` beside. No step asks a tensor for a
    number.

    In a configuration::

        class TerminationsCfg:
            violated = TerminationTermCfg(
                func=Violated,
                params={
                    "specs": "always(tilt < 0.5)",
                    "signals": {"tilt": tilt},
                    "options": {"mode": "potential", "gamma": 0.99},
                },
            )

    Args:
        cfg: The configuration of the term. Its ``params`` are ``specs`` and ``signals``, and where
            wanted ``options``: see `rtamt_arrays.requirements.RequirementOptions`. Without
            ``period`` a step takes ``env.step_dt``.
        env: The environment.

    Raises:
        SpecificationError: As `rtamt.EpisodeMonitor` does.
        InputError: If a parameter is wrong, or a variable has no signal.
    """

    def __init__(self, cfg: Any, env: Any) -> None:  # noqa: ANN401 - of Isaac Lab
        super().__init__(cfg, env)
        params = cfg.params
        options = RequirementOptions(period=env.step_dt)
        options.update(params.get("options", {}))
        self.requirements = StepJudge(
            params["specs"],
            ArrayMonitors(partial(episode, device=env.device), partial(online, device=env.device)),
            TorchOperations(torch.device(env.device)),
            options,
        )
        self._signals: Mapping[str, EnvSignal] = params["signals"]
        for name in self.requirements.variables:
            if name not in self._signals:
                listed = ", ".join(self._signals) or "none"
                raise InputError(f"variable {name!r} has no signal; the signals are {listed}")
        self._state = self.requirements.init(env.num_envs)
        self._never = torch.zeros(env.num_envs, dtype=torch.bool, device=env.device)
        self._nothing = torch.zeros(env.num_envs, device=env.device)
        self._last: tuple[RequirementState, Taken] | None = None  # of before the step, and of it
        self.features = self._nothing[:, None].expand(-1, self.requirements.features.box.shape[0])
        _TERMS[env] = self

    def reset(self, env_ids: Sequence[int] | torch.Tensor | None = None) -> None:
        """Begins the episodes of these environments; None: of all."""
        if env_ids is None:
            mask = ~self._never
        else:
            ids = torch.as_tensor(env_ids, dtype=torch.int64, device=self._never.device)
            mask = self._never.index_fill(0, ids, 1)
        sample = {}
        for name in self.requirements.variables:
            signal = self._signals[name]
            sample[name] = signal[1] if isinstance(signal, tuple) else signal(self._env)
        self._state, judged = self.requirements.begin(self._state, sample, mask)
        self.features = torch.where(mask[:, None], judged.features, self.features)

    def __call__(
        self,
        env: Any,  # noqa: ANN401 - of Isaac Lab
        specs: SpecsLike,  # noqa: ARG002 - the parameters, which Isaac Lab hands over every time
        signals: Mapping[str, EnvSignal],  # noqa: ARG002
        options: RequirementOptions | None = None,  # noqa: ARG002
    ) -> torch.Tensor:
        """Takes the sample of the step, and says where a requirement is certainly violated."""
        sample = {}
        for name in self.requirements.variables:
            signal = self._signals[name]
            sample[name] = signal[0](env) if isinstance(signal, tuple) else signal(env)
        taken = self.requirements.take(self._state, sample)
        self._last = self._state, taken
        self._conclude(self._state, taken, self._never, self._never)
        violated: torch.Tensor = self.requirements.violated(taken)
        return violated

    def concluded(self, terminated: torch.Tensor, truncated: torch.Tensor) -> torch.Tensor:
        """What the step pays, once it is known which episodes it ends."""
        if self._last is None:  # the reward manager asks for a shape before the first step
            return self._nothing
        own = ~self.requirements.violated(self._last[1])
        judged = self._conclude(*self._last, terminated & own, truncated)
        self._env.extras["stl"] = judged.info
        reward: torch.Tensor = judged.reward
        return reward

    def _conclude(
        self,
        before: RequirementState,
        taken: Taken,
        terminated: torch.Tensor,
        truncated: torch.Tensor,
    ) -> JudgedStep:
        self._state, judged = self.requirements.conclude(
            before, taken, self._nothing, terminated, truncated
        )
        self.features = judged.features
        return judged


_TERMS: WeakKeyDictionary[Any, Violated] = WeakKeyDictionary()


def _term_of(env: Any) -> Violated:  # noqa: ANN401 - of Isaac Lab
    if env not in _TERMS:
        raise InputError(
            "expected a termination term with func=Violated, which judges the episodes, got none; "
            "its params say the specifications and their signals"
        )
    return _TERMS[env]


def shaped_reward(env: Any) -> torch.Tensor:  # noqa: ANN401 - of Isaac Lab
    """A reward term: what the mode of `Violated` adds to the other rewards.

    The reward manager multiplies it by its weight and by the time of a step.

    Args:
        env: The environment, which has `Violated` among its terminations.

    Returns:
        A tensor of shape (num_envs,).

    Raises:
        InputError: If the environment has no `Violated`.
    """
    ends = env.termination_manager
    return _term_of(env).concluded(ends.terminated, ends.time_outs)


def monitor_state(env: Any, features: int = 5) -> torch.Tensor:  # noqa: ANN401 - of Isaac Lab
    """An observation term: the state of the monitors, as ``observe="state"`` of `rtamt_gym`.

    Args:
        env: The environment, which has `Violated` among its terminations.
        features: How many numbers there are: five for each specification. Observation managers ask
            for the shape before there are terminations, and get zeros.

    Returns:
        A tensor of shape (num_envs, features).
    """
    if env not in _TERMS:
        return torch.zeros(env.num_envs, features, device=env.device)
    return _TERMS[env].features
