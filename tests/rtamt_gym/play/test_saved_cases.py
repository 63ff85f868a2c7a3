"""Saved cases: every kind of system runs again with the same bits, or has no name to save."""

from __future__ import annotations

import functools
import json
import math
import sys
from collections.abc import Callable
from importlib.machinery import ModuleSpec
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
from rtamt import RtamtError
from rtamt_gym import Case, Fmus, Parameter, Runner, Signal, Space, falsify
from rtamt_gym.results import SavedCase
from rtamt_gym.systems.registry import import_path, named_object, named_system, system_name

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


SPACE = [Parameter("inflow", 0, 1)]
NAMED = (
    '; write save(path, system="module:name"), which names an object of a module, or a function '
    "without arguments that makes the system"
)


def refusal(act: Any, *arguments: Any, **options: Any) -> str:  # noqa: ANN401
    with pytest.raises(RtamtError) as raised:
        act(*arguments, **options)
    return ": ".join([*getattr(raised.value, "__notes__", []), str(raised.value)])


def test_what_cannot_be_imported_is_refused_with_the_way_out(tmp_path: Path) -> None:
    def local(inflow: float) -> Any:  # noqa: ANN401
        return named_systems.pump(inflow)

    path = tmp_path / "case.json"
    here = "test_what_cannot_be_imported_is_refused_with_the_way_out.<locals>.local"
    stretched = functools.partial(named_systems.pump, leak=0.2)
    env = gym.make("CartPole-v1")
    env.unwrapped.spec = None
    assert [
        refusal(system_name, system, tmp_path)
        for system in (local, stretched, named_systems.pendulum(), named_systems.wrapped(), env)
    ] == [
        f"cannot save a case of {here}, which no other program can import{NAMED}",
        f"cannot save a case of a partial, which no other program can import{NAMED}",
        f"cannot save a case of a pair (model, data), which no other program can import{NAMED}",
        f"cannot save a case of CartPole-v1 below the wrapper 'TimeAwareObservation'{NAMED}",
        f"cannot save a case of CartPoleEnv, which was not made by gymnasium.make{NAMED}",
    ]
    result = falsify(named_systems.pump, "always(x < 2)", SPACE, period=1, budget=5)
    assert refusal(result.save, tmp_path / "case.txt") == (
        f"cannot write {tmp_path}/case.txt: expected a name that ends in .json"
    )
    assert not path.exists()


def test_functions_among_signals_and_policies_are_refused(tmp_path: Path) -> None:
    env = gym.make("CartPole-v1")
    cart: dict[str, Any] = {
        "signals": {"angle": lambda step: float(step.obs[2])},
        "policy": lambda _obs: 0,
    }
    space = [Parameter("env.gravity", 5, 25)]
    result = falsify(env, "always(angle < 9)", space, budget=2, at_termination="cut", **cart)
    assert refusal(result.save, tmp_path / "case.json") == (
        "cannot save a case: signal 'angle' is a function; use a selector, such as "
        "signals={'angle': 'obs[0]'}, or an environment that has the signal in its info"
    )
    cart["signals"] = {"angle": "obs[2]"}
    result = falsify(env, "always(angle < 9)", space, budget=2, at_termination="cut", **cart)
    what = "test_functions_among_signals_and_policies_are_refused.<locals>.<lambda>"
    assert refusal(result.save, tmp_path / "case.json") == (
        f"cannot save a case with the policy {what}, which no other program can import; write "
        'save(path, policy="module:function"), or policy="sb3:FILE.zip" or "zero"'
    )
    result.save(tmp_path / "case.json", policy="zero")
    saved = SavedCase.load(tmp_path / "case.json")
    assert saved.repeats(saved.replay())


def test_arguments_that_json_cannot_hold_are_refused(tmp_path: Path) -> None:
    fmus = Fmus.__new__(Fmus)  # its arguments are all that is read
    fmus.name, fmus.paths = "tank", {}
    fmus.arguments = {"inputs": {"inflow": print}, "step": None}
    assert refusal(system_name, fmus, tmp_path) == (
        "cannot save a case of tank: JSON cannot hold its argument inputs={'inflow': "
        f"<built-in function print>}}{NAMED}"
    )


def test_the_program_itself_is_named_by_its_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import __main__

    def drain() -> None: ...

    drain.__module__, drain.__qualname__ = "__main__", "drain"
    monkeypatch.setattr(__main__, "drain", drain, raising=False)
    monkeypatch.setattr(__main__, "__spec__", None)
    monkeypatch.setattr(__main__, "__file__", "/home/me/tanks.py", raising=False)
    assert import_path(drain) == "tanks:drain"
    env_id = "rtamt_tests/Mine-v0"

    def made() -> Any:  # noqa: ANN401
        return gym.make("CartPole-v1").unwrapped

    made.__module__ = "__main__"
    gym.register(env_id, made)  # type: ignore[arg-type]  # it takes no arguments
    env = gym.make(env_id)
    try:
        assert system_name(env, tmp_path) == {"environment": f"tanks:{env_id}"}
    finally:
        del gym.registry[env_id]
    monkeypatch.delattr(__main__, "__file__")
    assert import_path(drain) is None
    monkeypatch.setattr(__main__, "__spec__", ModuleSpec("plants.tanks", None))  # python -m
    assert import_path(drain) == "plants.tanks:drain"


def test_names_of_no_systems_are_refused(tmp_path: Path) -> None:
    assert [refusal(named_system, name, tmp_path) for name in ({}, {"object": 3})] == [
        "expected a system as {'environment': 'CartPole-v1'}, {'object': 'module:name'} or "
        f"{{'fmus': {{'plant': 'plant.fmu'}}}}, got {name}"
        for name in ({}, {"object": 3})
    ]
    assert named_object("builtins:dict") is dict  # its arguments are not known
    assert refusal(named_object, "named_systems") == ("expected module:name, got 'named_systems'")
    assert refusal(named_object, "named_systems:pumb") == (
        "the module named_systems has no 'pumb'; did you mean 'pump'?"
    )


def test_files_that_hold_no_case_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "case.json"
    falsify(named_systems.pump, "always(x < 2)", SPACE, period=1, budget=5).save(path)
    kept = json.loads(path.read_text())

    def read(text: str) -> str:
        path.write_text(text)
        return refusal(SavedCase.load, path).replace(str(path), "case.json")

    def with_(**changes: Any) -> str:  # noqa: ANN401
        return read(json.dumps(kept | changes))

    no_case = (
        "case.json holds no case: expected a file that rtamt falsify --save and Falsification.save "
        "write"
    )
    assert read("[]") == read("{}") == with_(format="rtamt dream") == no_case
    assert read("{") == (
        f"{no_case}, got no JSON: Expecting property name enclosed in double "
        "quotes: line 1 column 2 (char 1)"
    )
    assert read('{"a": NaN}') == (
        f'{no_case}, got no JSON: NaN, which strict JSON does not have; write "inf" or "-inf"'
    )
    expected = kept["expected"]
    assert [
        with_(sed=1).partition("got ")[2],
        read(json.dumps({key: value for key, value in kept.items() if key != "seed"}))[:40],
        with_(expected=expected | {"verdict": "BROKEN"}),
        with_(expected=expected | {"robustness": "high"}),
        with_(requirement={"name": "a", "text": "a = always(x < 1); b = always(x > 2)"}),
        with_(reading={"viev": "step"}),
        with_(case={"x": "y"}),
        with_(requirement="always(x < 1)"),
    ] == [
        "'sed'; did you mean 'seed'?",
        "case.json: expected a case with 'seed', ",
        (
            "case.json: expected \"verdict\" among 'VIOLATED', 'UNDECIDED', 'SATISFIED', got "
            "'BROKEN'"
        ),
        "case.json: expected \"robustness\" as a number, got 'high'",
        "case.json: expected the \"text\" of one requirement, got 2: 'a', 'b'",
        (
            "case.json: expected \"reading\" with 'view', 'nan', 'align', 'semantics', 'inputs', "
            "'outputs', 'at_termination', 'at_truncation', 'stages', 'below', 'rescaled', "
            "'substeps', got 'viev'; did you mean 'view'?"
        ),
        (
            "case.json: expected 'x' of a case as a number or a waveform such as "
            "Waveform([0, 5], [1, 2]), got 'y'"
        ),
        "case.json: expected \"requirement\" as an object of JSON, got 'always(x < 1)'",
    ]


@pytest.mark.parametrize(
    ("key", "values", "expected"),
    [
        ("system", [None, []], "an object of JSON"),
        ("seed", [-1, 1.5, True, "7", [7]], "a whole number, 0 or more, or null"),
        ("signals", [["obs[0]"], "obs[0]"], "an object of JSON or null"),
        ("policy", [["zero"], 3], "text or null"),
        ("versions", [None, ["3.11"]], "an object of JSON"),
        ("duration", [[10], {}, "long", True], "a number"),
    ],
)
def test_fields_of_other_types_are_refused_when_the_file_is_read(
    tmp_path: Path, key: str, values: list[Any], expected: str
) -> None:
    path = tmp_path / "case.json"
    falsify(named_systems.pump, "always(x < 2)", SPACE, period=1, budget=5).save(path)
    kept = json.loads(path.read_text())
    for value in values:
        path.write_text(json.dumps(kept | {key: value}))
        assert (
            refusal(SavedCase.load, path)
            == f'{path}: expected "{key}" as {expected}, got {value!r}'
        )


def test_lists_without_end_hold_no_case(tmp_path: Path) -> None:
    path = tmp_path / "case.json"
    path.write_text("[" * 100_000)
    assert refusal(SavedCase.load, path).startswith(f"{path} holds no case: expected a file that ")
