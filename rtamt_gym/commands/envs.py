"""`rtamt envs`: prints the selectors that an environment offers."""

from __future__ import annotations

import argparse
import textwrap
from collections.abc import Iterator, Sequence
from contextlib import closing
from typing import TYPE_CHECKING, Any

from rtamt import InputError, InputTypeError
from rtamt_gym.commands.arguments import read_options
from rtamt_gym.options.command_line import Option, add_options, shared, whole
from rtamt_gym.tables import number, shorten, table

if TYPE_CHECKING:
    import gymnasium as gym

    from rtamt_gym.signals.selectors import Selector

_MOST, _SHOWN = 8, 6
"""If more than `_MOST` selectors share their first word, `_SHOWN` of them are shown."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Prints the selectors that signals can read from an environment, with their values at "
        "reset and after a step with a random action, and how long a step lasts. Without an id, "
        "lists the registered environments."
    )
    parser.epilog = "example: rtamt envs Hopper-v5 --env-kwarg frame_skip=2"
    add_options(
        parser,
        shared("ENV_ID", nargs="?"),
        "--env-kwarg",
        Option(
            "--all",
            "show all selectors; otherwise long spaces are shortened, and for MuJoCo only "
            "positions and velocities are shown",
        ),
        Option("--seed S", "seed of the episode", default=0, read=whole),
    )


def run(options: argparse.Namespace) -> int:
    """Print the selectors of an environment, or the ids of all environments; return 0."""
    from rtamt_gym.systems.registry import families, make

    if options.env_id is None and options.env_kwarg:
        raise InputError("expected the ENV_ID of the environment that takes --env-kwarg, got none")
    if options.env_id is None:
        for family, names in families().items():
            print(family, _filled(", ".join(names), "  "), sep="\n")
        return 0
    kwargs = read_options(options.env_kwarg)
    with closing(make(options.env_id, None, kwargs)) as env:
        print(*_described(env), "", *_listed(env, options.seed, everything=options.all), sep="\n")
        print(*_declared(getattr(env.unwrapped, "scenario", None)), sep="\n", end="")
    return 0


def _described(env: gym.Env[Any, Any]) -> Iterator[str]:
    """Yield the length of a step, the time limit and the spaces of an environment."""
    from rtamt_gym.signals.periods import (
        conflicting_times,
        find_period,
        read_period,
        unverified_period,
    )
    from rtamt_gym.signals.sources import described
    from rtamt_gym.wrappers.substeps import read_substep_period

    name = env.spec.id if env.spec else str(env)
    scenario = getattr(env.unwrapped, "scenario", None)
    if scenario is not None:
        yield _filled(scenario.title)
        yield _filled(f"source: {scenario.source}")
        yield ""
    period, sources = read_period(env), find_period(env.unwrapped)
    if period is None or sources is None:
        yield f"{name} does not state the duration of a step;"
        if conflict := conflicting_times(env.unwrapped):
            yield _filled(f"{conflict};")
        yield "for bounds in time give --period in seconds, or --period 1 if bounds count steps"
    else:
        yield _filled(f"{name}: a step lasts {number(period)} s, says env.unwrapped.{sources[1]}")
        if unverified_period(env) is not None:
            yield _filled(
                "nothing verifies that: it may be the time of a physics step, of which an action "
                "takes several; for bounds in time give --period in seconds"
            )
    within = read_substep_period(env)
    if within is not None and within != period:
        yield f"a step of its simulation, which --substeps samples, lasts {number(within)} s"
    if env.spec and env.spec.max_episode_steps:
        yield f"an episode has at most {env.spec.max_episode_steps} steps"
    yield _filled(f"obs: {described(env.observation_space)}")
    yield _filled(f"action: {described(env.action_space)}")


def _declared(scenario: Any) -> Iterator[str]:  # noqa: ANN401 - of rtamt_envs, which is above
    """Yield the declarations of a scenario: names, units, parameters, requirements."""
    if scenario is None:
        return
    rows = [("", "name", "unit", "minimum", "maximum")]
    for phrase, quantities in (("obs", scenario.observations), ("action", scenario.actions)):
        for i, quantity in enumerate(quantities):
            unit = quantity.unit or "-"
            rows.append(
                (f"{phrase}[{i}]", quantity.name, unit, number(quantity.low), number(quantity.high))
            )
    yield from ("", *table(rows, "<<<>>"))
    if scenario.parameters:
        rows = [("parameter", "default", "unit", "minimum", "maximum")]
        rows += [
            (
                quantity.name,
                number(quantity.default),
                quantity.unit or "-",
                number(quantity.low),
                number(quantity.high),
            )
            for quantity in scenario.parameters
        ]
        yield from ("", *table(rows, "<><>>"))
    yield "\nrequirements"
    for name, requirement in scenario.specifications.items():
        yield _filled(f"{name} = {requirement.formula}", "  ")
    yield ""


def _filled(text: str, indent: str = "") -> str:
    """Break a text at blanks into lines of 80 columns, with later lines indented."""
    after = indent or "  "
    return textwrap.fill(
        text, 80, initial_indent=indent, subsequent_indent=after, break_on_hyphens=False
    )


def _listed(env: gym.Env[Any, Any], seed: int, *, everything: bool) -> list[str]:
    """Return a table of the selectors with their values at reset and after a step."""
    from rtamt_gym.signals.sources import offers

    space = env.action_space  # an environment may make a new one at a reset
    space.seed(seed)
    obs, begun = env.reset(seed=seed)
    # Values of the simulation change with it, so the values at reset are read first.
    reset = _Reader(env, obs, None, None, dict(begun))
    first = {str(s): reset(s) for o in offers(env, begun).values() for s in o.common + o.others}
    action = space.sample()
    obs, reward, _, _, info = env.step(action)
    step = _Reader(env, obs, action, reward, info)
    rows = [("selector", "at reset", "after a step")]
    notes: dict[int, str] = {}  # the text below a row
    left_out = 0
    for offer in offers(env, {**begun, **info}).values():
        selectors = offer.common
        if everything:
            selectors = offer.common + offer.others
        elif len(selectors) > _MOST:
            selectors = selectors[:_SHOWN]
        values = ((str(s), first.get(str(s), "-"), step(s)) for s in selectors)
        # Some environments of several agents have a reward that is not a number.
        rows += [row for row in values if row[1:] != ("-", "-")]
        if len(selectors) < len(offer.common):
            notes[len(rows) - 1] = _rest(offer.common[len(selectors) :])
        left_out += len(offer.common) + len(offer.others) - len(selectors)
    lines = []
    for index, line in enumerate(table(rows, "<>>")):
        lines += [line, notes[index]] if index in notes else [line]
    lacking = next((name for name, value, _ in rows if value == "-"), None)
    if lacking is not None:
        lines += ["", f'-: no value at reset; set one with --signal "u={lacking},VALUE"']
    if left_out:
        lines += ["", f"{left_out} more with --all"]
    return lines


def _rest(selectors: Sequence[Selector]) -> str:
    """Return the lines on selectors that are not shown."""
    names = dict.fromkeys(name for selector in selectors for name in selector.names)
    which = f"of {', '.join(names)}" if names else f"to {selectors[-1]}"
    return shorten(f"... {len(selectors)} more, {which}", 80)


class _Reader:
    """Reads selectors from a step of an environment, as signals are read."""

    def __init__(self, env: gym.Env[Any, Any], *step: Any) -> None:  # noqa: ANN401
        self._env = env
        self._step = step

    def __call__(self, selector: Selector) -> str:
        """Return the value of a selector as text; "-" without a value."""
        from rtamt_gym.signals.signals import ParsedSignal
        from rtamt_gym.signals.sources import SOURCES

        _, action, reward, _ = self._step
        row = SOURCES[selector.source]
        if (selector.source == "action" and action is None) or (
            selector.source == "reward" and reward is None
        ):
            return "-"
        signal = ParsedSignal(str(selector), selector, None, row)
        try:
            return number(signal.bind(self._env)(*self._step))
        except (InputError, InputTypeError):  # the info lacks the key, or it is not a number
            return "-"
