"""`rtamt run`: arguments of the environment, policies of one's own, samples inside of steps."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces

from rtamt_gym.__main__ import main

Output = pytest.CaptureFixture[str]


class Given(gym.Env[Any, Any]):
    """An environment that keeps what it was made with."""

    options: dict[str, Any]
    observation_space = spaces.Box(-np.inf, np.inf, (1,), np.float64)
    action_space = spaces.Discrete(2)
    control_timestep = 0.1

    def __init__(self, **options: Any) -> None:  # noqa: ANN401
        Given.options = options
        if "refused" in options:
            raise RuntimeError("the road has no lanes")
        if "unknown" in options:
            raise TypeError("no such argument: unknown")

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed, options=options)
        self.x = 0.0
        return np.array([self.x]), {}

    def step(self, action: int) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        self.x += action
        return np.array([self.x]), 0.0, False, False, {}


RUN = ["run", "RtamtGiven-v0", "--spec", "always(x < 2)", "--signal", "x=obs[0]"]


@pytest.fixture(autouse=True)
def _environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    gym.register("RtamtGiven-v0", Given, max_episode_steps=5)
    yield
    del gym.registry["RtamtGiven-v0"]
    for module in [name for name in sys.modules if name.startswith("rtamt_")]:
        if Path(sys.modules[module].__file__ or "").is_relative_to(tmp_path):
            del sys.modules[module]


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("2", 2),
        ("-0.5", -0.5),
        ("true", True),
        ("True", True),
        ("False", False),
        ("None", None),
        ("null", None),
        ('{"duration": 20, "lanes": [1, 2]}', {"duration": 20, "lanes": [1, 2]}),
        ('"2"', "2"),
        ("rgb_array", "rgb_array"),
        ("./hopper.xml", "./hopper.xml"),
        ("a=b", "a=b"),
        (" padded ", "padded"),
    ],
)
def test_an_argument_of_the_environment_is_json_or_text(
    text: str, value: object, capsys: Output
) -> None:
    assert main([*RUN, "--env-kwarg", f"key={text}", "--env-kwarg", "other=1"]) == 0
    capsys.readouterr()
    assert Given.options == {"key": value, "other": 1}
    assert type(Given.options["key"]) is type(value)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["key"], "--env-kwarg: expected KEY=VALUE, such as frame_skip=2, got 'key'"),
        (["key="], "--env-kwarg: expected KEY=VALUE, such as frame_skip=2, got 'key='"),
        (["2=3"], "--env-kwarg: expected KEY=VALUE, such as frame_skip=2, got '2=3'"),
        (["a=1", "a=2"], "--env-kwarg: expected one 'a', got two"),
        (
            ["config={'a': 1}"],
            (
                "--env-kwarg: expected JSON, such as '{\"duration\": 20}', got \"{'a': 1}\": "
                "Expecting property name enclosed in double quotes: line 1 column 2 (char 1)"
            ),
        ),
        (
            ["refused=1"],
            "cannot make RtamtGiven-v0 with refused=1: RuntimeError: the road has no lanes",
        ),
        (
            ["unknown='a'"],
            (
                "cannot make RtamtGiven-v0 with unknown=\"'a'\": TypeError: no such argument: "
                "unknown"
            ),
        ),
    ],
)
def test_an_argument_that_cannot_be_read_or_is_not_taken_is_refused(
    arguments: list[str], message: str, capsys: Output
) -> None:
    options = [word for argument in arguments for word in ("--env-kwarg", argument)]
    assert main([*RUN, *options]) == 2
    assert capsys.readouterr() == ("", f"rtamt: error: {message}\n")


def test_a_function_of_the_working_directory_drives_every_episode(capsys: Output) -> None:
    Path("rtamt_pilot.py").write_text("def act(obs):\n    return int(obs[0] < 1)\n")
    arguments = [*RUN, "--policy", "rtamt_pilot:act", "--episodes", "2", "--json", "o.json"]
    assert main(arguments) == 0
    capsys.readouterr()
    episodes = json.loads(Path("o.json").read_text())["trials"]
    assert [(e["steps"], e["outcomes"]["spec"]["robustness"]) for e in episodes] == [(5, 1.0)] * 2


@pytest.mark.parametrize(
    ("policy", "message"),
    [
        (
            "randm",
            (
                "--policy: expected random, zero, baseline, sb3:FILE.zip or module:function, "
                "got 'randm'"
            ),
        ),
        ("rtamt_absent:act", "there is no module 'rtamt_absent'"),
        ("rtamt_pilot:acct", "the module rtamt_pilot has no 'acct'; did you mean 'act'?"),
        (
            "rtamt_pilot:act",
            (
                "the policy rtamt_pilot:act raised IndexError: index 7 is out of bounds for axis 0 "
                "with size 1 (rtamt_pilot.py, line 2)"
            ),
        ),
        ("sb3:absent.zip", "cannot open absent.zip: No such file or directory"),
        ("sb3:text.zip", "text.zip is no model of Stable-Baselines3"),
    ],
)
def test_a_policy_that_fails_is_one_message(policy: str, message: str, capsys: Output) -> None:
    Path("rtamt_pilot.py").write_text("def act(obs):\n    return obs[7]\n")
    Path("text.zip").write_text("a model")
    assert main([*RUN, "--policy", policy]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith(f"rtamt: error: {message}")
    assert len(err.splitlines()) == 1


def test_substeps_sees_what_whole_steps_do_not(capsys: Output) -> None:
    Path("rtamt_pilot.py").write_text("def act(obs):\n    return [3.0]\n")
    arguments = ["run", "InvertedPendulum-v5", "--spec", "always(v < 1)", "--signal", "v=qvel[0]"]
    rows = []
    for more in ([], ["--substeps"]):
        assert main([*arguments, "--policy", "rtamt_pilot:act", *more]) == 0
        rows.append(capsys.readouterr().out.splitlines()[3].split())
    # The steps of the environment take 0.04 s, those of its simulation 0.02 s.
    assert rows[0][1:4] == ["2", "0.08", "s"]
    assert rows[1][1:4] == ["3", "0.06", "s"]


def test_substeps_of_an_environment_without_them_are_refused(capsys: Output) -> None:
    assert main([*RUN, "--substeps"]) == 2
    assert capsys.readouterr().err == (
        "rtamt: error: --substeps needs a MujocoEnv of Gymnasium or an environment of highway-env, "
        "got <Given<RtamtGiven-v0>>; leave it out\n"
    )


def test_a_signal_that_is_nan_is_refused_without_advice_that_is_not_there(capsys: Output) -> None:
    Path("rtamt_pilot.py").write_text("def act(obs):\n    return [float('nan')]\n")
    arguments = ["run", "Pendulum-v1", "--spec", "always(v < 99)", "--signal", "v=obs[2]"]
    assert main([*arguments, "--policy", "rtamt_pilot:act"]) == 2
    assert capsys.readouterr().err == "rtamt: error: variable 'v' is nan at sample 1\n"
