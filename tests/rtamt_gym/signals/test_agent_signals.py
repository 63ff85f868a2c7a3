"""Signals of several agents: each selector reads its agent's part, or its error is complete."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from parallel_environments import Crew

from rtamt.errors import InputError
from rtamt_gym import Step
from rtamt_gym.signals.signals import ParsedSignal, Read, SignalLike
from rtamt_gym.signals.sources import agent_sources

AGENTS = ["scout_0", "scout_1", "'s:2"]
CREW = Crew(dict.fromkeys(AGENTS, (1.0, 2.0)))
NAMES = {agent: agent for agent in AGENTS}


def parse(value: SignalLike, *, hold: bool = False) -> ParsedSignal:
    return ParsedSignal.parse("x", value, agent_sources(NAMES, hold=hold), NAMES)


def bind(value: SignalLike, *, hold: bool = False) -> Read:
    return parse(value, hold=hold).bind(CREW)  # type: ignore[arg-type]  # of PettingZoo's form


def step_of(agents: list[str]) -> tuple[Any, ...]:
    """Return observations, actions, rewards and infos with different numbers."""
    number = {agent: 10.0 * at for at, agent in enumerate(AGENTS)}
    return (
        {agent: np.array([number[agent], number[agent] + 1]) for agent in agents},
        {agent: np.array([number[agent] + 2]) for agent in agents},
        {agent: number[agent] + 3 for agent in agents},
        {agent: {"own": number[agent] + 4} for agent in agents},
    )


READINGS: list[tuple[SignalLike, float]] = [
    ("obs[0]", 0),
    ("obs[-1]", 1),
    (("action[0]", 0.0), 2),
    (("reward", 0.0), 3),
    (("info['own']", 0.0), 4),
]


@pytest.mark.parametrize("at", range(len(AGENTS)))
@pytest.mark.parametrize(("reading", "number"), READINGS)
def test_selector_reads_its_agent(reading: Any, number: float, at: int) -> None:
    written = ["scout_0: ", " scout_1 :", '"\'s:2": '][at]
    value = (written + reading[0], 5.0) if isinstance(reading, tuple) else written + reading
    signal = parse(value)
    again = parse((str(signal), 5.0) if isinstance(reading, tuple) else str(signal))
    assert (again.reads, again.default) == (signal.reads, signal.default)
    for each in (signal, again):
        assert each.bind(CREW)(*step_of(AGENTS)) == 10 * at + number  # type: ignore[arg-type]  # see above


def test_agents_need_not_be_texts() -> None:
    crew = Crew({7: (1.0, 2.0), 8: (3.0, 4.0)})  # type: ignore[dict-item]  # as said
    names = {str(agent): agent for agent in crew.possible_agents}
    signal = ParsedSignal.parse("x", "8: obs[0]", agent_sources(names, hold=False), names)
    assert signal.bind(crew)(*crew.reset()[:1], None, None, {}) == 3.0  # type: ignore[arg-type]  # see above


@given(st.lists(st.sampled_from(AGENTS), min_size=1, unique=True))
def test_callable_gets_all_agents(agents: list[str]) -> None:
    def highest(step: Step) -> float:
        assert step.env is CREW
        return max(float(seen[1]) for seen in step.obs.values()) + len(step.info)

    expected = 10 * max(AGENTS.index(agent) for agent in agents) + 1 + len(agents)
    assert bind(highest)(*step_of(agents)) == expected


@pytest.mark.parametrize(("reading", "number"), READINGS)
def test_absent_agent(reading: Any, number: float) -> None:
    pair = isinstance(reading, tuple)
    text = f"scout_1: {reading[0] if pair else reading}"
    value = (text, 0.0) if pair else text
    held = bind(value, hold=True)
    assert math.isnan(held(*step_of(["scout_0"])))
    assert held(*step_of(["scout_1"])) == 10 + number
    with pytest.raises(InputError) as caught:
        bind(value)(*step_of(["scout_0"]))
    assert str(caught.value) == (
        f"signal 'x': {text} has no value, for the agents of this step are 'scout_0'; nan='hold' "
        "keeps the last value of an agent that left"
    )


@pytest.mark.parametrize("hold", [False, True])
def test_agent_info_at_reset(hold: bool) -> None:  # noqa: FBT001
    read = parse(("scout_1: info['own']", 5.0), hold=hold).bind_reset(CREW)  # type: ignore[arg-type]  # see above
    seen, *_, infos = step_of(AGENTS)
    assert read(seen, None, None, infos) == 14.0
    assert read(seen, None, None, {"scout_1": {}}) == 5.0
    assert read(seen, None, None, {}) == 5.0
