"""`EvaluationOptions`: each option is described once, and explicit defaults count."""

import argparse
import ast
import inspect
import re
from collections.abc import Callable
from dataclasses import field
from fractions import Fraction
from typing import Any

import gymnasium as gym
import pytest
from paths import ROOT

import rtamt
from rtamt_gym import (
    EvaluationOptions,
    ParallelStlMonitor,
    Parameter,
    Runner,
    StepMonitor,
    StlMonitor,
    VectorStlMonitor,
    evaluate_policy,
    falsify,
    mine,
    simulate,
    sweep,
)
from rtamt_gym.mujoco import evaluate_rollouts
from rtamt_gym.options.command_line import add_options
from rtamt_gym.options.evaluation import (
    ROWS,
    Calls,
    EvaluationKeywords,
    checked_options,
    documents_options,
    names_for,
)

CALLS: dict[Calls, tuple[Callable[..., Any], ...]] = {
    "runs": (simulate, StlMonitor, Runner),
    "episodes": (sweep, falsify, evaluate_policy, VectorStlMonitor, ParallelStlMonitor),
    "instants": (StepMonitor,),
    "samples": (mine, evaluate_rollouts),
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


def test_keyword_types_match_rows() -> None:
    types = {
        name: kind.__forward_arg__ for name, kind in EvaluationKeywords.__annotations__.items()
    }
    assert types == {name: ROWS[name].type for name in names_for("runs")}


@pytest.mark.parametrize(
    ("calls", "function"),
    [(calls, function) for calls, functions in CALLS.items() for function in functions],
)
def test_signatures_and_docstrings_list_options(calls: Calls, function: Callable[..., Any]) -> None:
    parameters = inspect.signature(function).parameters
    init = vars(function).get("__init__") if isinstance(function, type) else None
    docstring = f"{function.__doc__}{init.__doc__ if init else ''}"
    for name in names_for(calls):
        assert parameters[name].default == ROWS[name].default
        assert parameters[name].kind is inspect.Parameter.KEYWORD_ONLY
        assert f"``{name}``" in docstring or function is VectorStlMonitor
    assert "reading" not in parameters


def test_one_docstring_describes_options() -> None:
    docstring = " ".join((EvaluationOptions.__doc__ or "").split())
    for name, row in ROWS.items():
        assert " ".join(f"{name}: {row.metadata['about']}".split()) in docstring


@pytest.mark.parametrize("function", [simulate, sweep, falsify, evaluate_policy, Runner])
def test_unknown_keyword_error(function: Callable[..., Any]) -> None:
    needed = {"samples": 1} if function is sweep else {}
    with pytest.raises(TypeError) as refused:
        function(None, None, veiw="step", **needed)
    assert str(refused.value) == (
        f"{function.__name__}() got an unexpected keyword argument 'veiw'; did you mean 'view'?"
    )


def test_given_differs_from_default() -> None:
    assert EvaluationOptions(view="episode").given == {"view"}
    assert EvaluationOptions(view="episode") == EvaluationOptions()
    assert EvaluationOptions(inputs=["a"]) == EvaluationOptions(inputs=("a",))
    assert EvaluationOptions(view="episode").options() == {"view": "episode"}


def test_given_options_stay_given() -> None:
    both = EvaluationOptions(nan="hold").over(EvaluationOptions(view="step"), "a", "b")
    assert both.given == {"nan", "view"}
    assert EvaluationOptions(end="cut").complete("samples").given == {"end", *names_for("samples")}


def test_monitors_report_wrong_semantics_and_names() -> None:
    specs = {name: rtamt.parse("always(x < 1)") for name in "ab"}
    reading = EvaluationOptions(semantics="bolean", inputs=["z"])  # type: ignore[arg-type]  # misspelled
    assert reading.from_monitors({"a": specs["a"]})["a"]["inputs"] == ("z",)
    with pytest.raises(rtamt.InputError, match="'z' in inputs is not a variable of a spec"):
        reading.from_monitors(specs)


@pytest.mark.parametrize(
    ("option", "value"), [(name, value) for name, pair in OTHERS.items() for value in pair]
)
def test_option_conflicts_with_monitor(option: str, value: object) -> None:
    for own in OTHERS[option]:
        over: dict[str, Any] = {option: value}
        has = EvaluationOptions(**{option: own}).complete("runs")
        if EvaluationOptions(**over) == has or value is None:  # as a monitor sets it
            assert EvaluationOptions(**over).over(has, "a", "b") == has
        else:
            with pytest.raises(rtamt.InputError, match=f"^{option}= comes from a, which has "):
                EvaluationOptions(**over).over(has, "a", "b")


@pytest.mark.parametrize(
    ("has", "got"),
    [
        ({"period": 0.02}, {"period": "20ms"}),
        ({"period": 0.02}, {"period": Fraction(1, 50)}),
        ({"inputs": ["a", "b"]}, {"inputs": ("b", "a")}),
        ({"outputs": ["a"]}, {"outputs": {"a"}}),
    ],
)
def test_equal_options_in_other_forms(has: dict[str, Any], got: dict[str, Any]) -> None:
    assert EvaluationOptions(**got).over(EvaluationOptions(**has), "a", "b") == EvaluationOptions(
        **has
    )


# In each, the given option equals its default, and the monitor has another.
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
def test_given_default_conflicts_with_monitor(
    judge: Callable[..., Any], option: str, own: str
) -> None:
    default = getattr(EvaluationOptions(), option)
    with pytest.raises(rtamt.InputError) as refused:
        judge(monitored({option: own}), **{option: default})
    assert str(refused.value) == (
        f"{option}= comes from the monitor of the environment, which has {own!r}, got "
        f"{default!r}; leave it out, or give specifications with it"
    )


@pytest.mark.parametrize(("option", "own"), DEFAULTS)
def test_given_default_conflicts_with_vector_monitor(option: str, own: str) -> None:
    envs = gym.make_vec("CartPole-v1", num_envs=2, vectorization_mode="sync")
    options: dict[str, Any] = {option: own}
    watched = VectorStlMonitor(envs, "always(x < 1)", {"x": "obs[0]"}, **options)
    default = getattr(EvaluationOptions(), option)
    with pytest.raises(rtamt.InputError, match=f"^{option}= comes from the monitor"):
        evaluate_policy(push, watched, episodes=2, **{option: default})


def test_repeated_options_of_monitor() -> None:
    own: dict[str, Any] = {"view": "step", "at_truncation": "open", "at_termination": "failure"}
    plain = simulate(monitored(own), policy=push, seed=1)
    assert simulate(monitored(own), policy=push, seed=1, **own) == plain
    assert plain.view == "step"


def test_docs_list_every_option_with_its_default_and_its_choices() -> None:
    page = (ROOT / "docs" / "gymnasium.md").read_text(encoding="utf-8")
    table = re.findall(r"^\| (`\w+`(?:, `\w+`)*) \| (.+?) \| .+ \|$", page, re.MULTILINE)
    listed = set()
    for cell, values in table:
        names, words = re.findall(r"`(\w+)`", cell), re.findall(r"`([^`]+)`", values)
        if names[0] not in ROWS or not words:
            continue
        listed |= set(names)
        row = ROWS[names[0]]
        assert ast.literal_eval(words[0]) == row.default, names
        if len(words) > 1 and row.metadata["choices"]:
            assert set(map(ast.literal_eval, words)) == set(row.metadata["choices"])
    assert listed >= set(names_for("runs"))


def test_one_row_defines_an_option(monkeypatch: pytest.MonkeyPatch) -> None:
    row: Any = field(default="small", metadata={**ROWS["view"].metadata, "about": "The gap."})
    row.name, row.type = "gap", "str"
    monkeypatch.setitem(ROWS, "gap", row)

    def judged(x: float, **reading: str) -> None:
        """Judges.

        Args:
            x: A number.
            **reading: How.
        """

    documented = documents_options("instants")(judged)
    assert str(inspect.signature(documented)).endswith(", gap: 'str' = 'small') -> None")
    assert "``gap``" in (documented.__doc__ or "")
    parser = argparse.ArgumentParser()
    add_options(parser, "--gap")
    assert parser.parse_args(["--gap", "step"]).gap == "step"
    assert "gap" not in parser.parse_args([])
    assert "the gap (default: small)" in parser.format_help()
    with pytest.raises(TypeError, match="unexpected keyword argument 'gpa'; did you mean 'gap'"):
        checked_options({"gpa": "large"}, documented, "instants")
