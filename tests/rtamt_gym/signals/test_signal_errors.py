"""A signal that cannot be read: ``errors.txt`` has the calls and the exact texts."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from catalogue import check, entries
from gymnasium import spaces
from mujoco_models import arm
from parallel_environments import Crew

from rtamt_gym.signals.mujoco import bind_signal
from rtamt_gym.signals.selectors import parse_selector
from rtamt_gym.signals.signals import ParsedSignal, SignalLike, parse_signals
from rtamt_gym.signals.sources import MUJOCO, SOURCES, agent_sources

VECTOR = spaces.Box(-1.0, 1.0, (4,))
GRID = spaces.Box(-1.0, 1.0, (2, 3))
AGENTS = {agent: agent for agent in ("scout_0", "scout_1", "'s:2")}


class Simulation(gym.Env[Any, Any]):
    """An environment of which only the spaces matter."""

    def __init__(self, observation: spaces.Space[Any]) -> None:
        self.observation_space = observation
        self.action_space = spaces.Box(-1.0, 1.0, (2,))


def parse(value: SignalLike) -> ParsedSignal:
    return ParsedSignal.parse("x", value, SOURCES)


def bind(value: SignalLike, space: spaces.Space[Any] = VECTOR) -> Any:
    return parse(value).bind(Simulation(space))


def bind_cheetah(value: SignalLike) -> Any:
    return parse(value).bind(gym.make("HalfCheetah-v5"))


def bind_arm(selector: str) -> Any:
    return bind_signal(ParsedSignal.parse("x", selector, MUJOCO), *arm())


def read(selector: str, info: dict[str, Any]) -> float:
    return parse((selector, 0.0)).bind(Simulation(VECTOR))(None, None, 0.0, info)


def parse_mujoco(selector: str) -> Any:
    return parse_selector("signal 'x'", selector, MUJOCO)


def parse_agent(value: SignalLike) -> ParsedSignal:
    return ParsedSignal.parse("x", value, agent_sources(AGENTS, hold=False), AGENTS)


def bind_agent(value: SignalLike) -> Any:
    crew: Any = Crew(dict.fromkeys(AGENTS, (1.0, 2.0)))
    return parse_agent(value).bind(crew)


def parse_agents(signals: dict[str, Any], variables: list[str]) -> Any:
    return parse_signals(signals, variables, agent_sources(AGENTS, hold=False), agents=AGENTS)


NAMES = {
    **{name: getattr(spaces, name) for name in ("Dict", "Discrete", "Sequence", "Tuple")},
    "VECTOR": VECTOR,
    "GRID": GRID,
    "SOURCES": SOURCES,
    "math": math,
    **{call.__name__: call for call in (parse, bind, bind_cheetah, bind_arm, read)},
    **{call.__name__: call for call in (parse_mujoco, parse_agent, bind_agent, parse_agents)},
    "parse_signals": parse_signals,
}


@pytest.mark.parametrize(
    ("call", "said"), entries(Path(__file__).with_name("errors.txt")), ids=lambda text: text[:50]
)
def test_errors_of_signals(call: str, said: str) -> None:
    check(call, said, **NAMES)


def test_unknown_field_error_lists_fields() -> None:
    geom = arm()[1].geom(0)
    fields = [name for name in dir(geom) if isinstance(getattr(geom, name), np.ndarray)]
    expected = (
        "InputError: signal 'x': geom:thumb.xps[2] does not fit: expected a field "
        f"({', '.join(fields)}), got 'xps'; did you mean 'xpos'?"
    )
    check("bind_arm('geom:thumb.xps[2]')", expected, **NAMES)
