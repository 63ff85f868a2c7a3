"""What a search runs, as an argument: an environment, a function, an FMU; and how it acts."""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import rtamt
from rtamt import InputError
from rtamt_gym.commands.arguments import read_options

if TYPE_CHECKING:
    from rtamt_gym.inputs.ranges import Parameter, Signal


@dataclass(frozen=True)
class SearchedSystem:
    """A system, and what it says of itself.

    Attributes:
        system: The system, as `rtamt_gym.simulate` takes it.
        path: Its name ``module:function``; None if it is no object of a module.
        scenario: Its scenario; None where there is none.
        requirements: Its own requirements, by name.
        policy: How to act where no input does; None for its own way.
    """

    system: Any
    path: str | None
    scenario: Any
    requirements: Mapping[str, rtamt.Specification]
    policy: Any

    @property
    def inputs(self) -> Sequence[Signal | Parameter]:
        """What is varied if nothing else is said."""
        return getattr(self.scenario, "inputs", ())


@contextmanager
def opened_system(options: argparse.Namespace) -> Iterator[SearchedSystem]:
    """Makes the system that the command line names, and closes it at the end.

    Raises:
        InputError: If there is no such system, or an option does not fit it.
    """
    from rtamt_gym.judging.specs import own_requirements
    from rtamt_gym.systems.policies import policy_of
    from rtamt_gym.systems.references import named_system

    if options.policy == "random":
        raise InputError(
            "--policy random: expected a policy that acts alike each time; vary what acts with "
            "--vary NAME=LOW:HIGH,points=N"
        )
    name = _named(options.env_id, read_options(options.env_kwarg))
    system = named_system(name, Path())
    with closing(system) if hasattr(system, "close") else nullcontext():
        path, policy = name.get("object"), None
        if "environment" not in name:
            if options.policy:
                raise InputError(f"--policy is for environments, got it for {options.env_id}")
            yield SearchedSystem(system, path, None, {}, None)
            return
        if options.policy:
            policy = policy_of(options.policy, system)(options.seed)
        scenario = getattr(system.unwrapped, "scenario", None)
        yield SearchedSystem(system, path, scenario, own_requirements(system), policy)


def _named(text: str, arguments: dict[str, Any]) -> dict[str, Any]:
    """The name of the system that an argument gives, as `named_system` takes it."""
    if text.endswith(".py"):
        raise InputError(
            f"expected a system as module:function, got the name of a file; write "
            f"{text.removesuffix('.py').replace('/', '.')}:FUNCTION"
        )
    if text.lower().endswith(".fmu"):
        name: dict[str, Any] = {"fmus": {Path(text).stem: text}}
    elif re.fullmatch(r"[\w.]+:[\w.]+", text):
        name = {"object": text}
    else:
        return {"environment": text} | ({"arguments": arguments} if arguments else {})
    if arguments:
        raise InputError(f"--env-kwarg is for environments, got it for {text}; --set is for all")
    return name
