"""What `evaluate_policy` takes for a policy: who makes the policy of each episode."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import gymnasium as gym

from rtamt import InputError, InputTypeError
from rtamt.errors import Argument
from rtamt_gym.simulation.models import Model, check_spaces
from rtamt_gym.simulation.policies import PolicyClass, SeededPolicy, policy_of

__all__ = ["Evaluated", "check_name_of_policy", "evaluated"]


@dataclass(frozen=True)
class Evaluated:
    """A policy that is evaluated.

    Attributes:
        name: What it is called.
        make: Makes the policy of an episode from its seed; None: the environment has its own.
    """

    name: str
    make: SeededPolicy | None

    @property
    def identity(self) -> str:
        """What tells it from others, as far as that is known: of a function its name."""
        if isinstance(self.make, Model):
            draws = "" if self.make.deterministic else ", actions drawn"
            return f"{self.name} {self.make.fingerprint}{draws}"
        return self.name


def evaluated(policy: Any, env: gym.Env[Any, Any], *, deterministic: bool) -> Evaluated:  # noqa: ANN401
    """What a caller gives as a policy, for an environment.

    Raises:
        InputError: If a text names no policy, or the policy does not fit the environment.
        InputTypeError: If it is no policy.
    """
    if isinstance(policy, Evaluated):
        return policy
    if isinstance(policy, str):
        make: SeededPolicy | None = policy_of(policy, env, what="the policy")
        if isinstance(make, Model):
            make.deterministic = deterministic
        return Evaluated(policy, None if policy == "baseline" else make)
    if hasattr(policy, "predict") and not isinstance(policy, type):
        check_spaces(policy, env, f"the model of {type(policy).__name__}")
        model = Model(policy, deterministic=deterministic)
        return Evaluated(model.name, model)
    if isinstance(policy, type):
        return Evaluated(_name(policy), PolicyClass.of(policy, f"the policy {_name(policy)}"))
    if not callable(policy):
        raise InputTypeError(
            "expected a policy: a model of Stable-Baselines3, a function from observation to "
            "action, a class of such, 'random', 'zero', 'baseline' or 'sb3:FILE.zip', got "
            f"{policy!r}"
        )
    return Evaluated(_name(policy), _Same(policy))


def check_name_of_policy(name: object) -> None:
    """Refuses what is neither None nor a text that can stand in a table."""
    if name is not None and not (isinstance(name, str) and name.strip() and name.isprintable()):
        raise InputError(
            "expected ", Argument("name"), f" as a text in one line, such as 'before', got {name!r}"
        )


@dataclass(frozen=True)
class _Same:
    """A function that acts in all episodes."""

    function: Callable[..., Any]

    def __call__(self, _seed: int) -> Callable[..., Any]:
        """The function."""
        return self.function


def _name(policy: Callable[..., Any]) -> str:
    name = getattr(policy, "__qualname__", None) or type(policy).__qualname__
    return str(name).rpartition("<locals>.")[2]
