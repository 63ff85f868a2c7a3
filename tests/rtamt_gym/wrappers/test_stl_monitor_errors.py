"""What `StlMonitor` cannot monitor is refused when it is built, and says the way out."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.wrappers import MaxAndSkipObservation, TransformReward

import rtamt
from rtamt.errors import InputError, InputTypeError, RtamtError, SpecificationError
from rtamt_gym import StlMonitor

X = {"x": "obs[0]"}


class Timeless(gym.Env[Any, Any]):
    """Does not say its period."""

    observation_space = spaces.Box(-1.0, 1.0, (1,), np.float64)
    action_space = spaces.Discrete(2)

    def __str__(self) -> str:
        return "<Timeless>"


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        (
            {"specs": "always(x >)"},
            rtamt.ParseError,
            None,
        ),
        (
            {"specs": "x > 1"},
            SpecificationError,
            (
                "specification 'spec' speaks of the first sample only; "
                "write always(x > 1) or view='step'"
            ),
        ),
        (
            {"specs": {"p": "historically[0:2](x > 1)"}, "period": 1},
            SpecificationError,
            (
                "specification 'p' speaks of the first sample only; "
                "write always(historically[0:2](x > 1)) or view='step'"
            ),
        ),
        (
            {"specs": "always[0:2](x > 1)"},
            SpecificationError,
            (
                "specification 'spec' has bounds in time, but <Timeless> does not say how long a "
                "step lasts: there is no dt, tau or config['policy_frequency'] in it, or in an "
                "environment inside it; give period= in seconds, or period=1 to count steps"
            ),
        ),
        (
            {"specs": {}},
            InputError,
            "expected at least one specification, got an empty mapping",
        ),
        (
            {"specs": 3},
            InputTypeError,
            (
                "expected the text of a specification, the path of a .stl file or an "
                "rtamt.Specification, got 3"
            ),
        ),
        (
            {"signals": {"y": "obs[0]"}},
            InputError,
            (
                "variable 'x' has no signal; the signals are 'y'; give one: \"x\": \"obs[INDEX]\""
                ", or if it is a constant declare it: const float x = VALUE"
            ),
        ),
        (
            {"signals": {"x": "obs[1]"}},
            InputError,
            (
                "signal 'x': obs[1] does not fit: the observation space has 1 element there, "
                "0 to 0; it is Box(shape=(1,), dtype=float64)"
            ),
        ),
        (
            {"on_violation": "stop"},
            InputError,
            "expected on_violation='terminate' or 'truncate' or 'report', got 'stop'",
        ),
        ({"view": "now"}, InputError, "expected view='episode' or 'step', got 'now'"),
        ({"nan": "skip"}, InputError, "expected nan='raise' or 'hold' or 'unknown', got 'skip'"),
        (
            {"cost": "square"},
            InputError,
            "expected cost=None or 'violation' or 'depth' or 'latched' or 'first', got 'square'",
        ),
        (
            {"buffer_length": -1},
            InputError,
            "expected buffer_length= as an integer, 0 or more, got -1",
        ),
    ],
)
def test_what_cannot_be_monitored_is_refused_at_construction(
    arguments: dict[str, Any], error: type[RtamtError], message: str | None
) -> None:
    given = {"specs": "always(x > 1)", "signals": X, **arguments}
    with pytest.raises(error) as caught:
        StlMonitor(Timeless(), **given)
    if message is not None:
        assert str(caught.value) == message


def test_an_error_in_one_of_several_specifications_names_it() -> None:
    with pytest.raises(rtamt.ParseError) as caught:
        StlMonitor(Timeless(), {"good": "always(x > 1)", "bad": "always(x >"}, X)
    assert caught.value.__notes__ == ["in specification 'bad'"]


def test_the_period_behind_a_wrapper_that_skips_steps_is_not_guessed() -> None:
    env = MaxAndSkipObservation(gym.make("CartPole-v1"), skip=4)
    late = "eventually[0:0.8](x > 1)"
    why = "does not say how long a step lasts: a MaxAndSkipObservation makes several steps in one; "
    with pytest.raises(SpecificationError, match=why + "give period="):
        StlMonitor(TransformReward(env, float), late, {"x": "obs[0]"})
    monitor = StlMonitor(env, late, {"x": "obs[0]"}, period=0.08)
    assert monitor.period == Fraction(2, 25)


def test_a_bound_that_is_no_multiple_of_the_period_is_refused() -> None:
    with pytest.raises(SpecificationError, match=r"0\.03.*0\.02"):
        StlMonitor(gym.make("CartPole-v1"), "always[0:0.03](x < 2)", X)


def test_a_future_without_end_is_refused_in_the_step_view() -> None:
    with pytest.raises(SpecificationError, match="eventually"):
        StlMonitor(Timeless(), "x > 1 implies eventually(x < 1)", X, view="step")
