"""Value iteration on a small finite problem: the policies that shaping changes."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass, field
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from replay import shaping_options

from rtamt_gym import StlReward
from rtamt_gym.shaping import Mode

GAMMA = 0.9

SPECS = {"away": "always(x < 4.5)", "home": "eventually(x < 0.5)"}


class Ledge(gym.Env[Any, Any]):
    """A walk on 0 to 6: home at 0 pays 1, the treasure at 6, beyond the limit, pays 5."""

    observation_space = spaces.Box(0.0, 6.0, (1,), np.float64)
    action_space = spaces.Discrete(3)  # left, stay, right

    def __init__(self) -> None:
        self.at = 3

    def reset(
        self,
        *,
        seed: int | None = None,
        options: dict[str, Any] | None = None,  # noqa: ARG002
    ) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        self.at = 3
        return np.array([self.at], np.float64), {}

    def step(self, action: int) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        self.at += action - 1
        reward = {0: 1.0, 6: 5.0}.get(self.at, -0.1)
        return np.array([self.at], np.float64), reward, self.at in {0, 6}, False, {}


def ledge(mode: Mode, **arguments: Any) -> StlReward[Any, Any]:
    return StlReward(
        Ledge(),
        SPECS,
        {"x": "obs[0]"},
        **shaping_options(mode, *SPECS),
        gamma=GAMMA,
        clip=3.0,
        observe="state",
        **{"on_violation": "report", "weight": 4.0, **arguments},
    )


State = tuple[float, ...]


@dataclass
class Graph:
    """All reachable states, as the learner sees them, and the effect of every action.

    Attributes:
        start: The state of reset.
        moves: By state and action: next state, None at the end; own reward; shaped reward.
        potential: The robustness in the reward.
    """

    start: State
    moves: dict[State, list[tuple[State | None, float, float]]] = field(default_factory=dict)
    potential: dict[State, float] = field(default_factory=dict)


def explore(env: StlReward[Any, Any]) -> Graph:
    obs, info = env.reset()
    graph = Graph(tuple(obs))
    result = [(graph.start, info["robustness"], env)]
    while result:
        state, robustness, env = result.pop()
        moves: list[tuple[State | None, float, float]] = []
        ahead = []
        for action in range(3):
            copy = deepcopy(env)
            obs, reward, terminated, _, info = copy.step(action)
            after = None if terminated else tuple(obs)
            moves.append((after, info["reward"], float(reward)))
            if after is not None:
                ahead.append((after, info["robustness"], copy))
        if state in graph.moves:
            # Another path to the same observation, which a learner cannot distinguish.
            assert graph.moves[state] == moves
            assert graph.potential[state] == np.clip(robustness, -3.0, 3.0)
            continue
        graph.moves[state] = moves
        graph.potential[state] = float(np.clip(robustness, -3.0, 3.0))
        result += ahead
    return graph


def action_values(graph: Graph, *, shaped: bool) -> dict[State, list[float]]:
    """Return the value of every action in every state, by value iteration."""
    value = dict.fromkeys(graph.moves, 0.0)
    while True:
        actions = {
            state: [
                (reward if shaped else own) + (0.0 if after is None else GAMMA * value[after])
                for after, own, reward in moves
            ]
            for state, moves in graph.moves.items()
        }
        change = max(abs(max(actions[state]) - value[state]) for state in value)
        if change < 1e-12:
            return actions
        value = {state: max(actions[state]) for state in value}


def optimal(actions: dict[State, list[float]]) -> dict[State, set[int]]:
    return {
        state: {action for action, value in enumerate(values) if value > max(values) - 1e-9}
        for state, values in actions.items()
    }


@pytest.mark.parametrize("arguments", [{}, {"on_violation": "terminate"}, {"temperature": 0.5}])
def test_a_potential_leaves_the_optimal_policy_as_it_is(arguments: dict[str, Any]) -> None:
    graph = explore(ledge("potential", **arguments))
    assert len(graph.moves) > 10
    own, shaped = (action_values(graph, shaped=shaped) for shaped in (False, True))
    assert optimal(own) == optimal(shaped)
    if "temperature" not in arguments:
        for state, values in own.items():
            lifted = [value + 4.0 * graph.potential[state] for value in shaped[state]]
            assert lifted == pytest.approx(values, abs=1e-9)


@pytest.mark.slow(keep=2)
@pytest.mark.parametrize("mode", ["add", "replace", "terminal", "hierarchical"])
def test_every_other_mode_changes_it(mode: Mode) -> None:
    graph = explore(ledge(mode))
    assert optimal(action_values(graph, shaped=False)) != optimal(action_values(graph, shaped=True))


def walk(env: StlReward[Any, Any], actions: list[int]) -> tuple[float, float, bool]:
    """Return discounted returns, shaped and own, and whether all specifications were satisfied."""
    env.reset()
    shaped = own = 0.0
    info: dict[str, Any] = {}
    for step, action in enumerate(actions):
        _, reward, _, _, info = env.step(action)
        shaped += GAMMA**step * float(reward)
        own += GAMMA**step * info["reward"]
    return shaped, own, info["is_success"]


@pytest.mark.parametrize("mode", ["add", "replace", "terminal", "hierarchical"])
@pytest.mark.parametrize("temperature", [None, 0.1])
def test_every_other_mode_ranks_a_satisfying_trajectory_above_a_violating_one(
    mode: Mode, temperature: float | None
) -> None:
    env = ledge(mode, temperature=temperature)
    good, good_own, satisfied = walk(env, [0, 0, 0])
    bad, bad_own, violated = walk(env, [2, 2, 2])
    assert (satisfied, violated) == (True, False)
    assert good_own < bad_own
    assert good > bad


def test_terminal_pay_turns_the_optimal_policy_home() -> None:
    graph = explore(ledge("terminal"))
    for shaped, end in ((False, 6.0), (True, 0.0)):
        policy = optimal(action_values(graph, shaped=shaped))
        env = ledge("terminal")
        obs, _ = env.reset()
        ended = False
        while not ended:
            obs, _, ended, _, _ = env.step(min(policy[tuple(obs)]))
        assert obs[0] == end
