"""The value of a signal at reset: read from the info, a number, or unknown."""

from __future__ import annotations

import functools
import json
import math
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AutoresetMode
from vector_environments import MODES, Make, both, difference, sync, trajectory

import rtamt
from rtamt import InputError
from rtamt_gym import StlMonitor, StlReward, VectorStlMonitor, evaluate_policy, relabel, simulate
from rtamt_gym.commands.arguments import read_signals

pytestmark = pytest.mark.filterwarnings("ignore::rtamt_gym.judging.end_warnings.OpenEndWarning")


UNKNOWN: dict[str, Any] = {"u": ("action[0]", None)}
FIXED = np.full(1, 0.5, np.float32)


class Distances(gym.Env[Any, Any]):
    """Has the distance of the goal in its info; at reset only on request."""

    observation_space = spaces.Box(-9, 9, (1,))
    action_space = spaces.Box(-1, 1, (1,))
    control_timestep = 0.5

    def __init__(self, length: int = 4, *, at_reset: bool = False, nan_at: int = -1) -> None:
        self.length, self.at_reset, self.nan_at = length, at_reset, nan_at

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        super().reset(seed=seed, options=options)
        self.at = 0
        return self.shown(), self.info() if self.at_reset else {"other": 1.0}

    def step(self, action: Any) -> Any:  # noqa: ARG002
        self.at += 1
        return self.shown(), 0.0, self.at == self.length, False, self.info()

    def shown(self) -> Any:
        at = math.nan if self.at == self.nan_at else self.at
        return np.full(1, at, np.float32)

    def info(self) -> dict[str, Any]:
        return {"d": float(self.length - self.at)}


REFUSED = (
    "signal 'd': the info has no info['d']; its keys are 'other'; give a first value, "
    '"d": ("info[\'d\']", VALUE), or "d": ("info[\'d\']", None) if it is unknown: then '
    "no always over it can be satisfied"
)


def test_an_info_that_the_reset_has_needs_no_default() -> None:
    env = StlMonitor(Distances(at_reset=True), "eventually(d < 1)", {"d": "info['d']"})
    _, info = env.reset()
    assert info["robustness"] == -3.0
    run = simulate(
        Distances(at_reset=True), "eventually(d < 1)", {"d": "info['d']"}, policy=lambda _: FIXED
    )
    assert run.signals["d"].tolist() == [4.0, 3.0, 2.0, 1.0, 0.0]


def test_a_reset_without_the_key_says_so_and_proposes_no_number() -> None:
    """A distance of 0.0 would satisfy every episode at its first sample."""
    env = StlMonitor(Distances(), "eventually(d < 1)", {"d": "info['d']"})
    with pytest.raises(InputError) as caught:
        env.reset()
    assert str(caught.value) == REFUSED
    with pytest.raises(rtamt.StateError):
        env.step(FIXED)
    with pytest.raises(InputError) as caught:
        simulate(Distances(), "eventually(d < 1)", {"d": "info['d']"}, policy=lambda _: FIXED)
    assert str(caught.value) == REFUSED


@pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.name)
def test_many_environments_are_asked_at_every_reset(mode: AutoresetMode) -> None:
    makes = [functools.partial(Distances, length, at_reset=True) for length in (2, 3)]
    signals: dict[str, Any] = {"d": "info['d']"}
    how: dict[str, Any] = {"on_violation": "report"}
    together, singles = both(
        StlMonitor, VectorStlMonitor, makes, mode, "always(d < 3)", signals, **how
    )
    assert difference(trajectory(together, 12), trajectory(singles, 12)) == ""

    class Later(Distances):
        def reset(self, **options: Any) -> Any:
            obs, info = super().reset(**options)
            self.at_reset = False
            return obs, info

    envs = VectorStlMonitor(
        sync([functools.partial(Later, 1, at_reset=True), makes[1]], mode), "always(d < 3)", signals
    )
    with pytest.raises(InputError) as caught:
        trajectory(envs, 4)
    assert "; give a first value, " in str(caught.value)
    assert "0.0" not in str(caught.value)


@pytest.mark.parametrize("signal", ["action[0]", "reward"])
def test_what_no_reset_has_is_asked_for_without_a_number(signal: str) -> None:
    with pytest.raises(InputError) as caught:
        StlMonitor(Distances(), "always(u < 1)", {"u": signal})
    assert str(caught.value) == (
        f"signal 'u': {signal} has no value at reset; give a first value, "
        f'"u": ("{signal}", VALUE), or "u": ("{signal}", None) if it is unknown: then no '
        "always over it can be satisfied"
    )


@pytest.mark.parametrize("text", ["always(u < 1)", "eventually(u > 0.2)", "always[1:inf](u < 1)"])
def test_none_makes_the_first_sample_unknown(text: str) -> None:
    env = StlMonitor(Distances(), text, UNKNOWN)
    monitor = rtamt.EpisodeMonitor(text, period=0.5, nan="unknown")
    _, info = env.reset()
    monitor.update(math.nan)
    assert (info["stl_lower"], info["stl_upper"]) == monitor.bounds()
    ended = False
    while not ended:
        _, _, ended, _, info = env.step(FIXED)
        monitor.update(0.5)
    monitor.finish("complete")
    told = info["stl_episode"]["spec"]
    assert told["verdict"] == monitor.verdict.name
    assert info["is_success"] == (text != "always(u < 1)")
    run = simulate(Distances(), text, UNKNOWN, policy=lambda _: FIXED, stop="end")
    assert run.outcomes["spec"].verdict.name == told["verdict"]
    assert math.isnan(run.signals["u"][0])
    result = evaluate_policy(
        lambda _: FIXED, Distances, text, UNKNOWN, episodes=2, at_termination="complete"
    )
    assert [row.outcomes["spec"].verdict.name for row in result.record] == [told["verdict"]] * 2
    assert result.evaluation_options is not None
    assert result.evaluation_options["signals"] == {"u": "action[0], unknown at reset"}


@pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.name)
def test_environments_begin_unknown_as_single_environments_do(mode: AutoresetMode) -> None:
    makes = [functools.partial(Distances, length) for length in (2, 3)]
    signals = {**UNKNOWN, "d": ("info['d']", None)}
    text = "always[0:1](u < 1) and eventually(d < 1)"
    how: dict[str, Any] = {"on_violation": "report"}
    together, singles = both(StlMonitor, VectorStlMonitor, makes, mode, text, signals, **how)
    assert difference(trajectory(together, 12), trajectory(singles, 12)) == ""


def test_another_nan_is_refused_as_ever() -> None:
    signals = {**UNKNOWN, "x": "obs[0]"}
    message = (
        "signal 'x': expected a number from obs[0], got nan; pass nan='unknown' if nothing is "
        "known of it then"
    )

    def scalar() -> None:
        env = StlMonitor(Distances(nan_at=1), "always(u + x < 9)", signals)
        env.reset()
        env.step(FIXED)

    def vector() -> None:
        makes: list[Make] = [Distances, functools.partial(Distances, nan_at=1)]
        envs = VectorStlMonitor(sync(makes, AutoresetMode.NEXT_STEP), "always(u + x < 9)", signals)
        envs.reset()
        envs.step(np.stack([FIXED, FIXED]))

    def simulated() -> None:
        simulate(
            Distances(nan_at=1), "always(u + x < 9)", signals, policy=lambda _: FIXED, stop="end"
        )

    for run in (scalar, vector, simulated):
        with pytest.raises(InputError) as caught:
            run()
        assert str(caught.value) == message, run
    env = StlMonitor(Distances(nan_at=1), "always(u + x < 9)", signals, nan="unknown")
    env.reset()
    _, _, _, _, info = env.step(FIXED)
    assert info["stl_lower"] == -math.inf


@pytest.mark.parametrize(
    ("options", "asked"),
    [
        ({"view": "step"}, "view='step' needs the robustness of every instant"),
        ({"cost": "violation"}, "cost='violation' needs the robustness of every instant"),
        ({"nan": "hold"}, "nan='hold' needs a first value to keep"),
    ],
)
def test_what_an_unknown_sample_does_not_allow_is_refused(
    options: dict[str, Any], asked: str
) -> None:
    with pytest.raises(InputError) as caught:
        StlMonitor(Distances(), "always[1:inf](u < 1)", UNKNOWN, **options)
    assert str(caught.value) == (
        f"signal 'u': None at reset leaves its first sample unknown, and {asked}; expected a "
        "number in the place of None"
    )
    assert StlMonitor(Distances(), "always(d < 9)", {"d": "obs[0]"}, **options).reset()


def test_a_reward_refuses_a_first_sample_that_it_reads() -> None:
    with pytest.raises(InputError, match=r"^specification 'spec' reads 'u' at the sample of the"):
        StlReward(Distances(), "always(u < 1)", UNKNOWN, mode="add").reset()
    StlReward(Distances(), "always[1:inf](u < 1)", UNKNOWN, mode="add").reset()


def test_recorded_episodes_may_begin_unknown() -> None:
    episode = {
        "observations": [[0.5], [0.2], [0.1]],
        "actions": [[0.5], [0.5]],
        "rewards": [1.0, 2.0],
        "terminations": [False, False],
        "truncations": [False, True],
    }
    open_, certain = (
        relabel([episode], text, UNKNOWN)[0] for text in ("always(u < 1)", "eventually(u > 0.2)")
    )
    assert open_.outcomes["spec"]["verdict"] == "UNDECIDED"
    assert certain.satisfied


def test_unknown_goes_through_json_and_the_command_line() -> None:
    env = StlMonitor(gym.make("CartPole-v1"), "always(u < 2)", {"u": ("action", None)})
    assert env.spec is not None
    again = gym.make(EnvSpec.from_json(env.spec.to_json()))
    assert again.reset()[1]["stl_lower"] == -math.inf
    assert json.loads(env.spec.to_json())
    assert read_signals(["u=action[0],unknown"]) == UNKNOWN
