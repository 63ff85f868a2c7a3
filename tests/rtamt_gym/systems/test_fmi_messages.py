"""Messages of FMUs when they fail, and FMUs that break the rules of the standard."""

from __future__ import annotations

import gc
import io
import math
import sys
from fractions import Fraction
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import pytest
from bits import identical
from fmus import library, write_fmu

from rtamt import EpisodeMonitor, InputError, StateError
from rtamt.export.fmu import export_fmu
from rtamt_gym import Fmus, simulate
from rtamt_gym.results import Run
from rtamt_gym.systems.fmi_instance import Instance

LOW = "always(level < 9)"


@pytest.fixture(scope="module", params=[2, 3])
def version(request: pytest.FixtureRequest) -> int:
    return int(request.param)


@pytest.fixture(scope="module")
def tank(tmp_path_factory: pytest.TempPathFactory, version: int) -> Path:
    folder = tmp_path_factory.mktemp(f"fmi{version}")
    return write_fmu(folder / "tank.fmu", library(version, folder), version)


def test_warnings_and_errors_come_before_what_an_fmu_says_besides(tank: Path, version: int) -> None:
    with pytest.raises(StateError) as refused:
        simulate(Fmus(tank, parameters={"fails_at": 0.55}), LOW, duration=2)
    assert str(refused.value) == (
        f"FMU 'tank' failed at 0.5 s: fmi{version}DoStep failed with status 3 (error). "
        "Its last messages: the tank has burst"
    )


def test_without_any_the_last_messages_are_told(tank: Path, version: int) -> None:
    with pytest.raises(StateError) as refused:
        simulate(Fmus(tank, parameters={"fails_at": -1}), LOW, duration=2)
    assert str(refused.value) == (
        f"FMU 'tank' failed at 0 s: fmi{version}DoStep failed with status 3 (error). "
        "Its last messages: a step was asked for; the step is over"
    )


def test_an_fmu_that_fails_leaves_its_samples(tank: Path) -> None:
    system = Fmus(tank, inputs={"inflow": 1.0}, parameters={"fails_at": 0.55})
    with pytest.raises(StateError) as refused:
        simulate(system, LOW, duration=2)
    run: Run = refused.value.run  # type: ignore[attr-defined]  # simulate sets it
    assert (run.ended, run.steps) == ("error", 5)
    alone = Fmus(tank, inputs={"inflow": 1.0})
    whole = simulate(alone, LOW, duration=0.5, at_truncation="open")
    assert run.histories == whole.histories
    assert run.replay()["spec"].tolist() == whole.replay()["spec"].tolist()


def test_an_interrupt_while_an_fmu_speaks_ends_the_run(
    tank: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    heard: list[int] = []

    def listen(_self: Instance, *_message: object) -> None:
        heard.append(len(heard))
        if len(heard) == 7:  # of two messages at each step
            raise KeyboardInterrupt

    before = sys.unraisablehook
    monkeypatch.setattr(Instance, "listen", listen)
    with pytest.raises(KeyboardInterrupt) as stopped:
        simulate(Fmus(tank), LOW, duration=math.inf)
    run: Run = stopped.value.run  # type: ignore[attr-defined]  # simulate sets it
    assert (run.ended, run.steps) == ("error", 3)
    assert sys.unraisablehook is before
    assert simulate(Fmus(tank), LOW, duration=1).steps == 10


def test_another_error_that_cannot_be_raised_is_told_as_before(
    tank: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    caught: list[type[BaseException]] = []
    monkeypatch.setattr(sys, "unraisablehook", lambda said: caught.append(said.exc_type))

    def listen(_self: Instance, *_message: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr(Instance, "listen", listen)
    assert simulate(Fmus(tank), LOW, duration=0.2).steps == 2
    assert caught == [ZeroDivisionError] * 4


def test_what_breaks_a_rule_is_taken_where_it_is_not_checked(tank: Path, version: int) -> None:
    attribute = 'canHandleVariableCommunicationStepSize="perhaps"'
    broken = write_fmu(
        tank.with_name("broken.fmu"), library(version, tank.parent), version, fixed=attribute
    )
    with pytest.raises(InputError) as refused:
        Fmus(broken)
    first, *_, last = str(refused.value).splitlines()
    assert first == f"cannot read the FMU {broken}: Failed to validate modelDescription.xml:"
    assert last == "Fmus(..., validate=False) takes it without this check"
    assert "'perhaps' is not a valid value" in str(refused.value)
    files = [item for item in gc.get_objects() if isinstance(item, io.FileIO)]
    assert [file for file in files if file.name == str(broken) and not file.closed] == []
    run = simulate(Fmus(broken, validate=False), LOW, duration=1)
    assert run.histories == simulate(Fmus(tank), LOW, duration=1).histories


def test_what_is_no_fmu_is_refused_unchecked_too(tmp_path: Path) -> None:
    broken = tmp_path / "broken.fmu"
    broken.write_text("nothing")
    for validate in (True, False):
        with pytest.raises(InputError) as refused:
            Fmus(broken, validate=validate)
        assert str(refused.value) == f"cannot read the FMU {broken}: File is not a zip file"


def test_an_fmu_of_version_1_is_refused(tmp_path: Path) -> None:
    old = tmp_path / "old.fmu"
    with ZipFile(old, "w") as archive:
        archive.writestr(
            "modelDescription.xml",
            '<fmiModelDescription fmiVersion="1.0" modelName="m" modelIdentifier="m" guid="g" '
            'numberOfContinuousStates="0" numberOfEventIndicators="0"><ModelVariables/>'
            "</fmiModelDescription>",
        )
    with pytest.raises(InputError) as refused:
        Fmus(old)
    assert str(refused.value) == f"expected an FMU of FMI 2.0 or 3.0, got 1.0 in {old}"


def test_each_of_several_fmus_is_heard(tank: Path, version: int) -> None:
    both = Fmus({"one": tank, "other": tank}, parameters={"one.fails_at": 0.55})
    with pytest.raises(StateError) as refused:
        simulate(both, "always(one.level < 9)", duration=2)
    assert str(refused.value) == (
        f"FMU 'one' failed at 0.5 s: fmi{version}DoStep failed with status 3 (error). "
        "Its last messages: the tank has burst"
    )


def test_an_fmu_is_heard_after_a_later_one_was_freed(tank: Path) -> None:
    early = Fmus(tank, parameters={"fails_at": 0.55})
    early.bind(["level"], {}, Fraction(1, 10))
    early.start()
    assert simulate(Fmus(tank), LOW, duration=1).steps == 10
    gc.collect()
    for _ in range(5):
        early.advance()
    with pytest.raises(StateError, match=r"Its last messages: the tank has burst$"):
        early.advance()
    early.close()


OPEN = "always(monitor.verdict >= -1 and tank.level < 99)"
"""A requirement that always holds, so that it ends no simulation."""

TEXT = "const float most = 3; rises = inflow > 1; safe = always(rises implies level < most)"


@pytest.fixture(scope="module", params=[2, 3])
def folder(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A tank and a monitor of it, both of one version of FMI."""
    pytest.importorskip("rtamt._native", reason="no compiler was at hand")
    fmi: Any = request.param
    folder = tmp_path_factory.mktemp(f"monitored{fmi}")
    write_fmu(folder / "tank.fmu", library(fmi, folder), fmi)
    export_fmu(TEXT, folder / "monitor.fmu", period="100ms", fmi=fmi)
    return folder


def coupled(folder: Path, **parameters: float) -> Fmus:
    """The tank with the monitor beside it, and an inflow that grows."""
    return Fmus(
        [folder / "tank.fmu", folder / "monitor.fmu"],
        inputs={
            "tank.inflow": lambda t: t,
            "monitor.inflow": lambda t: t,
            "monitor.level": "tank.level",
        },
        parameters={f"monitor.{name}": value for name, value in parameters.items()},
    )


def test_a_monitor_beside_a_plant_sees_what_the_plant_does(folder: Path) -> None:
    run = simulate(coupled(folder), OPEN, duration=6)
    episode = EpisodeMonitor(TEXT, 0.1)
    expected = [0]
    for i, level in enumerate(run.signals["tank.level"]):
        episode.update(inflow=i / 10, level=level)
        expected.append(episode.verdict)
    assert -1 in expected
    assert identical(run.signals["monitor.verdict"], expected[:-1])


def test_a_violation_ends_the_simulation_at_once(folder: Path) -> None:
    whole = simulate(coupled(folder), OPEN, duration=6)
    first = whole.signals["monitor.verdict"].tolist().index(-1)
    system = coupled(folder, stop_on_violation=1)
    ended = simulate(system, OPEN, duration=6)
    assert ended.ended == "terminated"
    assert ended.signals["monitor.verdict"].tolist() == [0] * first + [-1]


def test_a_parameter_moves_the_violation(folder: Path) -> None:
    result = []
    for most in (1.5, 2.5, 99.0):
        run = simulate(coupled(folder, most=most), OPEN, duration=6)
        result.append(run.signals["monitor.verdict"].tolist().count(-1))
    assert result[0] > result[1] > result[2] == 0
