"""Selectors of several agents: ``agent_0: obs[2]`` is what one agent observes."""

from __future__ import annotations

import math
from collections.abc import Hashable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple, cast

from gymnasium import spaces

from rtamt_gym.checks.names import listing
from rtamt_gym.signals.selectors import Selector
from rtamt_gym.signals.signals import AbsentError, ParsedSignal, Read, Source
from rtamt_gym.signals.sources import STEP

__all__ = ["agent_sources"]


_ACTION = 1
"""The place of the actions among the arguments of a `Read`; they are None at reset."""


class _Seat(NamedTuple):
    """The spaces of one agent, to which the selectors behind its name are bound."""

    observation_space: spaces.Space[Any]
    action_space: spaces.Space[Any]


def agent_sources(agents: Mapping[str, Hashable], *, hold: bool) -> dict[str, Source]:
    """The words behind an agent, which read its part of observations, actions, rewards and infos.

    Args:
        agents: The agents by the names that selectors give them.
        hold: Whether a signal is nan while its agent is not there; else that is an error.
    """
    first = next(iter(agents))
    sources = {}
    for place, (word, row) in enumerate(STEP.items()):
        bind = partial(_bind, row, place, agents, hold=hold)
        sources[word] = replace(row, example=f"{first}: {row.example.split(', ')[0]}", bind=bind)
    return sources


def _bind(  # a function of the module, for pickle
    row: Source,
    place: int,
    agents: Mapping[str, Hashable],
    signal: ParsedSignal,
    env: Any,  # noqa: ANN401 - environments of two forms
    *,
    hold: bool,
) -> Read:
    """Binds the selector of a signal to its agent in an environment of PettingZoo's form."""
    agent = agents[cast("Selector", signal.reads).agent]
    seat: Any = _Seat(env.observation_space(agent), env.action_space(agent))
    return _of_agent(agent, place, signal, row.bind(signal, seat), hold=hold)


def _of_agent(agent: Hashable, place: int, signal: ParsedSignal, read: Read, *, hold: bool) -> Read:
    """Reads an agent's part of observations, actions, rewards or infos, by its place among them."""

    def read_part(*parts: Any) -> float:  # noqa: ANN401
        part = parts[place]
        if agent in part:
            own: list[Any] = [None] * len(parts)
            own[place] = part[agent]
            return read(*own)
        if hold and not (signal.maybe_at_reset and parts[_ACTION] is None):
            return math.nan
        raise AbsentError(
            f"signal {signal.name!r}: {signal} has no value, for the agents of this step are "
            f"{listing(part)}; nan='hold' keeps the last value of an agent that left"
        )

    return read_part
