"""Arguments of searches: the system, ``--vary`` and ``--set``."""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import rtamt
from rtamt import InputError
from rtamt.errors import nearest
from rtamt_gym.checks.names import listing
from rtamt_gym.checks.numbers import read_floats
from rtamt_gym.commands.arguments import read_options

if TYPE_CHECKING:
    from rtamt_gym.inputs.space import Parameter, Signal


@dataclass(frozen=True)
class SearchedSystem:
    """A system with its own declarations.

    Attributes:
        system: The system, as `rtamt_gym.simulate` takes it.
        path: Its name ``module:function``; None if it is not an object of a module.
        scenario: Its scenario; None without one.
        requirements: Its own requirements, by name.
        policy: The policy for actions that no input sets; None for the default of the system.
    """

    system: Any
    path: str | None
    scenario: Any
    requirements: Mapping[str, rtamt.Specification]
    policy: Any

    @property
    def inputs(self) -> Sequence[Signal | Parameter]:
        """The inputs that a search varies by default."""
        return getattr(self.scenario, "inputs", ())


@contextmanager
def opened_system(options: argparse.Namespace) -> Iterator[SearchedSystem]:
    """Make the system that the command line names, and close it at the end."""
    from rtamt_gym.judging.specs import own_requirements
    from rtamt_gym.systems.policies import policy_of
    from rtamt_gym.systems.registry import named_system

    if options.policy == "random":
        raise InputError(
            "--policy random: expected a policy that repeats its actions; vary the actions with "
            "--vary NAME=LOW:HIGH,points=N"
        )
    name = _named(options.env_id, read_options(options.env_kwarg))
    system = named_system(name, Path())
    with closing(system) if hasattr(system, "close") else nullcontext():
        path, policy = name.get("object"), None
        if "environment" not in name:
            if options.policy:
                raise InputError(f"--policy needs an environment, got {options.env_id}")
            yield SearchedSystem(system, path, None, {}, None)
            return
        if options.policy:
            policy = policy_of(options.policy, system)(options.seed)
        scenario = getattr(system.unwrapped, "scenario", None)
        yield SearchedSystem(system, path, scenario, own_requirements(system), policy)


def _named(text: str, arguments: dict[str, Any]) -> dict[str, Any]:
    """Return the system of an argument in the form that `named_system` takes."""
    from rtamt_gym.systems.registry import module_of

    path, _, function = text.partition(":")
    if path.endswith(".py"):
        raise InputError(
            "expected a system as module:function, got the name of a file; write "
            f"{module_of(path)}:{function or 'FUNCTION'}"
        )
    if text.lower().endswith(".fmu"):
        name: dict[str, Any] = {"fmus": {Path(text).stem: text}}
    elif re.fullmatch(r"[\w.]+:[\w.]+", text):
        name = {"object": text}
    else:
        return {"environment": text} | ({"arguments": arguments} if arguments else {})
    if arguments:
        raise InputError(
            f"--env-kwarg: expected an environment, got {text}; use --set for other systems"
        )
    return name


_EXAMPLE = "mass=1:2, gear=1|2|3 or throttle=0:100,points=7"


def read_varied(
    vary: Sequence[str],
    fixed: Sequence[str],
    scenario: Any,  # noqa: ANN401 - None where there is none
) -> tuple[list[Signal | Parameter] | None, dict[str, float]]:
    """Read ``--vary`` and ``--set``: the entries of a space, or None for the default; numbers."""
    numbers: dict[str, float] = {}
    for argument in fixed:
        name, _, text = (part.strip() for part in argument.partition("="))
        value = read_floats([text]) if name and text else None
        if value is None:
            raise InputError(f"--set: expected NAME=NUMBER, such as mass=1.5, got {argument!r}")
        if name in numbers:
            raise InputError(f"--set: expected one {name!r}, got two")
        (numbers[name],) = value
    known = {} if scenario is None else _known(scenario)
    return [_entry(argument, known) for argument in vary] or None, numbers


def _known(scenario: Any) -> Mapping[str, Signal | Parameter]:  # noqa: ANN401
    entries: Iterable[Signal | Parameter] = [*scenario.parameters, *scenario.inputs]
    return {entry.name: entry for entry in entries}


def _entry(argument: str, known: Mapping[str, Signal | Parameter]) -> Signal | Parameter:
    from rtamt_gym.inputs.space import Parameter, Signal

    name, equals, text = (part.strip() for part in argument.partition("="))
    if not equals:
        if name not in known:
            has = f"the scenario has {listing(known)}" if known else "the system declares no ranges"
            raise InputError(f"--vary {name}: expected {_EXAMPLE}; {has}{nearest(name, known)}")
        return known[name]
    span, *options = (part.strip() for part in text.split(","))
    words = {option.partition("=")[0]: option.partition("=")[2] for option in options}
    _check_words(argument, words)
    if not name:
        raise _refused(argument)
    if "|" in span or ":" not in span:
        values = read_floats(span.split("|"))
        if values is None or words:
            raise _refused(argument)
        return Parameter(name, values=values)
    ends = read_floats(span.split(":"))
    if ends is None or len(ends) != 2:
        raise _refused(argument)
    if "points" not in words:
        if words not in ({}, {"log": ""}):
            raise _refused(argument)
        return Parameter(name, *ends, log="log" in words)
    points = words.pop("points")
    rest: Any = [*words] or ["hold"]
    if not points.isdecimal() or any(words.values()) or len(rest) != 1:
        raise _refused(argument)
    return Signal(name, *ends, points=int(points), interpolation=rest[0])


def _check_words(argument: str, words: Iterable[str]) -> None:
    """Raise InputError for a misspelt word after a range."""
    for word in words:
        if word not in _WORDS and (meant := nearest(word, _WORDS)):
            raise InputError(f"--vary {argument}: unknown option {word!r}{meant}")


_WORDS = ("points", "hold", "linear", "pchip", "log")


def _refused(argument: str) -> InputError:
    return InputError(f"--vary: expected {_EXAMPLE}, got {argument!r}")
