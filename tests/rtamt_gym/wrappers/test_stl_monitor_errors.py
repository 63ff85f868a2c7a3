"""Errors of `StlMonitor` at construction, and errors that all wrappers share."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.wrappers import MaxAndSkipObservation, TransformReward
from replay import X

import rtamt
from rtamt.errors import SpecificationError
from rtamt_gym import StlMonitor


class Timeless(gym.Env[Any, Any]):
    """An environment without a period."""

    observation_space = spaces.Box(-1.0, 1.0, (1,), np.float64)
    action_space = spaces.Discrete(2)

    def __str__(self) -> str:
        return "<Timeless>"


def test_an_error_in_one_of_several_specifications_names_it() -> None:
    with pytest.raises(rtamt.ParseError) as caught:
        StlMonitor(Timeless(), {"good": "always(x > 1)", "bad": "always(x >"}, X)
    assert caught.value.__notes__ == ["in specification 'bad'"]


def test_the_period_behind_a_wrapper_that_skips_steps_is_not_guessed() -> None:
    env = MaxAndSkipObservation(gym.make("CartPole-v1"), skip=4)
    late = "eventually[0:0.8](x > 1)"
    why = (
        "does not state the duration of a step: a MaxAndSkipObservation makes several steps in "
        "one; "
    )
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
