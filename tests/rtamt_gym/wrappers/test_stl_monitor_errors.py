"""Errors of `StlMonitor` at construction, and errors that all wrappers share."""

from __future__ import annotations

import functools
from fractions import Fraction
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers import MaxAndSkipObservation, TransformReward
from replay import Replay, X
from vector_environments import sync

import rtamt
from rtamt.errors import InputError, InputTypeError, RtamtError, SpecificationError
from rtamt_gym import StlMonitor, StlReward, VectorStlMonitor, VectorStlReward

ARGUMENTS: Any = ("always(abs(x) < 1)", X)


class Timeless(gym.Env[Any, Any]):
    """Does not say its period."""

    observation_space = spaces.Box(-1.0, 1.0, (1,), np.float64)
    action_space = spaces.Discrete(2)

    def __str__(self) -> str:
        return "<Timeless>"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            {"on_violation": "stop"},
            "expected on_violation='terminate' or 'truncate' or 'report', got 'stop'",
        ),
        ({"view": "now"}, "expected view='episode' or 'step', got 'now'"),
        ({"nan": "skip"}, "expected nan='raise' or 'hold' or 'unknown', got 'skip'"),
        (
            {"cost": "square"},
            "expected cost=None or 'violation' or 'depth' or 'latched' or 'first', got 'square'",
        ),
        ({"buffer_length": -1}, "expected buffer_length= as an integer, 0 or more, got -1"),
        (
            {"at_termination": "open"},
            "expected at_termination=None or 'complete' or 'cut' or 'failure', got 'open'",
        ),
        ({"at_truncation": None}, "expected at_truncation='complete' or 'cut' or 'open', got None"),
        (
            {"at_truncation": "failure"},
            "expected at_truncation='complete' or 'cut' or 'open', got 'failure'",
        ),
        (
            {"cost": "depth", "semantics": "boolean"},
            (
                'cost="depth" has no depth to measure under semantics="boolean", where a '
                'robustness is +inf or -inf; use cost="violation"'
            ),
        ),
    ],
)
def test_wrong_option_of_one_and_of_many(arguments: dict[str, Any], message: str) -> None:
    make = functools.partial(Replay, [3, 3])
    envs = sync([make], AutoresetMode.NEXT_STEP)
    wrappers: list[tuple[Any, Any]] = [(StlMonitor, make()), (VectorStlMonitor, envs)]
    for wrapper, env in wrappers:
        with pytest.raises(InputError) as caught:
            wrapper(env, "always(x > 1)", X, **arguments)
        assert str(caught.value) == message


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"specs": "always(x >)"}, rtamt.ParseError, None),
        (
            {"specs": "x > 1"},
            SpecificationError,
            (
                "specification 'spec' is about the first sample only; "
                "write always(x > 1) or view='step'"
            ),
        ),
        (
            {"specs": {"p": "historically[0:2](x > 1)"}, "period": 1},
            SpecificationError,
            (
                "specification 'p' is about the first sample only; "
                "write always(historically[0:2](x > 1)) or view='step'"
            ),
        ),
        (
            {"specs": "always[0:2](x > 1)"},
            SpecificationError,
            (
                "specification 'spec' has bounds in time, but <Timeless> does not state the "
                "duration of a step: there is no dt, tau or config['policy_frequency'] in it, or "
                "in an environment inside it; give period= in seconds, or period=1 if every bound "
                "counts steps"
            ),
        ),
        (
            {"signals": ["x"]},
            InputTypeError,
            """expected a mapping such as signals={"x": "obs[0]"}, got ['x']""",
        ),
        ({"specs": {}}, InputError, "expected at least one specification, got an empty mapping"),
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
                "variable 'x' has no signal; the signals are 'y'; pass signals="
                '{"x": "obs[INDEX]"}, or declare a constant: const float x = VALUE'
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


# ---- one environment, many, and several agents ----


def refusal(wrapper: Any, env: object, **options: Any) -> str:
    with pytest.raises(InputTypeError) as caught:
        wrapper(env, *ARGUMENTS, **options)
    return str(caught.value)


def test_many_environments_need_a_vector_wrapper() -> None:
    envs = gym.make_vec("CartPole-v1", 2)
    expected = (
        f"expected an environment of Gymnasium, got {envs!r}; "
        "use VectorStlMonitor or VectorStlReward for many environments"
    )
    assert refusal(StlMonitor, envs) == expected
    assert refusal(StlReward, envs, mode="add") == expected


def test_one_environment_needs_a_scalar_wrapper() -> None:
    env = gym.make("CartPole-v1")
    expected = (
        f"expected a vector environment of Gymnasium, got {env!r}; "
        "use StlMonitor or StlReward for one environment"
    )
    assert refusal(VectorStlMonitor, env) == expected
    assert refusal(VectorStlReward, env, mode="add") == expected


def test_several_agents_need_a_parallel_wrapper() -> None:
    class Agents:
        possible_agents = ("first", "second")

        def __repr__(self) -> str:
            return "<Agents>"

    assert refusal(StlMonitor, Agents()) == (
        "expected an environment of Gymnasium, got <Agents>; "
        "use ParallelStlMonitor for several agents"
    )


def test_a_name_is_no_environment_yet() -> None:
    assert refusal(StlMonitor, "CartPole-v1") == (
        "expected an environment of Gymnasium, got 'CartPole-v1'; make it with gym.make"
    )
    assert refusal(VectorStlMonitor, "CartPole-v1") == (
        "expected a vector environment of Gymnasium, got 'CartPole-v1'; make it with gym.make_vec, "
        "envpool.make_gymnasium or pufferlib.vector.make"
    )
