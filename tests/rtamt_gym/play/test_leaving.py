"""A system that calls ``sys.exit`` fails; it ends neither the program nor a search."""

import json
import sys
from pathlib import Path
from typing import Any

import gymnasium as gym
import mujoco  # type: ignore[import-untyped]
import numpy as np
import pytest
from leaving import LEAVING, Leaving, leaves_while_running, leaving_policy

from rtamt import InputError
from rtamt_gym import Parameter, Runner, StepMonitor, evaluate_policy, falsify, simulate
from rtamt_gym.__main__ import main
from rtamt_gym.search.sweeps.sweep import FailedSimulationWarning

Output = pytest.CaptureFixture[str]
BALL = "<mujoco><worldbody><body><freejoint/><geom size='.1'/></body></worldbody></mujoco>"
NO_END = "which does not end a simulation; return, or raise an error"


def test_a_simulation_that_leaves_is_an_error_with_its_samples() -> None:
    with pytest.raises(InputError) as caught:
        simulate(leaves_while_running, "always(y < 2)", case={"x": 1.0}, period=1)
    assert str(caught.value) == f"leaves_while_running called sys.exit(0), {NO_END}"
    assert caught.value.run.steps == 0  # type: ignore[attr-defined]


@pytest.mark.slow(keep=1)
@pytest.mark.parametrize("n_jobs", [None, 1])
def test_a_search_counts_it_as_failed_and_goes_on(n_jobs: int | None) -> None:
    with pytest.warns(FailedSimulationWarning):
        found = falsify(
            *(leaves_while_running, "always(y < 2)", [Parameter("x", 0, 1)]),
            period=1,
            budget=20,
            n_jobs=n_jobs,
        )
    error = f"InputError: leaves_while_running called sys.exit(0), {NO_END}"
    assert {row.error: row.case.columns()["x"] >= 0.5 for row in found.record} == {
        "": False,
        error: True,
    }


@pytest.mark.slow(keep=4)
@pytest.mark.parametrize("where", LEAVING)
@pytest.mark.parametrize("options", [{}, {"n_jobs": 1}, {"n_envs": 2}, {"vector": True}])
def test_an_episode_that_leaves_is_not_satisfied(where: str, options: dict[str, Any]) -> None:
    def make() -> Any:  # noqa: ANN401
        return Leaving(where)

    env, name = make, "Leaving"
    if options == {"vector": True}:
        options, name = {}, "an environment" if where == "step" else "SyncVectorEnv"
        env = lambda: gym.vector.SyncVectorEnv([make, make])  # noqa: E731
    policy = leaving_policy if where == "policy" else (lambda _obs: 0)
    with pytest.warns(FailedSimulationWarning):
        result = evaluate_policy(
            *(policy, env, "always(y < 2)", {"y": "obs[0]"}),
            episodes=6,
            at_termination="complete",
            **options,
        )
    found = result.requirements["spec"]
    assert (found.satisfied, found.failed, found.rate) == (3, 3, 0.5)
    errors = {row.error.partition(", ")[0] for row in result.record.failed()}
    if where == "policy":
        assert errors == {"InputError: the policy called sys.exit()"}
    else:
        assert errors == {f"InputError: {name} called sys.exit(0)"}


class Still:
    """A model that acts in all episodes at once."""

    def predict(self, observation: Any, state: Any, *_: Any, **__: Any) -> tuple[Any, Any]:  # noqa: ANN401
        return np.zeros(len(observation) if np.ndim(observation) > 1 else (), np.int64), state


def test_a_step_that_leaves_beside_other_episodes_is_of_one_alone() -> None:
    with pytest.warns(FailedSimulationWarning):
        found = evaluate_policy(
            *(Still(), lambda: Leaving("step"), "always(y < 2)", {"y": "obs[0]"}),
            episodes=6,
            at_termination="complete",
            n_envs=3,
        )
    errors = [row.error.partition(", ")[0] for row in found.record]
    assert errors == ["", "InputError: Leaving called sys.exit(0)"] * 3


def test_a_policy_of_a_module_that_leaves_is_named_with_the_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Output
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("quitter.py").write_text("import sys\n\ndef act(obs):\n    sys.exit(0)\n")
    of = ["CartPole-v1", "--signal", "x=obs[0]", "--policy", "quitter:act"]
    said = f"the policy quitter:act called sys.exit(0) (quitter.py, line 4), {NO_END}\n"
    assert main(["run", *of, "--spec", "always(x < 2)"]) == 2
    assert capsys.readouterr().err == f"rtamt: error: {said}"
    all_failed = "rtamt: error: all 3 episodes failed, the first with InputError: "
    assert main(["evaluate", *of, "--spec", "always(x < 2)", "--episodes", "3"]) == 2
    assert capsys.readouterr().err.splitlines(keepends=True)[-1] == f"{all_failed}{said}"


def test_a_policy_that_leaves_is_told_from_its_environment() -> None:
    def act(*_shown: object) -> int:
        sys.exit(3)

    model = mujoco.MjModel.from_xml_string(BALL)
    given = "always(y < 9)", {"y": "qpos[0]"}
    systems: list[tuple[Any, tuple[Any, ...], dict[str, Any]]] = [
        (Leaving("policy"), (given[0], {"y": "obs[0]"}), {"period": 1}),
        ((model, mujoco.MjData(model)), given, {}),
        (StepMonitor(model, mujoco.MjData(model), *given), (), {}),
    ]
    for system, asked, options in systems:
        with pytest.raises(InputError) as caught:
            simulate(system, *asked, policy=act, duration=3, **options)
        assert str(caught.value) == f"the policy called sys.exit(3), {NO_END}"
        assert caught.value.run.steps == 0  # type: ignore[attr-defined]


def test_an_environment_that_leaves_while_it_is_made_is_an_error() -> None:
    gym.register("Leaves-v0", lambda **_: Leaving("init"))
    try:
        with pytest.raises(InputError) as caught:
            Runner("Leaves-v0", "always(y < 2)", signals={"y": "obs[0]"})
    finally:
        del gym.registry["Leaves-v0"]
    assert str(caught.value) == f"the making of Leaves-v0 called sys.exit(0), {NO_END}"
    with pytest.raises(InputError, match="the function that makes the environment called"):
        evaluate_policy(lambda _obs: 0, lambda: Leaving("init"), "always(y < 2)", {"y": "obs[0]"})


@pytest.fixture
def leaving_module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The working directory with modules, of which one leaves while it is imported."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "wry.py").write_text(
        "def tank(x):\n    yield {'y': x}\n\nimport sys\nsys.exit(0)\n"
    )
    (tmp_path / "sly.py").write_text("import sys\n\ndef tank(x):\n    sys.exit()\n    yield {}\n")


IMPORTED = (
    "rtamt: error: cannot import wry: it called sys.exit(0) (wry.py, line 5); put "
    "the main program below "
    'if __name__ == "__main__":\n'
)


@pytest.mark.slow(keep=1)
@pytest.mark.usefixtures("leaving_module")
@pytest.mark.parametrize("more", [[], ["-j", "1"]])
def test_a_module_that_leaves_while_it_is_imported_exits_2(more: list[str], capsys: Output) -> None:
    search = ["always(y < 2)", "--vary", "x=0:1", "--period", "1", "--budget", "3", *more]
    assert main(["falsify", "wry:tank", *search]) == 2
    assert capsys.readouterr().err == IMPORTED
    assert main(["falsify", "sly:tank", *search]) == 2
    expected = (
        "rtamt: error: all 3 simulations failed, the first with InputError: tank called sys.exit"
    )
    assert capsys.readouterr().err.startswith(expected)
    run = ["run", "CartPole-v1", "--spec", "always(x < 2)", "--signal", "x=obs[0]"]
    assert main([*run, "--policy", "wry:tank"]) == 2
    assert capsys.readouterr().err == IMPORTED


@pytest.mark.slow
@pytest.mark.usefixtures("leaving_module")
def test_a_case_whose_system_leaves_has_no_verdict(capsys: Output) -> None:
    found = falsify(leaves_while_running, "always(y < 0.2)", [Parameter("x", 0, 0.4)], period=1)
    found.save("case.json")
    kept = json.loads(Path("case.json").read_text())
    del kept["fingerprint"]  # which another system does not have
    messages = {
        "wry:tank": IMPORTED,
        "sly:tank": f"rtamt: error: tank called sys.exit(), {NO_END}\n",
    }
    for name, message in messages.items():
        Path("case.json").write_text(json.dumps(kept | {"system": {"object": name}}))
        assert main(["replay", "case.json"]) == 2
        assert capsys.readouterr().err == message
        assert main(["report", "--play", "case.json", "-o", "page.html"]) == 3
        out, err = capsys.readouterr()
        assert out == "report: page.html\n"
        error = message.removeprefix("rtamt: error: ")
        line = (
            f"playing case.json, which imports {name.partition(':')[0]} "
            f"case.json was not run: InputError: {error}"
        )
        assert " ".join(err.split()) == line.strip()
        assert "The case was not run: InputError: " in Path("page.html").read_text()
