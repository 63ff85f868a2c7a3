"""Errors of `ParallelStlMonitor` at construction."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import pytest
from parallel_environments import Crew

from rtamt.errors import InputError, InputTypeError, RtamtError, SpecificationError
from rtamt_gym import ParallelStlMonitor

NUMBERS = {"lead": [5.0, 5.0], "wing_0": [1.0, 2.0]}
GAP = {"x": "lead: obs[0]", "y": "wing_0: obs[0]"}
TEXT = "always(x - y > 1)"
HINT = "  hint: write lead: obs[2], lead: action[0], lead: reward or lead: info['key']"


class Named(Crew):
    """A crew whose name is in messages."""

    def __str__(self) -> str:
        return "crew_v0"


class Turns(Named):
    """Agents that take turns, as in the other API of PettingZoo."""

    def agent_iter(self) -> None: ...


class One(gym.Env[Any, Any]):
    """An environment of one agent."""


@pytest.mark.parametrize(
    ("crew", "arguments", "error", "message"),
    [
        (
            Named(NUMBERS),
            {"signals": {"x": "obs[0]", "y": "wing_0: obs[0]"}},
            InputError,
            (
                "signal 'x', column 1: expected one of the agents lead, wing_0, and ':', "
                "got 'obs'\n"
                f"  obs[0]\n  ^\n{HINT}"
            ),
        ),
        (
            Named(NUMBERS),
            {"signals": {"x": "lead: obs[0]"}},
            InputError,
            (
                "variable 'y' has no signal; the signals are 'x'; "
                'pass signals={"y": "lead: obs[INDEX]"}'
                ", or declare a constant: const float y = VALUE"
            ),
        ),
        (
            Named(NUMBERS),
            {"signals": {**GAP, "x": "lead: action[0]"}},
            InputError,
            (
                "signal 'x': lead: action[0] has no value at reset; give a first value, "
                '"x": ("lead: action[0]", VALUE), or "x": ("lead: action[0]", None) if it is '
                "unknown: then no always over it can be satisfied"
            ),
        ),
        (
            Named(NUMBERS),
            {"specs": "always[0:1](x - y > 1)"},
            SpecificationError,
            (
                "specification 'spec' has bounds in time, but crew_v0 does not state the duration "
                "of a step: there is no dt, tau or config['policy_frequency'] in it, or in an "
                "environment inside it; give period= in seconds, or period=1 if every bound counts "
                "steps"
            ),
        ),
        (
            Named({}),
            {},
            InputError,
            "expected possible_agents, which selectors name, in crew_v0, got []",
        ),
        (
            Turns(NUMBERS),
            {},
            InputTypeError,
            (
                "expected a parallel environment of PettingZoo, got crew_v0, in which agents take "
                "turns; convert it with pettingzoo.utils.aec_to_parallel"
            ),
        ),
        (
            One(),
            {},
            InputTypeError,
            (
                "expected a parallel environment of PettingZoo, got <One instance>, which has "
                "one agent; use StlMonitor"
            ),
        ),
        (
            Named(NUMBERS),
            {"twice": True},
            InputError,
            (
                "expected an environment without a monitor, got one with ParallelStlMonitor; give "
                'one monitor all specifications, such as specs={"upright": '
                '"always(abs(angle) < 0.1)", "near": "always(abs(x) < 1)"}'
            ),
        ),
        (
            Named(NUMBERS),
            {"on_violation": "stop"},
            InputError,
            "expected on_violation='terminate' or 'truncate' or 'report', got 'stop'",
        ),
    ],
)
def test_what_cannot_be_monitored_is_refused(
    crew: Any, arguments: dict[str, Any], error: type[RtamtError], message: str
) -> None:
    if arguments.pop("twice", False):
        crew = ParallelStlMonitor(crew, TEXT, GAP)
    with pytest.raises(error) as caught:
        ParallelStlMonitor(crew, **{"specs": TEXT, "signals": GAP, **arguments})
    assert type(caught.value) is error
    assert str(caught.value) == message
