"""`Episodes`: runs episodes of a policy in an environment, one by one or side by side."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from typing import Any, Self

import gymnasium as gym

import rtamt
from rtamt import InputTypeError
from rtamt_gym.evaluation.policies import Evaluated, evaluated
from rtamt_gym.judges.specs import read_period
from rtamt_gym.search.runs.requirements import Requirements
from rtamt_gym.search.runs.runner import Runner
from rtamt_gym.simulation.environments import make

__all__ = ["Episodes"]


class Episodes(Runner):
    """Runs episodes of a policy in an environment.

    Attributes:
        evaluated: The policy.

    Args:
        env: The environment.
        requirements: The requirements.
        evaluated: The policy.
        **options: As for `Runner`.
    """

    def __init__(
        self,
        env: gym.Env[Any, Any],
        requirements: Requirements | None = None,
        *,
        evaluated: Evaluated,
        **options: Any,  # noqa: ANN401 - those of `Runner`
    ) -> None:
        self.evaluated = evaluated
        options["policies"] = evaluated.make
        super().__init__(env, requirements, **options)

    @classmethod
    def of(
        cls,
        policy: Any,  # noqa: ANN401
        env: Any,  # noqa: ANN401
        requirements: Requirements | None,
        *,
        deterministic: bool,
        n_envs: int,
        **options: Any,  # noqa: ANN401
    ) -> Self:
        """Makes the environment, if it is an id or a function, and finds the policy for it."""
        if isinstance(env, str):
            env = make(env)
        elif callable(env) and not isinstance(env, gym.Env):
            env = env()
        if not isinstance(env, gym.Env):
            raise InputTypeError(f"expected an environment, got {env!r}")
        chosen = evaluated(policy, env, deterministic=deterministic)
        return cls(env, requirements, evaluated=chosen, batch=n_envs, **options)

    @property
    def arguments(self) -> Mapping[str, Any]:
        """As `Runner.arguments`."""
        own = {name: value for name, value in super().arguments.items() if name != "policies"}
        return {**own, "evaluated": self.evaluated}

    @property
    def period(self) -> Fraction | None:
        """Seconds between samples."""
        period = self.options["period"]
        given = read_period(self.system) if period is None else period
        return rtamt.Monitor("true", period=given).period
