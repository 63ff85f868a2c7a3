"""FMUs under specifications: their results, their connections, and errors."""

import copy
import math
import pickle
import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException  # type: ignore[import-untyped]
from fmus import library, write_fmu

import rtamt
from rtamt import EpisodeMonitor, InputError, InputTypeError, RtamtError, StateError
from rtamt.export.fmu import export_fmu
from rtamt_gym import Fmus, simulate
from rtamt_gym.systems.fmi_instance import Instance

LOW = "always(level < 9)"


@pytest.fixture(scope="module", params=[2, 3])
def version(request: pytest.FixtureRequest) -> int:
    return int(request.param)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, version: int) -> Path:
    """Return FMUs of one version of FMI; those of the errors are broken."""
    folder = tmp_path_factory.mktemp(f"fmi{version}")
    tank = library(version, folder)
    write_fmu(folder / "tank.fmu", tank, version)
    write_fmu(folder / "second.fmu", tank, version)
    write_fmu(folder / "silent.fmu", tank, version, step=None)
    write_fmu(folder / "other.fmu", None, version)
    return folder


def levels(
    steps: int, inflow: Callable[[int], float], *, area: float = 1.0, drain: float = 0.5
) -> list[float]:
    """Return the levels by the definition of the tank."""
    result = [1.0]
    for i in range(steps):
        result.append(result[-1] + 0.1 * (inflow(i) - drain * result[-1]) / area)
    return result


def test_an_fmu_computes_what_its_model_does(folder: Path) -> None:
    system = Fmus(folder / "tank.fmu", inputs={"inflow": lambda t: 2 * t}, parameters={"area": 0.5})
    run = simulate(system, "always(level < 9 and full < 2 and count < 99)", duration=3)
    assert run.signals["level"].tolist() == levels(30, lambda i: 2 * (i / 10), area=0.5)
    assert run.signals["full"].tolist() == [x > 2 for x in run.signals["level"]]
    assert run.signals["count"].tolist() == list(range(31))
    assert (run.system, run.ended, float(run.period or 0)) == ("tank", "duration", 0.1)


def test_every_type_of_number_is_read_and_set(folder: Path, version: int) -> None:
    system = Fmus(
        folder / "tank.fmu",
        inputs={"inflow": 1.5, "gear": 2},
        parameters={"level": 3.0, "drain": 0.0},
    )
    spec = "always(level + count + full + gear + doubled" + " + half" * (version == 3) + " < 99)"
    run = simulate(system, spec, duration=0.2)
    assert {name: values[1] for name, values in run.signals.items()} == {
        "level": 3.0 + 0.1 * 3.0,
        "count": 1.0,
        "full": 1.0,
        "gear": 2.0,
        "doubled": 3.0,
    } | ({"half": float(np.float32(3.3 / 2))} if version == 3 else {})


def test_connected_fmus_exchange_values_at_every_communication_point(folder: Path) -> None:
    tank, second = folder / "tank.fmu", folder / "second.fmu"
    wires = {"second.inflow": "tank.level", "tank.inflow": "second.level"}
    spec = "always(tank.level < 9 and second.level < 9 and second.doubled > 0)"
    for fmus in ([tank, second], [second, tank]):
        run = simulate(Fmus(fmus, inputs=wires, parameters={"second.area": 0.5}), spec, duration=2)
        a, b = [1.0], [1.0]
        for _ in range(20):
            a_next = a[-1] + 0.1 * (b[-1] - 0.5 * a[-1]) / 1.0
            b.append(b[-1] + 0.1 * (a[-1] - 0.5 * b[-1]) / 0.5)
            a.append(a_next)
        assert run.signals["tank.level"].tolist() == a
        assert run.signals["second.level"].tolist() == b
        # An output without a step belongs to the inputs at the same time.
        assert run.signals["second.doubled"].tolist() == [2 * x for x in a]


def test_a_value_is_handed_on_through_all_fmus_before_the_first_step(folder: Path) -> None:
    tank = folder / "tank.fmu"
    wires: dict[str, str | float] = {"b.inflow": "a.doubled", "c.inflow": "b.doubled"}
    wires["a.inflow"] = 1.0
    system = Fmus(dict.fromkeys("cba", tank), inputs=wires)
    run = simulate(system, "always(c.doubled < 99)", duration=0.1)
    assert run.signals["c.doubled"].tolist() == [8.0, 8.0]


def test_the_communication_step_divides_the_period(folder: Path) -> None:
    def run(**arguments: Any) -> list[float]:  # noqa: ANN401
        period = arguments.pop("period", None)
        system = Fmus(folder / "tank.fmu", inputs={"inflow": lambda t: t}, **arguments)
        done = simulate(system, LOW, duration=2, period=period)
        return list(done.signals["level"].tolist())

    assert run(step=0.05, period=0.1) == run(step=0.05)[::2]
    assert run(period="200ms") != run()[::2] == run(step=0.1, period="200ms")


def test_an_fmu_is_run_again_from_its_start(folder: Path) -> None:
    system = Fmus(folder / "tank.fmu", inputs={"inflow": 1.0})
    first = simulate(system, LOW, duration=1)
    assert simulate(system, LOW, duration=1) == first
    for twin in (copy.deepcopy(system), pickle.loads(pickle.dumps(system))):
        assert simulate(twin, LOW, duration=1) == first
    ((offline),) = first.replay().values()
    assert offline[0] == first.histories["spec"].final


def test_an_fmu_that_ends_has_a_complete_trace(folder: Path) -> None:
    system = Fmus(folder / "tank.fmu", parameters={"ends_at": 0.55})
    run = simulate(system, LOW, duration=2)
    assert (run.ended, run.steps, run.verdict) == ("terminated", 5, rtamt.Verdict.SATISFIED)


def test_a_violation_stops_the_fmus(folder: Path) -> None:
    run = simulate(Fmus(folder / "tank.fmu"), "always(level > 0.75)", duration=9)
    assert (run.ended, run.steps) == ("violation", 6)


def test_an_fmu_that_fails_says_when_and_why(folder: Path, version: int) -> None:
    system = Fmus(folder / "tank.fmu", parameters={"fails_at": 0.55})
    with pytest.raises(StateError) as refused:
        simulate(system, LOW, duration=2)
    assert str(refused.value) == (
        f"FMU 'tank' failed at 0.5 s: fmi{version}DoStep failed with status 3 (error). "
        "Its last messages: the tank has burst"
    )
    assert simulate(system, LOW, duration=0.5).steps == 5


def test_fmus_that_were_loaded_are_freed_when_the_next_is_not(folder: Path) -> None:
    system = Fmus([folder / "tank.fmu", folder / "other.fmu"])
    for _ in range(2):
        with pytest.raises(InputError, match="cannot load the FMU 'other': "):
            simulate(system, "always(tank.level < 9)", duration=1)


def test_names_that_formulas_cannot_have_are_read_by_signals(folder: Path) -> None:
    run = simulate(
        Fmus({"tank 1": folder / "tank.fmu"}), LOW, {"level": "tank 1.level"}, duration=1
    )
    assert run.signals["level"].tolist() == levels(10, lambda _: 0.0)


@pytest.mark.parametrize(
    ("fmus", "named", "error", "message"),
    [
        (
            "tank",
            {"inputs": {"inflw": 1}},
            InputError,
            "no variable 'inflw' in tank; did you mean 'inflow'?",
        ),
        (
            "tank",
            {"inputs": {"level": 1}},
            InputError,
            (
                "expected an input, got 'level', which is of causality 'output'; "
                "the inputs are 'tank.inflow', 'tank.gear'"
            ),
        ),
        (
            "tank",
            {"inputs": {"inflow": "levl"}},
            InputError,
            "no variable 'levl' in tank; did you mean 'level'?",
        ),
        (
            "tank",
            {"inputs": {"inflow": "maker"}},
            InputError,
            "'maker' is a String, expected a number",
        ),
        (
            "tank",
            {"inputs": {"inflow": None}},
            InputTypeError,
            (
                "input 'tank.inflow': expected the name of a variable, a number or a function of "
                "time, got None"
            ),
        ),
        (
            "tank",
            {"inputs": {"gear": 1.5}},
            InputError,
            "expected a whole number for 'tank.gear', a Int",
        ),
        (
            "tank",
            {"inputs": {"gear": "level"}},
            InputError,
            "input 'tank.gear' takes whole numbers, and 'tank.level' is a ",
        ),
        (
            "tank",
            {"parameters": {"inflow": 1}},
            InputError,
            "'inflow' is an input: give it in inputs=",
        ),
        (
            "tank",
            {"parameters": {"doubled": 1}},
            InputError,
            (
                "expected a variable with a start value, got 'doubled', which is of causality "
                "'output' and calculated"
            ),
        ),
        (
            "tank",
            {"parameters": {"area": "1"}},
            InputTypeError,
            "expected a number for 'tank.area', got '1'",
        ),
        ("tank", {"step": 0}, InputError, "expected step= as a finite number above 0, got 0"),
        ([], {}, InputError, "expected at least one FMU, got none"),
        (
            ["tank", "tank"],
            {},
            InputError,
            "expected FMUs of different names, got 'tank' more than once; name them: {\"first\": ",
        ),
        (3, {}, InputTypeError, "expected the path of an FMU, or several, got 3"),
    ],
)
def test_what_cannot_be_set_up_is_refused(
    folder: Path,
    fmus: Any,  # noqa: ANN401
    named: dict[str, Any],
    error: type[RtamtError],
    message: str,
) -> None:
    paths: Any = fmus
    if isinstance(fmus, str):
        paths = folder / f"{fmus}.fmu"
    elif isinstance(fmus, list):
        paths = [folder / f"{each}.fmu" for each in fmus]
    with pytest.raises(error) as refused:
        Fmus(paths, **named)
    assert str(refused.value).startswith(message)


@pytest.mark.parametrize(
    ("fmu", "spec", "named", "message"),
    [
        ("tank", "always(levl < 3)", {}, "no variable 'levl' in tank; did you mean 'level'?"),
        ("tank", "always(q < 3)", {}, "no variable 'q' in tank; the outputs are 'tank.level', "),
        (
            "silent",
            LOW,
            {},
            "silent does not state the duration of a step; give period= in seconds",
        ),
        (
            "tank",
            LOW,
            {"period": 0.25, "step": 0.1},
            (
                "the period 0.25 s is not a multiple of the communication step 0.1 s (2.5 steps); "
                "use 0.2 s or 0.3 s"
            ),
        ),
        ("other", LOW, {}, "cannot load the FMU 'other': "),
    ],
)
def test_what_cannot_be_run_is_refused(
    folder: Path, fmu: str, spec: str, named: dict[str, Any], message: str
) -> None:
    system = Fmus(folder / f"{fmu}.fmu", step=named.get("step"))
    with pytest.raises(InputError) as refused:
        simulate(system, spec, duration=1, period=named.get("period"))
    assert str(refused.value).startswith(message)


def test_fmus_that_suggest_several_steps_need_a_period(
    folder: Path, tmp_path: Path, version: int
) -> None:
    fine = write_fmu(tmp_path / "fine.fmu", library(version, tmp_path), version, step=0.02)
    with pytest.raises(InputError) as refused:
        simulate(Fmus([fine, folder / "tank.fmu"]), "always(fine.level < 3)", duration=1)
    assert str(refused.value) == (
        "fine, tank suggest steps of 0.02 and 0.1 s; give period= in seconds"
    )


def test_a_monitor_beside_a_finer_plant_takes_a_sample_every_period(
    tmp_path: Path, version: int
) -> None:
    fine = write_fmu(tmp_path / "fine.fmu", library(version, tmp_path), version, step=0.02)
    text = "always(level < 1.25)"
    export_fmu(text, tmp_path / "monitor.fmu", period=0.1, fmi=3 if version == 3 else 2)
    system = Fmus(
        [fine, tmp_path / "monitor.fmu"],
        inputs={"fine.inflow": 1.0, "monitor.level": "fine.level"},
        step=0.02,
    )
    run = simulate(
        system, "always(monitor.upper > -9 and fine.level < 9)", duration=2, period="100ms"
    )
    episode, bounds = EpisodeMonitor(text, 0.1), [math.inf]
    for level in run.signals["fine.level"][:-1]:
        episode.update(level=level)
        bounds.append(episode.upper)
    assert run.signals["monitor.upper"].tolist() == bounds
    assert bounds[-1] < 0 < bounds[1]


def test_what_is_no_fmu_for_co_simulation_is_refused(folder: Path, tmp_path: Path) -> None:
    broken = tmp_path / "broken.fmu"
    broken.write_text("nothing")
    with pytest.raises(InputError) as refused:
        Fmus(broken)
    assert str(refused.value) == f"cannot read the FMU {broken}: File is not a zip file"
    with pytest.raises(FileNotFoundError):
        Fmus(folder / "none.fmu")


def test_a_step_that_cuts_the_fixed_step_of_an_fmu_is_refused(tmp_path: Path) -> None:
    path = write_fmu(tmp_path / "fixed.fmu", None, 3, fixed='fixedInternalStepSize="0.02"')
    with pytest.raises(InputError) as refused:
        simulate(Fmus(path, step=0.05), LOW, duration=1)
    assert str(refused.value) == (
        "the communication step 0.05 s is not a multiple of the fixed step of 'fixed', 0.02 s "
        "(2.5 steps); use 0.04 s or 0.06 s"
    )


def test_fmus_for_model_exchange_and_of_fmi_1_are_refused(tmp_path: Path) -> None:
    exchange = write_fmu(tmp_path / "exchange.fmu", None, 2, kind="ModelExchange")
    with pytest.raises(InputError) as refused:
        Fmus(exchange)
    assert str(refused.value) == (
        f"expected an FMU for co-simulation, got {exchange}, which is for model exchange"
    )


def test_fmus_are_freed_even_if_one_fails_to_end(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    freed = []

    class Restive:
        """An FMU that refuses to be terminated."""

        def terminate(self) -> None:
            raise FMICallException("fmi2Terminate", 3)

        def freeInstance(self) -> None:  # noqa: N802 - as FMPy has it
            freed.append(self)

    def instantiate(self: Instance, *_: object) -> None:
        vars(self).update(
            _name="tank", _messages=(), _warnings=(), _now=0.0, _steps=True, _dead=False
        )
        vars(self)["_fmu"] = Restive()

    system = Fmus({"a": folder / "tank.fmu", "b": folder / "tank.fmu"})
    monkeypatch.setattr(Instance, "__init__", instantiate)
    system._instances = [Instance("a", None, folder), Instance("b", None, folder)]
    with pytest.raises(StateError, match="FMU 'tank' failed at 0 s: fmi2Terminate failed"):
        system.close()
    assert len(freed) == 2
    system.close()
    assert len(freed) == 2


def test_what_was_not_unpacked_whole_is_unpacked_anew(folder: Path, tmp_path: Path) -> None:
    moved = tmp_path / "second.fmu"
    moved.write_bytes((folder / "tank.fmu").read_bytes())
    system = Fmus([folder / "tank.fmu", moved])
    whole = moved.read_bytes()
    moved.unlink()
    with pytest.raises(FileNotFoundError):
        simulate(system, "always(tank.level < 9)", duration=1)
    moved.write_bytes(whole)
    assert simulate(system, "always(tank.level < 9)", duration=1).steps == 10


def test_an_archive_with_an_absolute_path_is_refused(folder: Path, tmp_path: Path) -> None:
    path = tmp_path / "evil.fmu"
    shutil.copy(folder / "tank.fmu", path)
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("/etc/passwd", "root")
    system = Fmus(path)
    with pytest.raises(InputError, match=r"cannot unpack the FMU .*evil.fmu: Illegal path"):
        simulate(system, LOW, duration=1)
