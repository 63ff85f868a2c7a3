"""Specifications by the names of an environment's own requirements."""

from collections.abc import Callable, Mapping
from typing import Any

import gymnasium as gym
import pytest
from rtamt_envs import scenario_of

import rtamt
from rtamt_gym import StlMonitor, StlReward, VectorStlMonitor, simulate
from rtamt_gym.__main__ import main
from rtamt_gym.judging.specs import SpecsLike, load_specs

ID = "rtamt/RequestGrant-v0"
OWN = scenario_of("RequestGrant").specifications
FULL = OWN["granted"]
Output = pytest.CaptureFixture[str]


@pytest.mark.parametrize(
    ("given", "names"),
    [
        ("granted", {"granted": FULL}),
        ({"mine": "granted"}, {"mine": FULL}),
        (
            {"mine": "granted", "low": "always(gnt < 7)"},
            {"mine": FULL, "low": rtamt.parse("always(gnt < 7)")},
        ),
        (FULL, {"granted": FULL}),
    ],
)
def test_a_name_is_the_requirement(
    given: SpecsLike, names: Mapping[str, rtamt.Specification]
) -> None:
    loaded = load_specs(given, OWN)
    assert {name: spec.formula for name, spec in loaded.items()} == {
        name: spec.formula for name, spec in names.items()
    }


def test_a_text_that_is_no_name_is_a_text() -> None:
    assert str(load_specs("gnt", OWN)["spec"].formula) == "gnt"
    assert str(load_specs("granted")["spec"].formula) == "granted"


@pytest.mark.parametrize(
    "make",
    [
        lambda specs: simulate(gym.make(ID), specs, seed=0),
        lambda specs: StlMonitor(gym.make(ID), specs),
        lambda specs: StlReward(gym.make(ID), specs, mode="add"),
        lambda specs: VectorStlMonitor(gym.make_vec(ID, 2), specs),
    ],
)
def test_wrappers_and_simulate_take_names(make: Callable[[Any], Any]) -> None:
    make("granted")
    make({"one": "granted", "two": "always(gnt >= 0)"})
    with pytest.raises(rtamt.InputError) as caught:
        make("grantd")
    assert str(caught.value) == (
        "unknown requirement 'grantd'; the requirements are 'granted'; did you mean 'granted'?"
    )


def test_simulate_judges_all_of_them_where_none_is_given() -> None:
    run, named = simulate(gym.make(ID), seed=0), simulate(gym.make(ID), "granted", seed=0)
    assert list(run.histories) == list(OWN)
    assert run.histories["granted"].final == named.histories["granted"].final
    with pytest.raises(rtamt.InputTypeError, match="expected specifications for CartPole-v1"):
        simulate(gym.make("CartPole-v1"), policy=lambda _: 0)


def test_rtamt_run_takes_names_and_the_baseline(capsys: Output) -> None:
    assert main(["run", ID, "--policy", "baseline"]) == 0
    every = capsys.readouterr().out
    assert main(["run", ID, "--policy", "baseline", "--spec", "granted"]) == 0
    assert capsys.readouterr().out == every
    assert f"granted: {FULL.formula}" in every
    final = simulate(gym.make(ID), "granted", seed=0).histories["granted"].final
    row = every.split("granted ")[-1].split()
    assert row[:2] == [f"{final:+.3g}", "SATISFIED"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            [ID, "--spec", "grnted"],
            f"{ID} has no requirement 'grnted'; it has 'granted'; did you mean 'granted'?",
        ),
        (
            ["CartPole-v1"],
            "CartPole-v1 has no requirements of its own; write --spec 'always(x < 1)'",
        ),
        (
            ["CartPole-v1", "--spec", "always(x < 1)", "--policy", "baseline"],
            "--policy baseline: expected a scenario, which has one, got ",
        ),
    ],
)
def test_what_is_not_there_is_one_message(
    arguments: list[str], message: str, capsys: Output
) -> None:
    assert main(["run", *arguments]) == 2
    assert capsys.readouterr().err.startswith(f"rtamt: error: {message}")
