"""`rtamt evaluate` and `rtamt compare`: their output, files, exit codes and errors."""

import sys
from pathlib import Path
from typing import Any

import pytest
from evaluations import evaluation_of

from rtamt_gym import compare, evaluate_policy
from rtamt_gym.__main__ import main
from rtamt_gym.results import Comparison, Evaluation

Output = pytest.CaptureFixture[str]
SHORT = ["--spec", "up = always[0:0.3](abs(angle) < 0.2)", "--signal", "angle=obs[2]"]
CART = ["evaluate", "CartPole-v1", "--at-termination", "failure", *SHORT]


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def told(capsys: Output, code: int, *arguments: str) -> list[str]:
    """Return the output of a command; no line is too long."""
    assert main([*arguments]) == code, capsys.readouterr()
    out = capsys.readouterr().out.splitlines()
    assert all(len(line) <= 80 for line in out)
    return [line.rstrip() for line in out]


def evaluated(policy: str, **arguments: Any) -> Evaluation:  # noqa: ANN401
    return evaluate_policy(
        policy,
        "CartPole-v1",
        {"up": "always[0:0.3](abs(angle) < 0.2)"},
        {"angle": "obs[2]"},
        at_termination="failure",
        **arguments,
    )


def test_an_evaluation_is_told_and_saved(capsys: Output) -> None:
    options = ["--policy", "random", "--episodes", "20", "--seed", "7", "--n-envs", "4"]
    files = ["--save", "random.json", "--report", "random.html"]
    out = told(capsys, 0, *CART, *options, *files)
    expected = evaluated("random", episodes=20, seed=7)
    assert out == [
        *str(expected).splitlines(),
        "",
        "evaluation: random.json",
        "report: random.html",
    ]
    assert "at least" in Path("random.html").read_text()
    assert Evaluation.load("random.json") == expected


@pytest.mark.slow(keep=2)
@pytest.mark.parametrize(
    ("policy", "rules", "code", "decision"),
    [
        ("random", {"target": 0.2, "margin": 0.1}, 0, "meets 0.2"),
        ("random", {"target": 0.99, "alpha": 0.01, "margin": 0.1}, 1, "falls short of 0.99"),
        ("random", {"target": 0.65, "episodes": 10}, 3, "undecided after 10"),
        ("zero", {"until_width": 0.2}, 0, "known to 0.2"),
    ],
)
def test_the_exit_code_says_whether_the_target_is_met(
    capsys: Output, policy: str, rules: dict[str, Any], code: int, decision: str
) -> None:
    options = [f"--{name.replace('_', '-')}={value}" for name, value in rules.items()]
    out = told(capsys, code, *CART, "--policy", policy, *options)
    assert out[-1] == f"up: {decision}"
    expected = evaluated(policy, **{"episodes": 10_000} | rules)
    assert out == str(expected).splitlines()


def test_one_requirement_that_falls_short_decides_over_those_that_are_open(capsys: Output) -> None:
    spec = ["--spec", "never = always(angle > 9)", "--spec", "may = always[0:0.3](angle < 0.2)"]
    arguments = ["--signal", "angle=obs[2]", "--policy", "random", "--target", "0.8"]
    arguments += ["--margin", "0.3", "--episodes", "5", "--at-termination", "failure"]
    out = told(capsys, 1, "evaluate", "CartPole-v1", *spec, *arguments)
    assert out[-2:] == ["never: falls short of 0.8", "may: undecided after 5"]


@pytest.mark.slow
def test_a_scenario_is_evaluated_under_its_own_requirements_and_policy(capsys: Output) -> None:
    out = told(
        capsys, 0, "evaluate", "rtamt/ChasingCars-v0", "--policy", "zero", "--spec", "CC1",
        *("--episodes", "2"),
    )  # fmt: skip
    assert out[:2] == ["rtamt/ChasingCars-v0 under zero", "2 episodes, seeds 0 to 1"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "the following arguments are required: --policy; see rtamt evaluate --help"),
        (
            ["--policy", "zero", "--target", "95"],
            "expected --target as a finite number above 0 and at most 1, got 95.0",
        ),
        (
            ["--policy", "zero", "--target", "0.9", "--until-width", "0.1"],
            ("expected one rule, got --until-width 0.1 and --target 0.9; omit one"),
        ),
        (
            ["--policy", "zero", "--target", "0.9", "--margin", "0.95"],
            "expected --margin above 0 and below --target 0.9, got 0.95",
        ),
        (["--policy", "zero", "--alpha", "0.1"], "--alpha needs --target"),
        (
            ["--policy", "zero", "--save", "out.csv"],
            "cannot write out.csv: expected a name that ends in .json",
        ),
        (
            ["--policy", "zero", "--report", "out.pdf"],
            "cannot write out.pdf: expected a name that ends in .html",
        ),
    ],
)
def test_mistakes_are_told_before_anything_runs(
    capsys: Output, arguments: list[str], message: str
) -> None:
    assert main([*CART, *arguments]) == 2
    assert capsys.readouterr().err == f"rtamt: error: {message}\n"


def test_a_missing_package_is_told_before_anything_runs(
    capsys: Output, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "plotly", None)
    assert main([*CART, "--policy", "zero", "--report", "out.html"]) == 2
    out, err = capsys.readouterr()
    message = "plotly is not installed; from the checkout: pip install '.[report]'"
    assert (out, err) == ("", f"rtamt: error: {message}\n")


def save(name: str, heights: list[float], first: int = 0) -> Evaluation:
    seeds = range(first, first + len(heights))
    evaluation = evaluation_of({"near": heights}, policy=name, seeds=seeds)
    evaluation.save(f"{name}.json")
    return evaluation


def test_a_comparison_is_told_and_saved_and_a_worse_policy_has_exit_code_1(capsys: Output) -> None:
    old, new = save("old", [1.0] * 15 + [-1.0] * 5), save("new", [1.0] * 5 + [-1.0] * 15)
    out = told(
        capsys, 1, "compare", "old.json", "new.json", "--save", "both.json", "--report=a.html"
    )
    files = ["comparison: both.json", "report: a.html"]
    assert out == [*str(compare(old, new)).splitlines(), "", *files]
    assert "points less of the episodes" in Path("a.html").read_text()
    assert Comparison.load("both.json") == compare(old, new)
    assert told(capsys, 0, "compare", "new.json", "old.json")
    assert told(capsys, 0, "compare", "old.json", "old.json")


def test_what_cannot_be_compared_is_told(capsys: Output) -> None:
    save("old", [1.0])
    save("new", [1.0], first=5)
    one = evaluation_of({"near": [1.0]})
    compare(one, one).save("both.json")
    messages = {
        ("old.json", "new.json"): (
            "cannot pair the episodes: A has the seeds 0 to 0, B has the seeds 5 to 5, none in "
            "common; evaluate both with the same --seed"
        ),
        ("old.json", "both.json"): (
            "both.json holds no evaluation but a result of kind 'comparison': expected a file that "
            "rtamt evaluate --save and Evaluation.save write"
        ),
        ("old.json", "none.json"): "cannot open none.json: No such file or directory",
        (
            "old.json",
            "new.json",
            "--save",
            "old.json",
        ): "cannot write old.json: it is an input of the command",
    }
    for arguments, message in messages.items():
        assert main(["compare", *arguments]) == 2
        assert capsys.readouterr().err == f"rtamt: error: {message}\n"
