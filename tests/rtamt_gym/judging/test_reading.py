"""How samples are judged is said once, and what was given is told from what was not."""

import argparse
import inspect
from collections.abc import Callable
from dataclasses import Field, field
from fractions import Fraction
from typing import Any, TypedDict

import gymnasium as gym
import pytest

import rtamt
from rtamt_gym import (
    ParallelStlMonitor,
    Parameter,
    Reading,
    Runner,
    StepMonitor,
    StlMonitor,
    VectorStlMonitor,
    evaluate_policy,
    evaluate_rollouts,
    falsify,
    mine,
    simulate,
    sweep,
)
from rtamt_gym.commands.arguments import add_reading
from rtamt_gym.judging.reading import (
    ROWS,
    EpisodeReading,
    InstantReading,
    PredicateReading,
    RunReading,
    SampleReading,
    checked_reading,
    lists_reading,
)

KINDS: dict[type, tuple[Callable[..., Any], ...]] = {
    RunReading: (simulate, StlMonitor, Runner),
    EpisodeReading: (sweep, falsify, evaluate_policy, VectorStlMonitor, ParallelStlMonitor),
    InstantReading: (StepMonitor,),
    SampleReading: (mine, evaluate_rollouts),
    PredicateReading: (),
}

OTHERS: dict[str, tuple[Any, Any]] = {
    "period": (1, 0.02),
    "view": ("step", "episode"),
    "nan": ("hold", "raise"),
    "align": ("nearest", None),
    "semantics": ("boolean", "standard"),
    "inputs": (["x"], None),
    "outputs": (["x"], None),
    "at_termination": ("failure", "complete"),
    "at_truncation": ("open", "cut"),
    "substeps": (False, True),
}
"""Two values of each option that a monitor has."""


def push(_obs: object) -> int:
    return 1


def monitored(options: dict[str, Any]) -> StlMonitor[Any, Any]:
    env = gym.make("CartPole-v1")
    return StlMonitor(env, "always(x < 1)", {"x": "obs[0]"}, **options)


@pytest.mark.parametrize("kind", KINDS)
def test_the_kinds_of_readings_have_the_types_of_the_options(kind: type) -> None:
    types = Reading.__annotations__
    assert {n: t.__forward_arg__ for n, t in kind.__annotations__.items()} == {
        name: types[name] for name in kind.__annotations__
    }


@pytest.mark.parametrize("kind", KINDS)
def test_every_keyword_is_listed_with_its_default_and_its_meaning(kind: type) -> None:
    plain = Reading()
    for function in KINDS[kind]:
        listed = inspect.signature(function).parameters
        init = vars(function).get("__init__") if isinstance(function, type) else None
        described = f"{function.__doc__}{init.__doc__ if init else ''}"
        for name in kind.__annotations__:
            assert listed[name].default == getattr(plain, name), (function, name)
            assert listed[name].kind is inspect.Parameter.KEYWORD_ONLY
            assert f"{name}" in described or function is VectorStlMonitor
        assert "reading" not in listed


def test_help_says_what_each_option_means() -> None:
    told = " ".join((simulate.__doc__ or "").split())
    assert "**reading" not in told
    assert 'nan: ``"raise"`` refuses a signal that is nan' in told
    assert "at_truncation: How a time limit is read" in told
    assert "substeps: Whether to take a sample after every step" in told
    assert 'nan: ``"raise"`` refuses' in " ".join((Reading.__doc__ or "").split())


@pytest.mark.parametrize("function", [simulate, sweep, falsify, evaluate_policy, Runner])
def test_a_keyword_that_is_none_names_the_nearest(function: Callable[..., Any]) -> None:
    needed = {"samples": 1} if function is sweep else {}
    with pytest.raises(TypeError) as refused:
        function(None, None, veiw="step", **needed)
    assert str(refused.value) == (
        f"{function.__name__}() got an unexpected keyword argument 'veiw'; did you mean 'view'?"
    )


def test_what_was_given_is_told_from_what_equals_a_default() -> None:
    assert Reading(view="episode").given == {"view"}
    assert Reading(view="episode") == Reading()
    assert Reading(inputs=["a"]) == Reading(inputs=("a",))
    assert Reading(view="episode").options() == {"view": "episode"}


@pytest.mark.parametrize(
    ("option", "value"), [(name, value) for name, pair in OTHERS.items() for value in pair]
)
def test_an_option_lies_over_that_of_a_monitor_only_if_it_is_the_same(
    option: str, value: object
) -> None:
    for own in OTHERS[option]:
        over: dict[str, Any] = {option: value}
        has = Reading(**{option: own}).whole(RunReading)
        if Reading(**over) == has or value is None:  # which is what a monitor says
            assert Reading(**over).over(has, "a", "b") == has
        else:
            with pytest.raises(rtamt.InputError, match=f"^{option}= comes from a, which has "):
                Reading(**over).over(has, "a", "b")


@pytest.mark.parametrize(
    ("has", "got"),
    [
        ({"period": 0.02}, {"period": "20ms"}),
        ({"period": 0.02}, {"period": Fraction(1, 50)}),
        ({"inputs": ["a", "b"]}, {"inputs": ("b", "a")}),
        ({"outputs": ["a"]}, {"outputs": {"a"}}),
    ],
)
def test_an_option_is_the_same_in_other_words(has: dict[str, Any], got: dict[str, Any]) -> None:
    assert Reading(**got).over(Reading(**has), "a", "b") == Reading(**has)


# In each, the option that is given equals its default, and the monitor has another.
GRAVITY = [Parameter("env.gravity", 9, 10)]
DEFAULTS = [("view", "step"), ("semantics", "boolean"), ("at_truncation", "open"), ("nan", "hold")]


@pytest.mark.parametrize(("option", "own"), DEFAULTS)
@pytest.mark.parametrize(
    "judge",
    [
        lambda env, **given: simulate(env, policy=push, seed=1, **given),
        lambda env, **given: evaluate_policy(push, env, episodes=1, **given),
        lambda env, **given: sweep(env, None, GRAVITY, samples=1, **given),
        lambda env, **given: falsify(env, None, GRAVITY, budget=1, **given),
        Runner,
    ],
    ids=["simulate", "evaluate_policy", "sweep", "falsify", "Runner"],
)
def test_a_default_that_is_given_does_not_lose_against_a_monitor(
    judge: Callable[..., Any], option: str, own: str
) -> None:
    default = getattr(Reading(), option)
    with pytest.raises(rtamt.InputError) as refused:
        judge(monitored({option: own}), **{option: default})
    assert str(refused.value) == (
        f"{option}= comes from the monitor of the environment, which has {own!r}, got "
        f"{default!r}; leave it out, or give specifications with it"
    )


@pytest.mark.parametrize(("option", "own"), DEFAULTS)
def test_a_default_that_is_given_does_not_lose_against_a_vector_monitor(
    option: str, own: str
) -> None:
    envs = gym.make_vec("CartPole-v1", num_envs=2, vectorization_mode="sync")
    options: dict[str, Any] = {option: own}
    watched = VectorStlMonitor(envs, "always(x < 1)", {"x": "obs[0]"}, **options)
    default = getattr(Reading(), option)
    with pytest.raises(rtamt.InputError, match=f"^{option}= comes from the monitor"):
        evaluate_policy(push, watched, episodes=2, **{option: default})


def test_what_a_monitor_has_may_be_said_again() -> None:
    own: dict[str, Any] = {"view": "step", "at_truncation": "open", "at_termination": "failure"}
    plain = simulate(monitored(own), policy=push, seed=1)
    assert simulate(monitored(own), policy=push, seed=1, **own) == plain
    assert plain.view == "step"


def test_a_row_is_shown_and_checked_wherever_options_are(monkeypatch: pytest.MonkeyPatch) -> None:
    row = replace_row(ROWS["view"], name="gap", default="small", choices=("small", "large"))
    monkeypatch.setitem(ROWS, "gap", row)
    kind: Any = TypedDict("kind", {"gap": str}, total=False)

    def judged(x: float, **reading: str) -> None:
        """Judges.

        Args:
            x: A number.
            **reading: How.
        """

    shown = lists_reading(kind)(judged)
    assert str(inspect.signature(shown)) == "(x: float, *, gap: str = 'small') -> None"
    assert 'gap: ``"episode"``: a formula is about' in (shown.__doc__ or "")
    parser = argparse.ArgumentParser()
    add_reading(parser, "gap")
    assert parser.parse_args(["--gap", "large"]).gap == "large"
    assert "gap" not in parser.parse_args([])
    assert "(default: small)" in parser.format_help()
    with pytest.raises(TypeError, match="unexpected keyword argument 'gpa'; did you mean 'gap'"):
        checked_reading({"gpa": "large"}, shown, kind)


def replace_row(row: Field[Any], name: str, default: str, choices: tuple[str, ...]) -> Field[Any]:
    """A row like another, with a name, a default and choices of its own."""
    made: Any = field(default=default, metadata={**row.metadata, "choices": choices})
    made.name, made.type = name, str
    found: Field[Any] = made
    return found
