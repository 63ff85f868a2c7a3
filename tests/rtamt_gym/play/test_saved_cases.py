"""Saved cases: every kind of system runs again to the same bits, or has no name to save."""

import json
import math
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import named_systems
import pytest
import rtamt_envs  # noqa: F401 - registers the scenarios
from fmus import library, write_fmu
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from profiles import examples
from saved import Kind, check

import rtamt
from rtamt_gym import Case, Fmus, Parameter, Runner, Signal, Space, falsify
from rtamt_gym.results import SavedCase

DRIVE = [Signal("drive", -2, 2, points=3, interpolation="pchip"), Parameter("gain", 0, 2)]
KINDS: dict[str, Callable[[], Kind]] = {
    "a scenario": lambda: Kind(
        "rtamt/RequestGrant-v0", "granted", [Parameter("height", 2, 8), Parameter("limit", 1, 4)]
    ),
    "a scenario that is driven, one of several requirements": lambda: Kind(
        "rtamt/AutomaticTransmission-v0",
        ["AT2", "AT6a", "speed_low = always[0:2ms](speed < 0.1)"],
        [Signal("throttle", 0, 100, points=3), Signal("brake", 0, 325, points=2)],
        {"duration": 6.0, "align": "outward"},
    ),
    "an environment with arguments and a policy": lambda: Kind(
        gym.make("CartPole-v1", max_episode_steps=40, sutton_barto_reward=True),
        {"up": "always(abs(angle) < 0.1)", "left": "eventually(x < 0)"},
        [Parameter("env.gravity", 5, 25), Parameter("env.length", 0.2, 2)],
        {
            "signals": {"angle": "obs[2]", "x": "obs[0]", "u": ("action", 0.0)},
            "policy": named_systems.lean,
            "at_termination": "failure",
        },
    ),
    "an environment below a wrapper": lambda: Kind(
        named_systems.wrapped(),
        "always(abs(angle) < 0.1)",
        [Parameter("env.gravity", 5, 25)],
        {"signals": {"angle": "obs[2]"}, "policy": named_systems.lean, "at_termination": "cut"},
        {"system": "named_systems:wrapped"},
    ),
    "a model of MuJoCo": lambda: Kind(
        named_systems.pendulum(),
        "always(abs(angle) < 1.5)",
        [Parameter("qpos[0]", -2, 2), Signal("ctrl[0]", -1, 1, points=3)],
        {"signals": {"angle": "qpos[0]"}, "duration": 1.0},
        {"system": "named_systems:pendulum"},
    ),
    "a model of MuJoCo with a policy": lambda: Kind(
        named_systems.pendulum(),
        "always(abs(angle) < 1.5)",
        [Parameter("qpos[0]", -2, 2)],
        {"signals": {"angle": "qpos[0]"}, "duration": 1, "policy": named_systems.swing},
        {"system": "named_systems:pendulum"},
    ),
    "a function of time": lambda: Kind(
        named_systems.wave,
        "always(y < 1)",
        DRIVE,
        {"period": "100ms", "duration": 2.0} | {"signals": {"y": "x"}, "view": "step"},
    ),
    "a generator function": lambda: Kind(
        named_systems.pump,
        "output float x\nalways(x < 2)",
        [Parameter("inflow", 0, 1)],
        {"period": 1, "semantics": "output-robustness", "duration": math.inf},
    ),
}


@pytest.fixture(scope="module")
def tank(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("models")
    return write_fmu(folder / "tank.fmu", library(3, folder), 3)


def points(dimension: int = 6) -> st.SearchStrategy[list[float]]:
    return st.lists(st.floats(0, 1), min_size=dimension, max_size=dimension)


@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=examples(8), suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(coordinates=points(), seed=st.integers(0, 2**32))
def test_a_saved_case_runs_again_to_the_same_bits(
    kind: str, coordinates: list[float], seed: int, tmp_path: Path
) -> None:
    check(KINDS[kind](), coordinates, seed, tmp_path / "case.json")


@settings(max_examples=examples(5), suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(coordinates=points())
def test_fmus_are_found_beside_the_file(
    tank: Path, coordinates: list[float], tmp_path: Path
) -> None:
    system = Fmus(
        {"first": tank, "second": tank},
        inputs={"second.inflow": "first.level", "first.gear": 2},
        parameters={"first.area": 2.0},
        step=0.05,
    )
    space = [Signal("first.inflow", 0, 3, points=3), Parameter("second.drain", 0, 1)]
    options = {"duration": 2.0, "period": 0.1, "signals": {"x": "second.level"}}
    path = tmp_path / "case.json"
    check(Kind(system, "always(x < 1.5)", space, options), coordinates, 0, path)
    named = json.loads(path.read_text())["system"]["fmus"]
    assert (tmp_path / named["first"]).resolve() == tank.resolve()
    assert not Path(named["first"]).is_absolute()


@pytest.mark.parametrize("requirement", [["AT1", "AT6a"], "always(rpm < 9000)"])
def test_what_a_search_has_found_is_saved_as_it_is(requirement: Any, tmp_path: Path) -> None:  # noqa: ANN401
    result = falsify("rtamt/AutomaticTransmission-v0", requirement, budget=20, seed=3)
    result.save(tmp_path / "case.json")
    saved = SavedCase.load(tmp_path / "case.json")
    assert (saved.case, saved.seed) == (result.input, result.row.seed)
    assert saved.name == result.requirement
    run = saved.replay()
    assert saved.repeats(run)
    assert run.histories[saved.name].final == result.replay().histories[saved.name].final
    assert (run.histories[saved.name].verdict is rtamt.Verdict.VIOLATED) == result.falsified


def test_a_case_keeps_the_unit_of_bounds(tmp_path: Path) -> None:
    requirement = rtamt.parse("always[0:2000](x < 2)", unit="ms")
    result = falsify(
        named_systems.pump, requirement, [Parameter("inflow", 0, 1)], period=1, budget=5
    )
    result.save(tmp_path / "case.json")
    assert '"unit": "ms"' in (tmp_path / "case.json").read_text()
    saved = SavedCase.load(tmp_path / "case.json")
    assert saved.requirement.unit == "ms"
    assert saved.replay().histories[saved.name].final == result.robustness


def test_another_robustness_and_another_verdict_are_told_apart(tmp_path: Path) -> None:
    with Runner(named_systems.pump, "always(x < 2)", period=1, stop="violation") as runner:
        ((_, row),) = runner.run([{"inflow": 0.5}])
        saved = SavedCase.of(runner, "spec", row, tmp_path)
    kept = json.loads(saved.to_json())
    kept["versions"] |= {"python": "2.7", "numpy": "0.1", "other": "1"}
    kept["case"]["inflow"] = 0.49
    (tmp_path / "near.json").write_text(json.dumps(kept))
    near = SavedCase.load(tmp_path / "near.json")
    assert (near.gives(near.replay()), near.repeats(near.replay())) == (True, False)
    assert near.newer()["python"][0] == "2.7"
    assert set(near.newer()) == {"python", "numpy"}
    kept["case"]["inflow"] = 0.1
    (tmp_path / "far.json").write_text(json.dumps(kept))
    far = SavedCase.load(tmp_path / "far.json")
    assert (far.gives(far.replay()), far.repeats(far.replay())) == (False, False)
    assert near.case == Case({"inflow": 0.49})


def test_modules_are_found_beside_the_file_of_systems_and_of_policies(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = "def pump(inflow):\n    yield {'x': inflow}\n\ndef stay(obs):\n    return 0\n"
    requirement = "always(x < 2)"
    for module, kind in {
        "beside_one": Kind(named_systems.pump, requirement, [Parameter("inflow", 0, 1)]),
        "beside_two": Kind(
            gym.make("CartPole-v1"),
            requirement,
            [Parameter("env.gravity", 5, 25)],
            {"signals": {"x": "obs[0]"}, "policy": named_systems.lean, "at_termination": "cut"},
        ),
    }.items():
        monkeypatch.setattr(sys, "path", [*sys.path])
        (tmp_path / f"{module}.py").write_text(text)
        with Runner(kind.system, requirement, period=1, **kind.options) as runner:
            ((_, row),) = runner.run([Space([*kind.space]).case([0.5])])
            names = (
                {"policy": f"{module}:stay"} if runner.takes_seeds else {"system": f"{module}:pump"}
            )
            saved = SavedCase.of(runner, "spec", row, tmp_path, **names)
        saved.save(tmp_path / "case.json")
        assert SavedCase.load(tmp_path / "case.json").replay().case == row.case
        assert sys.modules[module].__file__ == str(tmp_path / f"{module}.py")
