"""`rtamt envs`: every printed selector can be read, and has the printed value."""

from __future__ import annotations

import importlib.util
import math
import re
import shlex
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from catalogue import entries
from gymnasium import spaces
from gymnasium.envs.registration import EnvSpec
from rtamt_envs import scenario_of

from rtamt_gym import simulate
from rtamt_gym.__main__ import main
from rtamt_gym.systems import registry as environments
from rtamt_gym.systems.registry import make
from rtamt_gym.tables import number

Output = pytest.CaptureFixture[str]


class Rich(gym.Env[Any, Any]):
    """An environment with numbers of every kind, at every depth."""

    observation_space = spaces.Dict(
        {
            "arm": spaces.Box(-9, 9, (2, 2), np.float64),
            "lamp": spaces.Discrete(3, start=5),
            "name": spaces.Text(8, charset="ab"),
            "pair": spaces.Tuple((spaces.MultiBinary(2), spaces.MultiDiscrete([3, 4]))),
        }
    )
    action_space = spaces.Discrete(4)
    control_timestep = 0.25

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed, options=options)
        self.count = 0
        return self._obs(), {"level": 7.5}

    def step(self, action: int) -> tuple[Any, float, bool, bool, dict[str, Any]]:  # noqa: ARG002
        self.count += 1
        info = {
            "level": 8.0,
            "late": True,
            "words": "none",
            "nested": {"deep": [1, (2.5, "x")], "it's": 3},
            "row": np.arange(3, dtype=np.float32),
            "none": None,
        }
        return self._obs(), 0.5, False, False, info

    def _obs(self) -> dict[str, Any]:
        pair = (np.array([0, 1], np.int8), np.array([2, self.count]))
        return {"arm": np.arange(4.0).reshape(2, 2), "lamp": 6, "name": "a", "pair": pair}


class Wide(Rich):
    """An environment with a given count of numbers."""

    def __init__(self, **options: int) -> None:
        self.observation_space = spaces.Box(0, 1, (options["n"],), np.float64)  # type: ignore[assignment]

    def _obs(self) -> Any:  # noqa: ANN401
        return np.zeros(self.observation_space.shape or ())


class Driven:
    """A vehicle with a property that exists only with a lane."""

    speed = 25.0
    lane = None
    weight = 900

    @property
    def offset(self) -> float:
        raise AttributeError(self.lane)

    @property
    def angle(self) -> float:
        return 1.0 / (self.weight - 900)


class Road(Rich):
    """An environment of a vehicle."""

    vehicle = Driven()


@pytest.fixture(autouse=True)
def _registered() -> Iterator[None]:
    gym.register("RtamtRich-v0", lambda **_: Rich(), max_episode_steps=9)
    gym.register("RtamtWide-v0", Wide)
    gym.register("RtamtRoad-v0", lambda **_: Road())
    yield
    for name in ("Rich", "Wide", "Road"):
        del gym.registry[f"Rtamt{name}-v0"]


def printed(capsys: Output, *arguments: str) -> tuple[list[str], list[list[str]]]:
    """Return the lines above the table, and its rows."""
    assert main(["envs", *arguments]) == 0
    lines = capsys.readouterr().out.splitlines()
    begin = next(i for i, line in enumerate(lines) if line.startswith("selector"))
    end = lines.index("", begin) if "" in lines[begin:] else len(lines)
    return lines[: begin - 1], [re.split(r" {2,}", line) for line in lines[begin + 1 : end]]


def test_numbers_of_every_kind_are_found_at_every_depth(capsys: Output) -> None:
    assert main(["envs", "RtamtRich-v0"]) == 0
    assert capsys.readouterr().out == (
        "RtamtRich-v0: a step lasts 0.25 s, says env.unwrapped.control_timestep\n"
        "an episode has at most 9 steps\n"
        "obs: Dict('arm': Box(shape=(2, 2), dtype=float64), 'lamp': Discrete(3, start=5),\n"
        "  'name': Text(1, 8, charset=ab), 'pair': Tuple(MultiBinary(2), MultiDiscrete([3\n"
        "  4])))\n"
        "action: Discrete(4)\n"
        "\n"
        "selector                      at reset  after a step\n"
        "obs['arm'][0][0]                     0             0\n"
        "obs['arm'][0][1]                     1             1\n"
        "obs['arm'][1][0]                     2             2\n"
        "obs['arm'][1][1]                     3             3\n"
        "obs['lamp']                          6             6\n"
        "obs['pair'][0][0]                    0             0\n"
        "... 3 more, to obs['pair'][1][1]\n"
        "action                               -             3\n"
        "reward                               -           0.5\n"
        "info['level']                      7.5             8\n"
        "info['late']                         -             1\n"
        "info['nested']['deep'][0]            -             1\n"
        "info['nested']['deep'][1][0]         -           2.5\n"
        "info['row'][0]                       -             0\n"
        "info['row'][1]                       -             1\n"
        "info['row'][2]                       -             2\n"
        "\n"
        '-: no value at reset; set one with --signal "u=action,VALUE"\n'
        "\n"
        "3 more with --all\n"
    )


@pytest.mark.parametrize(
    "env_id",
    ["RtamtRich-v0", "CartPole-v1", "Hopper-v5", "parking-v0", "highway-fast-v0", "Blackjack-v1"],
)
def test_every_selector_reads_what_is_printed(env_id: str, capsys: Output) -> None:
    _, rows = printed(capsys, env_id, "--all", "--seed", "3")
    env = make(env_id)
    space = env.action_space
    space.seed(3)
    signals: dict[str, Any] = {}
    for selector, at_reset, _ in rows:
        needs = selector.startswith(("action", "reward", "info"))
        default = 0.0 if at_reset == "-" else float(at_reset)
        signals[selector] = (selector, default) if needs else selector
    period = run_period(env)
    run = simulate(
        env,
        "always(reward < 1e9)",
        {"reward": ("reward", 0.0)} | signals,
        policy=lambda _obs: space.sample(),
        seed=3,
        period=period,
        duration=1.5 * float(period),
        stop="end",
    )
    assert len(rows) == len(signals) == len(run.signals)
    for selector, at_reset, after in rows:
        values = run.signals[selector]
        # highway-env draws the action at a reset, without the seed.
        if not selector.startswith("info['action']"):
            assert at_reset in {"-", number(values[0])}, selector
        assert after == number(values[1]), selector


def run_period(env: gym.Env[Any, Any]) -> float:
    simulation: Any = env.unwrapped
    if hasattr(simulation, "config"):
        return 1 / float(simulation.config["policy_frequency"])
    names = "control_timestep", "dt", "tau"
    return next(
        (float(getattr(simulation, name)) for name in names if hasattr(simulation, name)), 1.0
    )


@pytest.mark.parametrize(
    ("env_id", "lines"),
    [
        (
            "CartPole-v1",
            [
                "CartPole-v1: a step lasts 0.02 s, says env.unwrapped.tau",
                "an episode has at most 500 steps",
                "obs: Box(shape=(4,), dtype=float32)",
                "action: Discrete(2)",
            ],
        ),
        (
            "Hopper-v5",
            [
                "Hopper-v5: a step lasts 0.008 s, says env.unwrapped.dt",
                "a step of its simulation, which --substeps samples, lasts 0.002 s",
                "an episode has at most 1000 steps",
                "obs: Box(shape=(11,), dtype=float64)",
                "action: Box(shape=(3,), dtype=float32)",
            ],
        ),
        (
            "Blackjack-v1",
            [
                "Blackjack-v1 does not state the duration of a step;",
                "for bounds in time give --period in seconds, or --period 1 if bounds count steps",
                "obs: Tuple(Discrete(32), Discrete(11), Discrete(2))",
                "action: Discrete(2)",
            ],
        ),
    ],
)
def test_the_length_of_a_step_is_told_with_what_says_it(
    env_id: str, lines: list[str], capsys: Output
) -> None:
    assert printed(capsys, env_id)[0] == lines


class Stepped(Rich):
    """An environment that states given times."""

    def __init__(self, **times: Any) -> None:  # noqa: ANN401
        vars(self).update({"control_timestep": None} | times)


@pytest.mark.parametrize(
    ("times", "lines"),
    [
        (
            ["dt=0.01"],
            [
                "RtamtStepped-v0: a step lasts 0.01 s, says env.unwrapped.dt",
                "nothing verifies that: it may be the time of a physics step, of which an action",
                "  takes several; for bounds in time give --period in seconds",
            ],
        ),
        (
            ["dt=0.01", "control_hz=10"],
            ["RtamtStepped-v0: a step lasts 0.1 s, says env.unwrapped.control_hz"],
        ),
        (
            ["dt=0.1", "tau=0.02"],
            [
                "RtamtStepped-v0 does not state the duration of a step;",
                "dt (0.1 s) and tau (0.02 s) are different times of a step;",
                "for bounds in time give --period in seconds, or --period 1 if bounds count steps",
            ],
        ),
    ],
)
def test_unverified_and_contradicting_times(
    times: list[str], lines: list[str], capsys: Output
) -> None:
    gym.register("RtamtStepped-v0", Stepped)
    try:
        options = [part for each in times for part in ("--env-kwarg", each)]
        shown, _ = printed(capsys, "RtamtStepped-v0", *options)
    finally:
        del gym.registry["RtamtStepped-v0"]
    assert shown[: len(lines)] == lines
    assert shown[len(lines)].startswith("obs: ")


def test_arguments_of_the_environment_change_what_it_offers(capsys: Output) -> None:
    lines, rows = printed(capsys, "Hopper-v5", "--env-kwarg", "frame_skip=2")
    assert lines[0] == "Hopper-v5: a step lasts 0.004 s, says env.unwrapped.dt"
    assert ["body:torso.xpos[2]"] in [row[:1] for row in rows]
    exclude = "exclude_current_positions_from_observation=false"
    _, more = printed(capsys, "Hopper-v5", "--env-kwarg", exclude)
    assert ["... 6 more, to obs[11]"] in more


@pytest.mark.parametrize("n", [1, 8, 9, 300])
def test_a_long_space_is_cut_and_counted(n: int, capsys: Output) -> None:
    _, rows = printed(capsys, "RtamtWide-v0", "--env-kwarg", f"n={n}")
    shown = [row[0] for row in rows if "obs" in row[0]]
    if n <= 8:
        assert shown == [f"obs[{i}]" for i in range(n)]
    else:
        assert shown == [*(f"obs[{i}]" for i in range(6)), f"... {n - 6} more, to obs[{n - 1}]"]
    _, rows = printed(capsys, "RtamtWide-v0", "--env-kwarg", f"n={n}", "--all")
    assert [row[0] for row in rows if "obs" in row[0]] == [f"obs[{i}]" for i in range(n)]


@pytest.mark.slow(keep=4)
@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["Humanoid-v5"],
        ["parking-v0"],
        ["intersection-multi-agent-v2"],
        ["rtamt/AutomaticTransmission-v0"],
    ],
)
def test_it_fits_80_columns(arguments: list[str], capsys: Output) -> None:
    assert main(["envs", *arguments]) == 0
    assert max(map(len, capsys.readouterr().out.splitlines())) <= 80


def test_what_a_scenario_declares_is_printed(capsys: Output) -> None:
    assert main(["envs", "rtamt/AutomaticTransmission-v0"]) == 0
    out = capsys.readouterr().out
    declared = scenario_of("AutomaticTransmission")
    assert out.startswith(f"{declared.title}\nsource: ")
    words = " ".join(out.split())
    assert declared.source in words
    for name, requirement in declared.specifications.items():
        assert f"{name} = {requirement.formula}" in words
    rows = [line.split() for line in out.splitlines()]
    assert ["action[1]", "brake", "lb", "ft", "0", "325"] in rows
    for parameter in declared.parameters:
        assert [parameter.name] in [row[:1] for row in rows]


def test_without_an_id_the_newest_environments_are_listed_by_where_they_come_from(
    capsys: Output,
) -> None:
    assert main(["envs"]) == 0
    lines = capsys.readouterr().out.splitlines()
    below = dict(pairwise(lines))
    assert below["classic_control"] == (
        "  Acrobot-v1, CartPole-v1, MountainCar-v0, MountainCarContinuous-v0, Pendulum-v1"
    )
    assert {"mujoco", "highway_env", "toy_text", "others"} <= set(lines)
    listed = {name.strip() for line in lines for name in line.split(",")}
    assert {"Hopper-v5", "parking-v0", "RtamtWide-v0"} <= listed
    assert "Hopper-v4" not in listed


@pytest.mark.parametrize(("arguments", "message"), entries(Path(__file__).with_name("envs.txt")))
def test_bad_input_is_one_message(arguments: str, message: str, capsys: Output) -> None:
    assert main(["envs", *shlex.split(arguments)]) == 2
    assert capsys.readouterr() == ("", f"rtamt: error: {message}\n")


def test_the_extra_of_an_unknown_environment_is_named(
    monkeypatch: pytest.MonkeyPatch, capsys: Output
) -> None:
    found = importlib.util.find_spec
    monkeypatch.setattr(
        environments, "find_spec", lambda name: None if name == "highway_env" else found(name)
    )
    assert main(["envs", "Quixotic-v0"]) == 2
    assert capsys.readouterr().err == (
        "rtamt: error: cannot make Quixotic-v0: Environment `Quixotic` doesn't exist; the "
        "environments of highway-env need pip install '.[highway]'\n"
    )


def test_an_error_of_an_environment_that_was_given_nothing_is_its_own(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def fail() -> None:
        raise OSError("no display")

    monkeypatch.setitem(gym.registry, "Dark-v0", EnvSpec("Dark-v0", fail))  # type: ignore[arg-type]  # makes none
    with pytest.raises(OSError, match="no display"):
        environments.make("Dark-v0")


def test_an_infinite_value_is_printed(monkeypatch: pytest.MonkeyPatch, capsys: Output) -> None:
    monkeypatch.setattr(Wide, "_obs", lambda _self: np.array([math.inf]))
    _, rows = printed(capsys, "RtamtWide-v0", "--env-kwarg", "n=1")
    assert rows[0] == ["obs[0]", "inf", "inf"]


def test_a_reward_that_is_no_number_is_left_out(
    monkeypatch: pytest.MonkeyPatch, capsys: Output
) -> None:
    monkeypatch.setattr(Wide, "step", lambda self, _action: (self._obs(), (1, 2), False, False, {}))
    _, rows = printed(capsys, "RtamtWide-v0", "--env-kwarg", "n=2")
    assert [row[0] for row in rows] == ["obs[0]", "obs[1]", "action", "info['level']"]


def test_what_a_vehicle_cannot_tell_yet_is_left_out(capsys: Output) -> None:
    _, rows = printed(capsys, "RtamtRoad-v0", "--all")
    found = {row[0]: row[1:] for row in rows if row[0].startswith("vehicle")}
    assert found == {"vehicle.speed": ["25", "25"], "vehicle.weight": ["900", "900"]}
