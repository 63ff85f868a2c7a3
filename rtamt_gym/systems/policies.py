"""Policies: by name, and as `evaluate_policy` takes them."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from copy import deepcopy
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces

from rtamt import InputError, InputTypeError, RtamtError
from rtamt.errors import Argument, nearest
from rtamt_gym.checks.names import listing
from rtamt_gym.signals.spaces import described
from rtamt_gym.systems.models import Model, check_spaces, load_policy
from rtamt_gym.systems.registry import find_object, line_in
from rtamt_gym.systems.system import Policy, exited

SeededPolicy = Callable[[int], Policy]
"""Makes the policy of an episode from the seed of the episode."""


def policy_of(text: str, env: gym.Env[Any, Any], *, option: str = "--policy") -> SeededPolicy:
    """Make the policy that a text names, for an environment.

    | text | policy |
    |---|---|
    | ``random`` | actions drawn from the space of actions, from the seed of the episode |
    | ``zero`` | the action of the space that is nearest to zero |
    | ``baseline`` | the scenario's own policy |
    | ``sb3:FILE.zip`` | a model that Stable-Baselines3 saved, see `load_policy` |
    | ``module:function`` | a function from observation to action |
    | ``module:Class`` | a class of these functions, constructed for each episode |

    Raises:
        InputError: If the text does not name a policy, it cannot be loaded, or it does not fit the
            environment; from the policy, if it raises or returns something else than an action.
    """
    if text in _UNTRAINED:
        return _UNTRAINED[text](env.action_space, option)
    if text == "baseline":
        baseline = getattr(env.unwrapped, "baseline", None)
        if not callable(baseline):
            raise InputError(f"{option} baseline: expected a scenario, which has one, got {env}")
        return lambda _seed: baseline
    kind, colon, remainder = text.partition(":")
    if not (kind and colon and remainder):
        raise InputError(
            f"{option}: expected random, zero, baseline, sb3:FILE.zip or module:function, got "
            f"{text!r}{_meant(text)}"
        )
    if kind == "sb3":
        return load_policy(remainder, env)
    if kind.endswith(".py"):
        raise InputError(
            f"{option}: expected module:function, got the name of a file; write "
            f"{kind.removesuffix('.py').replace('/', '.')}:{remainder}"
        )
    target = find_object(kind, remainder)
    if isinstance(target, type):
        make = PolicyClass.of(target, f"{option} {text}")
        return lambda seed: _checked(text, make(seed), env.action_space)
    policy = _checked(text, _function(text, target, option), env.action_space)
    return lambda _seed: policy


@dataclass(frozen=True)
class PolicyClass:
    """A class of policies, with a new instance for each episode."""

    kind: type
    seeded: bool

    @classmethod
    def of(cls, kind: type, name: str) -> PolicyClass:
        """Return the class after a check; errors call it ``name``."""
        if not any("__call__" in vars(base) for base in kind.__mro__):
            way_out = ""
            if hasattr(kind, "predict"):
                way_out = ", or save a model and write sb3:FILE.zip"
            raise InputError(
                f"{name}: expected a class with a method __call__(observation), got none; add "
                f"__call__, which returns the action{way_out}"
            )
        try:
            parameters = inspect.signature(kind).parameters
        except ValueError:  # some classes in C have no signature
            return cls(kind, seeded=False)
        needed = [
            parameter.name
            for parameter in parameters.values()
            if parameter.default is parameter.empty
            and parameter.kind not in {parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD}
            and parameter.name != "seed"
        ]
        if needed:
            raise InputError(
                f"{name}: expected a class with a constructor without arguments, or with seed= "
                f"only, got a constructor that needs {listing(needed)}; write a function in the "
                "module that constructs it and returns the action"
            )
        return cls(kind, seeded="seed" in parameters)

    def __call__(self, seed: int) -> Policy:
        """Return the policy of an episode."""
        policy: Policy = self.kind(seed=seed) if self.seeded else self.kind()
        return policy


def _meant(text: str) -> str:
    if text.endswith(".zip"):
        return f"; write sb3:{text}"
    module = text.rstrip(":")
    if module == "sb3" or not module.replace(".", "").isidentifier():
        return ""
    return (
        nearest(text, [*_UNTRAINED, "baseline"])
        or f"; write {module}:FUNCTION for a function of a module"
    )


def _function(text: str, target: Any, option: str) -> Callable[[Any], Any]:  # noqa: ANN401
    if callable(target):
        function: Callable[[Any], Any] = target
        return function
    way_out = ""
    if hasattr(target, "predict"):
        way_out = "; write a function that returns model.predict(obs, deterministic=True)[0]"
    raise InputError(
        f"{option} {text}: expected a function from observation to action, got {target!r}{way_out}"
    )


def _checked(text: str, function: Callable[[Any], Any], space: spaces.Space[Any]) -> Policy:
    """Wrap a policy: its errors and invalid actions raise errors that name it."""

    def act(obs: Any) -> Any:  # noqa: ANN401
        try:
            action = function(obs)
        except RtamtError:
            raise
        except SystemExit as end:
            where = line_in(str(function.__module__), end)
            raise exited(f"the policy {text}", end, where) from end
        except Exception as error:
            where = line_in(str(function.__module__), error)
            raise InputError(
                f"the policy {text} raised {type(error).__name__}: {error}"
                f"{where or '; it is called with the observation'}"
            ) from error
        if not _fits(action, space):
            raise InputError(
                f"the policy {text} gave {action!r}; expected an action of {described(space)}"
            )
        return action

    return act


def _fits(action: Any, space: spaces.Space[Any]) -> bool:  # noqa: ANN401
    """Return whether a value is an action; other precisions and bounds are not checked."""
    if not isinstance(space, spaces.Box):
        return space.contains(action)
    try:
        return np.asarray(action, np.float64).shape == space.shape
    except (TypeError, ValueError):
        return False


def _random(space: spaces.Space[Any], _option: str) -> SeededPolicy:
    def make_policy(seed: int) -> Policy:
        own = deepcopy(space)  # simultaneous episodes must not share a generator
        own.seed(seed)
        return lambda _obs: own.sample()

    return make_policy


def _zero(space: spaces.Space[Any], option: str) -> SeededPolicy:
    match space:
        case spaces.Box():
            action: Any = np.clip(np.zeros(space.shape, space.dtype), space.low, space.high)
        case spaces.Discrete():
            action = int(space.start)
        case spaces.MultiDiscrete() | spaces.MultiBinary():
            action = np.zeros(space.shape, space.dtype)
        case _:
            raise InputError(f"{option} zero: expected a space of numbers, got {space}")
    return lambda _seed: lambda _obs: action


_UNTRAINED: Mapping[str, Callable[[spaces.Space[Any], str], SeededPolicy]] = {
    "random": _random,
    "zero": _zero,
}
"""Functions that make untrained policies for a space of actions, by name."""


@dataclass(frozen=True)
class Evaluated:
    """A policy to evaluate: its name, and a function from a seed to the policy of an episode."""

    name: str
    make: SeededPolicy | None

    @property
    def identity(self) -> str:
        """The identity of the policy: the weights of a model, the name of a function."""
        if isinstance(self.make, Model):
            draws = "" if self.make.deterministic else ", actions drawn"
            return f"{self.name} {self.make.fingerprint}{draws}"
        return self.name


def evaluated(policy: Any, env: gym.Env[Any, Any], *, deterministic: bool) -> Evaluated:  # noqa: ANN401
    """Return the policy that a caller passes for an environment."""
    if isinstance(policy, Evaluated):
        return policy
    if isinstance(policy, str):
        make: SeededPolicy | None = policy_of(policy, env, option="the policy")
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
            "action, a class of these functions, 'random', 'zero', 'baseline' or 'sb3:FILE.zip', "
            f"got {policy!r}"
        )
    return Evaluated(_name(policy), _Same(policy))


def check_name_of_policy(name: object) -> None:
    """Raise InputError unless a name is None or one line of printable text."""
    if name is not None and not (isinstance(name, str) and name.strip() and name.isprintable()):
        raise InputError(
            "expected ", Argument("name"), f" as a text in one line, such as 'before', got {name!r}"
        )


@dataclass(frozen=True)
class _Same:
    """A function that acts in all episodes."""

    function: Callable[..., Any]

    def __call__(self, _seed: int) -> Callable[..., Any]:
        """Return the function."""
        return self.function


def _name(policy: Callable[..., Any]) -> str:
    name = getattr(policy, "__qualname__", None) or type(policy).__qualname__
    return str(name).rpartition("<locals>.")[2]
