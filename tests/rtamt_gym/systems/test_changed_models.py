"""Stored results of a changed model are errors: campaigns, cases and evaluations."""

import importlib
import importlib.metadata
import json
import shutil
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import mujoco  # type: ignore[import-untyped]
import pytest
from fmus import write_fmu

import rtamt
from rtamt import InputError
from rtamt_gym import Fmus, Parameter, compare, falsify, sweep
from rtamt_gym.__main__ import main
from rtamt_gym.play.campaign import Recipe
from rtamt_gym.play.runner import Runner
from rtamt_gym.results import Evaluation, Record, SavedCase
from rtamt_gym.results.provenance import Fingerprint
from rtamt_gym.systems.fingerprints import fingerprint_of
from rtamt_gym.systems.policies import Model

Output = pytest.CaptureFixture[str]

FILES = {
    "plant.py": """
import drain
import stations.pump
from importlib import import_module

class Policy:
    def __call__(self, obs):
        import steering
        return steering.act(obs)

def tank(inflow):
    level = 1.0
    for _ in range(9):
        yield {"level": level}
        level += stations.pump.GAIN * inflow - drain.RATE * level
    import_module("logs")
""",
    "drain.py": "RATE = 0.1\n",
    "steering.py": "def act(obs):\n    return int(obs[2] > 0)\n",
    "logs.py": "",
    "unrelated.py": "",
    "stations/__init__.py": "from . import valve\n",
    "stations/pump.py": "from .parts import gain\nGAIN = gain.GAIN\n",
    "stations/valve.py": "",
    "stations/parts/__init__.py": "",
    "stations/parts/gain.py": "from .. import valve\nGAIN = 1.0\n",
}
SWEEP = ["sweep", "plant:tank", "--requirement", "always(level < 2)", "--vary", "inflow=0.1:0.15"]
SWEEP += ["--samples", "4", "--period", "1", "--folder", "runs"]
SEARCH = ["falsify", "plant:tank", "always(level < 1.5)", "--vary", "inflow=0.1:0.3"]
SEARCH += ["--period", "1", "--budget", "9", "--folder", "search", "--save", "case.json"]
EVALUATE = ["evaluate", "CartPole-v1", "--policy", "plant:Policy", "--episodes", "4"]
EVALUATE += ["--spec", "always(abs(angle) < 0.1)", "--signal", "angle=obs[2]"]
EVALUATE += ["--at-termination", "failure", "--folder", "episodes", "--save", "old.json"]


@pytest.fixture(autouse=True)
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Return a project as the working directory; its modules are forgotten at the end."""
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    # An edit within a second keeps the time and may keep the length of a file.
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    for name in {Path(name).parts[0].removesuffix(".py") for name in FILES}:
        monkeypatch.delitem(sys.modules, name, raising=False)  # of another test's project
    before = set(sys.modules)
    yield tmp_path
    for name in set(sys.modules) - before:
        if str(tmp_path) in str(getattr(sys.modules[name], "__file__", "")):
            del sys.modules[name]


def contents(folder: str) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in Path(folder).iterdir()}


def refused(command: list[str], changes: str, folder: str, output: Output) -> None:
    """Check the error of a command, which does not change the folder."""
    before = contents(folder)
    assert main(command) == 2
    assert output.readouterr().err == (
        f"rtamt: error: {folder} holds results of another model or version: {changes}; give a new "
        "folder, or use them all the same with --accept-changed\n"
    )
    assert contents(folder) == before


@pytest.mark.parametrize(
    "name",
    [name for name in FILES if name not in {"unrelated.py", "steering.py"}] + ["steering.py"],
)
def test_an_edit_of_a_module_is_named(name: str, project: Path, capsys: Output) -> None:
    assert main(SWEEP) == 0
    assert "reused" not in capsys.readouterr().out
    (project / "unrelated.py").write_text("x = 1\n")
    assert main(SWEEP) == 0
    assert "\nreused 4 of 4 simulations from runs\n" in capsys.readouterr().out
    (project / name).write_text((project / name).read_text() + "# a comment\n")
    refused(SWEEP, f"{name} has changed", "runs", capsys)
    assert main([*SWEEP, "--accept-changed", "--json", "out.json"]) == 0
    mixed = "reused 4 of 4 simulations from runs\n4 simulations from before a change: "
    assert f"\n{mixed}{name} has changed\n" in capsys.readouterr().out
    stored = json.loads(Path("out.json").read_text())["reuse"]
    assert stored["mixtures"] == [{"count": 4, "changes": [f"{name} has changed"]}]
    assert main(SWEEP) == 0  # the change is accepted, and still stated
    assert mixed in capsys.readouterr().out
    if name == "drain.py":
        for source in ("runs", "out.json"):
            assert main(["report", source, "-o", "page.html"]) == 0
            assert "4 simulations from before a change: drain.py" in Path("page.html").read_text()


def test_a_search_and_its_case(project: Path, capsys: Output) -> None:
    assert main(SEARCH) == 1
    assert "reused" not in capsys.readouterr().out
    assert main(SEARCH) == 1
    assert "reused 2 of 2 simulations from search" in capsys.readouterr().out
    assert main(["replay", "case.json"]) == 0
    (project / "drain.py").write_text("RATE = 0.9\n")
    capsys.readouterr()
    refused(SEARCH, "drain.py has changed", "search", capsys)
    refused([*SEARCH, "-j", "2"], "drain.py has changed", "search", capsys)
    assert main(["replay", "case.json"]) == 2
    assert capsys.readouterr().err == (
        "rtamt: error: the case holds results of another model or version: drain.py has changed; "
        "save a new case, or use them all the same with --accept-changed\n"
    )
    with pytest.raises(InputError, match=r"drain.py has changed; .* accept_changed=True$"):
        SavedCase.load("case.json").replay()
    assert SavedCase.load("case.json").replay(accept_changed=True).steps
    assert main(["replay", "case.json", "--accept-changed"]) == 0
    assert "\nsince the case was saved: drain.py has changed\n" in capsys.readouterr().out
    assert main([*SEARCH, "--accept-changed"]) == 1
    assert "\n2 simulations from before a change: drain.py has changed\n" in capsys.readouterr().out


def test_a_case_is_not_saved_after_an_edit(project: Path) -> None:
    import plant  # type: ignore[import-not-found]

    result = falsify(plant.tank, "always(level < 1.5)", [Parameter("inflow", 0.1, 0.3)], period=1)
    (project / "drain.py").write_text("RATE = 0.2\n")
    with pytest.raises(InputError, match=r"drain.py has changed since the search; search again"):
        result.save("case.json")


def test_evaluations_and_comparisons(project: Path, capsys: Output) -> None:
    assert main(EVALUATE) == 0
    assert main(EVALUATE) == 0
    assert "\nreused 4 of 4 episodes from episodes\n" in capsys.readouterr().out
    (project / "steering.py").write_text("def act(obs):\n    return 0\n")
    refused(EVALUATE, "steering.py has changed", "episodes", capsys)
    new = [*EVALUATE[:-4], "--save", "new.json"]
    assert main(new) == 0
    # Policies may differ; their environments may not.
    assert main(["compare", "old.json", "new.json"]) == 0
    text = Path("new.json").read_text()
    kept = json.loads(text)
    kept["fingerprint"]["simulators"]["gymnasium"] = "0.1"
    Path("new.json").write_text(json.dumps(kept))
    capsys.readouterr()
    assert main(["compare", "old.json", "new.json"]) == 2
    assert "cannot compare: in B gymnasium is 0.1, was " in capsys.readouterr().err
    assert main(["compare", "old.json", "new.json", "--accept-changed"]) == 0
    assert "of B gymnasium is 0.1, was " in capsys.readouterr().out
    del kept["fingerprint"]
    Path("new.json").write_text(json.dumps(kept))
    (note,) = (
        note
        for note in compare(Evaluation.load("old.json"), Evaluation.load("new.json")).notes
        if "hashes" in note
    )
    assert note == "no hashes of B: a change of the environment cannot be seen"


def test_versions_of_packages(monkeypatch: pytest.MonkeyPatch, capsys: Output) -> None:
    assert main(EVALUATE) == 0
    version = importlib.metadata.version
    changed = {"numpy": "9.1"}
    monkeypatch.setattr(
        importlib.metadata, "version", lambda name: changed.get(name) or version(name)
    )
    monkeypatch.setattr("numpy.__version__", "9.1")
    capsys.readouterr()
    assert main(EVALUATE) == 0  # numpy simulates nothing
    assert "\nnote: numpy is 9.1, was " in capsys.readouterr().out
    changed["gymnasium"] = "9.2"
    then = version("gymnasium")
    refused(EVALUATE, f"gymnasium is 9.2, was {then}", "episodes", capsys)
    del changed["gymnasium"]
    monkeypatch.setattr(rtamt, "__version__", "9.3")
    assert main(EVALUATE) == 2
    assert "rtamt is 9.3, was " in capsys.readouterr().err


def test_results_without_hashes_are_used_with_a_note(capsys: Output) -> None:
    assert main(SWEEP) == 0
    campaign = Path("runs/campaign.json")
    kept = json.loads(campaign.read_text())
    del kept["fingerprint"], kept["mixtures"]
    campaign.write_text(json.dumps(kept))
    text = "4 simulations stored without hashes: a change of the model since cannot be"
    for _ in range(2):
        capsys.readouterr()
        assert main(SWEEP) == 0
        assert text in capsys.readouterr().out
    Path("drain.py").write_text("RATE = 0.2\n")
    refused(SWEEP, "drain.py has changed", "runs", capsys)
    assert main(SEARCH) == 1
    case = json.loads(Path("case.json").read_text())
    del case["fingerprint"]
    Path("case.json").write_text(json.dumps(case))
    assert main(["replay", "case.json"]) == 0
    assert "note: no hashes in the file" in capsys.readouterr().out


def test_a_folder_and_a_project_may_move(project: Path, capsys: Output) -> None:
    assert main(SWEEP) == 0
    shutil.move("runs", "moved")
    assert main([*SWEEP[:-1], "moved"]) == 0
    assert "reused 4 of 4 simulations from moved" in capsys.readouterr().out
    (project / "plant.py").rename("renamed.py")
    command = [item.replace("plant:", "renamed:") for item in [*SWEEP[:-1], "moved"]]
    refused(command, "plant.py is no longer used, renamed.py is new", "moved", capsys)


def test_workers_refuse_another_source(project: Path) -> None:
    import plant

    runner = Runner(plant.tank, "always(level < 2)", period=1)
    recipe = Recipe(runner, fingerprint=runner.fingerprint())
    assert list(recipe.runner().run([{"inflow": 0.1}]))
    (project / "drain.py").write_text("RATE = 0.2\n")
    with pytest.raises(InputError, match=r"^drain.py has changed since the run began, or on this"):
        recipe.runner()


def test_a_change_that_cannot_be_seen_is_stated() -> None:
    names: dict[str, Any] = {}
    exec("def typed(x):\n    yield {'x': x}\n", names)  # noqa: S102 - as at a prompt
    x = [Parameter("x", 0, 1)]
    run = partial(sweep, requirements="always(x < 2)", space=x, samples=2, period=1, folder="a")
    run(names["typed"])
    exec("def typed(x):\n    yield {'x': x + 9}\n", names)  # noqa: S102
    note = "note: a change of the function typed, whose source is not in a file cannot be seen"
    assert note in " ".join(str(run(names["typed"])).split())
    made = type("Made", (), {"__call__": names["typed"]})()
    unseen = fingerprint_of([made, eval("lambda t: t"), json.JSONEncoder]).unseen  # noqa: S307
    assert unseen == (
        "the function typed, whose source is not in a file",
        "the class Made, which was made at run time",
        "a lambda, whose source is not in a file",
    )


def test_an_edit_after_the_import_is_a_change(project: Path) -> None:
    import drain  # type: ignore[import-not-found]
    import plant

    then = fingerprint_of([plant.tank])
    (project / "drain.py").write_text("RATE = 0.2\n")  # the running code still has 0.1
    now = fingerprint_of([plant.tank])
    assert then.changes(now) == ["drain.py has changed"]
    assert now.values["RATE of drain.py"] == "0.1"
    text = (project / "plant.py").read_text().replace("range(9)", "range(8)")
    (project / "plant.py").write_text(text)
    importlib.reload(drain)
    stale = fingerprint_of([plant.tank])
    assert stale.contents["plant.py"].startswith("edited after process ")
    importlib.reload(plant)
    fresh = fingerprint_of([plant.tank])
    assert stale.changes(fresh) == ["plant.py has changed"]
    drain.RATE = 0.3
    assert fresh.changes(fingerprint_of([plant.tank])) == ["RATE of drain.py is new"]


def gain_plant(gain: Any, x: Any = 0.0) -> Iterator[dict[str, float]]:  # noqa: ANN401
    yield {"x": gain * x}


def test_a_list_that_a_function_holds_is_stated() -> None:
    gains = [1.0]

    def plant() -> Iterator[dict[str, float]]:
        yield {"x": gains[0]}

    then = fingerprint_of([plant])
    assert then.unseen == ("gains of plant, a list",)
    gains.append(2.0)  # as a list of calls grows
    assert then.changes(fingerprint_of([plant])) == []


def test_a_damaged_fingerprint_is_named() -> None:
    assert main(SWEEP) == 0
    path = Path("runs/campaign.json")
    kept = json.loads(path.read_text())
    for key, value in (
        ("fingerprint", 3),
        ("fingerprint", {"contents": 3}),
        ("fingerprint", {"contents": {"plant.py": 3}}),
        ("fingerprint", {"unseen": [3]}),
        ("mixtures", [{"count": 3}]),
    ):
        path.write_text(json.dumps({**kept, key: value}))
        with pytest.raises(InputError, match="expected a fingerprint and mixtures; give another"):
            Record.load("runs")


def test_files_that_arguments_name(project: Path) -> None:
    def fingerprint() -> Fingerprint:
        return fingerprint_of([partial(gain_plant, "gains.yaml", project / "log.csv")])

    (project / "gains.yaml").write_text("1")
    then = fingerprint()
    (project / "log.csv").write_text("0")  # as the run writes it
    assert then.changes(fingerprint()) == []
    (project / "gains.yaml").write_text("2")
    assert then.changes(fingerprint()) == ["gains.yaml has changed"]


def held(gain: float) -> Callable[[], Iterator[dict[str, float]]]:
    return lambda: gain_plant(gain)


@dataclass
class Gain:
    gain: float

    def __call__(self) -> Iterator[dict[str, float]]:
        return gain_plant(self.gain)


@pytest.mark.parametrize("make", [partial(partial, gain_plant), held, Gain])
def test_values_that_functions_hold(make: Callable[[float], object]) -> None:
    then, now = (fingerprint_of([make(gain)]) for gain in (2.0, 3.0))
    (change,) = then.changes(now)
    assert change.endswith("is 3.0, was 2.0")
    assert then.changes(fingerprint_of([make(2.0)])) == []
    assert "test_changed_models.py" in "".join(fingerprint_of([cache(make)]).contents)
    assert then.unseen == ()


MODEL = """
<mujoco model="robot"><compiler meshdir="meshes"/><include file="floor.xml"/>
  <asset>
    <mesh name="hull" file="hull.obj"/>
    <hfield name="hill" file="../hill.bin" size="1 1 1 1"/>
  </asset>
  <worldbody><body pos="0 0 2"><freejoint/><geom type="mesh" mesh="hull"/></body></worldbody>
</mujoco>
"""
HULL = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
WORLD = """
import mujoco  # type: ignore[import-untyped]
from pathlib import Path

def make():
    model = mujoco.MjModel.from_xml_path(str(Path(__file__).parent / "robot.xml"))
    return model, mujoco.MjData(model)

def drop(x):
    yield {"z": x}
"""


def write_model(folder: Path) -> None:
    (folder / "meshes").mkdir()
    (folder / "robot.xml").write_text(MODEL)
    (folder / "floor.xml").write_text("<mujoco><option timestep='0.01'/></mujoco>")
    (folder / "meshes" / "hull.obj").write_text(HULL)
    (folder / "hill.bin").write_bytes(bytes([2, 0, 0, 0, 2, 0, 0, 0]) + bytes(16))
    (folder / "world.py").write_text(WORLD)


@pytest.mark.parametrize(
    "name", ["robot.xml", "floor.xml", "meshes/hull.obj", "hill.bin", "world.py"]
)
def test_the_files_of_a_mujoco_model(name: str, project: Path, capsys: Output) -> None:
    write_model(project)
    command = ["sweep", "world:make", "--requirement", "always(z < 9)", "--signal", "z=qpos[2]"]
    command += ["--vary", "qpos[0]=0:1", "--samples", "2", "--duration", "0.1", "--folder", "runs"]
    assert main(command) == 0
    assert main(command) == 0
    assert "reused 2 of 2 simulations" in capsys.readouterr().out
    path = project / name
    if name == "hill.bin":
        path.write_bytes(path.read_bytes()[:-1] + bytes([1]))
    else:
        path.write_text(path.read_text() + "\n")
    before = contents("runs")
    assert main(command) == 2
    # The compiled model may have changed too.
    assert f"runs holds results of another model or version: {name} has changed" in (
        capsys.readouterr().err
    )
    assert contents("runs") == before


def test_a_compiled_model_is_known_by_its_content() -> None:
    def fingerprint(mass: float) -> Fingerprint:
        model = mujoco.MjModel.from_xml_string(
            "<mujoco model='m'><worldbody><body><geom size='1'/></body></worldbody></mujoco>"
        )
        model.body_mass[1] = mass
        return fingerprint_of([(model, mujoco.MjData(model))])

    assert fingerprint(1.0).changes(fingerprint(1.0)) == []
    (change,) = fingerprint(1.0).changes(fingerprint(2.0))
    assert change.startswith("the MuJoCo model m (its XML,")


def test_an_fmu_is_known_by_its_content(project: Path) -> None:
    path = write_fmu(project / "tank.fmu", None, 2)
    then = fingerprint_of([Fmus(path)])
    assert "fmpy" in then.simulators
    assert then.changes(fingerprint_of([Fmus(path, parameters={"area": 2.0})])) == [
        'parameters of tank is {"area": 2.0}, was None'
    ]
    shutil.copy(path, project / "stations" / "tank.fmu")
    assert then.changes(fingerprint_of([Fmus(project / "stations" / "tank.fmu")])) == []
    write_fmu(path, None, 2, step=0.2)
    assert then.changes(fingerprint_of([Fmus(path)])) == ["tank.fmu has changed"]


def test_the_file_of_a_policy(project: Path) -> None:
    class Net:
        def predict(self) -> None: ...

    path = project / "model.zip"
    path.write_bytes(b"1")
    then = fingerprint_of([], [Model(Net(), files=(path,))])
    assert "model.zip" in then.policy
    path.write_bytes(b"2")
    assert then.changes(fingerprint_of([], [Model(Net(), files=(path,))])) == [
        "model.zip has changed"
    ]
    # A module that loads it by its name, with or without the ending.
    (project / "pilot.py").write_text("NAME = 'model'\ndef act(obs):\n    return 0\n")
    import pilot  # type: ignore[import-not-found]

    then = fingerprint_of([], [pilot.act])
    path.write_bytes(b"3")
    assert then.changes(fingerprint_of([], [pilot.act])) == ["model.zip has changed"]


def test_records_read_their_fingerprint() -> None:
    assert main([*SWEEP, "--save", "record.parquet"]) == 0
    stored = Record.load("record.parquet").provenance
    assert stored.fingerprint is not None
    assert set(stored.fingerprint.contents) == set(FILES) - {"unrelated.py"}
    assert stored.reuse is not None
    assert Record.load("runs").provenance.fingerprint == stored.fingerprint
    with pytest.raises(InputError, match='expected "fingerprint" as hashes and versions, got 3'):
        Fingerprint.read(3)
