"""The model description of an exported monitor, and refused exports."""

from __future__ import annotations

import platform
import re
import zipfile
from importlib.machinery import ModuleSpec
from pathlib import Path
from typing import Any

import pytest
from exported import Drawn, exported, texts
from fmpy import read_model_description  # type: ignore[import-untyped]
from fmpy.validation import validate_fmu  # type: ignore[import-untyped]
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples

import rtamt
from rtamt import InputError, RtamtError, SpecificationError
from rtamt.export import fmu
from rtamt.export.fmu import Fmi, export_fmu

TEXT = """
specification entry
const float limit = 2; const float gain = 0.5; const float unused = 7; const float T = 3
input float offset = 1.5
output Odometry odom
from nav_msgs.msg import Odometry
near = abs(offset) * gain <= limit
whole = always(near implies eventually[0:T](odom.twist[1].x < 0 and near))
"""


def test_every_export_is_valid(tmp_path: Path) -> None:
    @settings(max_examples=examples(20))
    @given(drawn=texts(dense=True), fmi=st.sampled_from((2, 3)), dense=st.booleans())
    def check(drawn: Drawn, fmi: Fmi, dense: bool) -> None:  # noqa: FBT001 - hypothesis draws it
        kind: dict[str, Any] = {"dense": True} if dense else {"period": "500ms"}
        try:
            export_fmu(drawn.text, tmp_path / "drawn.fmu", fmi=fmi, **kind)
        except SpecificationError:  # it has no variables, or a constant term is not a number
            return
        assert validate_fmu(tmp_path / "drawn.fmu") == []

    check()


@pytest.mark.parametrize("fmi", [2, 3])
def test_declared_ranges_are_limits_of_inputs(tmp_path: Path, fmi: Fmi) -> None:
    path = tmp_path / "ranges.fmu"
    text = "input float v in [5, 120]; uint8 gear in [0, 5] = 1; uint8 mode; float y in [-inf, -2]"
    export_fmu(f"{text}; always(v > gear + mode + y)", path, period="100ms", fmi=fmi)
    assert validate_fmu(path) == []
    described_values = {
        scalar.name: (scalar.min, scalar.max, scalar.start)
        for scalar in read_model_description(path).modelVariables
        if scalar.causality == "input"
    }
    assert described_values == {
        "v": ("5.0", "120.0", "5.0"),
        "gear": ("0.0", "5.0", "1.0"),
        "mode": (None, None, "0.0"),
        "y": (None, "-2.0", "-2.0"),
    }


@pytest.mark.parametrize("fmi", [2, 3])
def test_the_variables_are_those_of_the_specification(tmp_path: Path, fmi: Fmi) -> None:
    path = tmp_path / "entry.fmu"
    export_fmu(TEXT, path, period="100ms", fmi=fmi, stop_on_violation=True)
    assert validate_fmu(path) == []
    described = read_model_description(path)
    described_values = [
        (scalar.name, scalar.causality, scalar.start)
        for scalar in described.modelVariables
        if scalar.name != "time"
    ]
    assert described_values == [
        ("robustness", "output", None),
        ("lower", "output", None),
        ("upper", "output", None),
        ("verdict", "output", None),
        ("stop_on_violation", "parameter", "true"),
        ("offset", "input", "1.5"),
        ("odom.twist[1].x", "input", "0.0"),
        ("limit", "parameter", "2.0"),
        ("gain", "parameter", "0.5"),
        ("T", "local", "3.0"),
        ("near", "output", None),
        ("whole", "output", None),
    ]
    assert (described.modelName, described.fmiVersion) == ("entry", f"{fmi}.0")
    assert described.description == (
        "always(abs(offset) * gain <= limit implies "
        "eventually[0:3](odom.twist[1].x < 0 and abs(offset) * gain <= limit))"
    )
    meaning = {scalar.name: scalar.description for scalar in described.modelVariables}
    assert meaning["near"] == "abs(offset) * gain <= limit"
    assert meaning["whole"] == described.description + ", late by 3 s"
    assert meaning["T"] == "a constant in a bound of an interval, which cannot be set"
    assert float(described.defaultExperiment.stepSize) == 0.1
    names = zipfile.ZipFile(path).namelist()
    folder = {2: "linux64", 3: "x86_64-linux"}[fmi]
    assert names[1] == f"binaries/{folder}/rtamt_monitor.so"


def test_dense_time_suggests_no_step(tmp_path: Path) -> None:
    export_fmu("always(x < 1)", tmp_path / "dense.fmu", dense=True)
    described = read_model_description(tmp_path / "dense.fmu")
    assert described.defaultExperiment.stepSize is None
    assert described.modelVariables[0].description == (
        "the robustness at the last time for which it is settled"
    )


@pytest.mark.parametrize("fmi", [2, 3])
def test_outputs_depend_on_no_input_of_their_own_time(tmp_path: Path, fmi: Fmi) -> None:
    export_fmu("a = x > 0; always(a)", tmp_path / "one.fmu", period=1, fmi=fmi)
    described = read_model_description(tmp_path / "one.fmu")
    known = [(scalar.variable.name, scalar.dependencies) for scalar in described.outputs]
    assert known == [(n, []) for n in ("robustness", "lower", "upper", "verdict", "a")]


@pytest.mark.parametrize("fmi", [2, 3])
def test_initial_outputs_depend_only_on_constants(tmp_path: Path, fmi: Fmi) -> None:
    constants = "const float v = 1; const float T = 2; const float w = 3"
    text = f"{constants}; a = x > v; eventually[0:T](a and y > w)"
    export_fmu(text, tmp_path / "one.fmu", period=1, fmi=fmi)
    described = read_model_description(tmp_path / "one.fmu")
    known = {
        scalar.variable.name: [variable.name for variable in scalar.dependencies]
        for scalar in described.initialUnknowns
    }
    outputs = [scalar.name for scalar in described.modelVariables if scalar.causality == "output"]
    assert known == {name: ["v", "w"] for name in outputs}
    assert outputs == ["robustness", "lower", "upper", "verdict", "a"]


@pytest.mark.parametrize("fmi", [2, 3])
def test_the_categories_of_the_log_are_described(tmp_path: Path, fmi: Fmi) -> None:
    export_fmu("always(x > 1)", tmp_path / "one.fmu", period=1, fmi=fmi)
    text = zipfile.ZipFile(tmp_path / "one.fmu").read("modelDescription.xml").decode()
    names = re.findall('<Category name="(.*?)"', text)
    assert names == ["logStatusError", "logEvents"]
    with exported("always(x > 1)", fmi, period=1) as unit:
        unit.fmu.setDebugLogging(loggingOn=True, categories=names)


def test_the_same_monitor_is_the_same_file(tmp_path: Path) -> None:
    files = []
    texts = (TEXT, TEXT, TEXT.replace("limit = 2", "limit = 3"))
    for i, text in enumerate(texts):
        path = tmp_path / f"{i}.fmu"
        export_fmu(text, path, period="100ms")
        files.append((path.read_bytes(), read_model_description(path).guid))
    assert files[0] == files[1]
    assert files[0][1] != files[2][1]


def test_one_of_several_requirements_is_exported(tmp_path: Path) -> None:
    spec = rtamt.parse("const float v = 5; apart = always(gap > 1); slow = always(speed < v)")
    path = tmp_path / "slow.fmu"
    export_fmu(spec.requirements["slow"], path, period=1)
    names = [scalar.name for scalar in read_model_description(path).modelVariables]
    assert names[5:] == ["speed", "v", "slow"]
    export_fmu(spec.requirements["apart"], path, period=1)
    names = [scalar.name for scalar in read_model_description(path).modelVariables]
    assert names[5:] == ["gap", "apart"]


def test_named_formula_outputs_state_their_time(tmp_path: Path) -> None:
    path = tmp_path / "slow.fmu"
    export_fmu(
        """
        slow = always(v < 9)
        done = eventually(x > 0)
        soon = eventually[0:2](x > 0)
        answered = always(x > 1 implies soon)
        out = slow and always(v > 1 implies done) and answered
        """,
        path,
        period=0.5,
    )
    described = read_model_description(path).modelVariables[7:]
    assert [(scalar.name, scalar.description.partition(", ")[2]) for scalar in described] == [
        ("slow", ""),
        ("done", ""),
        ("soon", "late by 2 s"),
        ("answered", "late by 2 s"),
        ("out", "as if the run ended now"),
    ]


def test_a_constant_in_a_bound_is_fixed_in_terms_too(tmp_path: Path) -> None:
    path = tmp_path / "both.fmu"
    export_fmu("const float T = 2; eventually[0:T](x * T > 1)", path, period=1)
    described = read_model_description(path)
    assert [(v.name, v.causality) for v in described.modelVariables[5:]] == [
        ("x", "input"),
        ("T", "local"),
    ]
    program = zipfile.ZipFile(path).read("resources/program.rtamt").decode()
    assert "CONST - 0 0 2.0" in program


TIMED = "const float T = 2; always(x > 1 implies eventually[0:T](y > 0))"


def test_a_refused_export_writes_no_file(tmp_path: Path) -> None:
    for text, name in (("lower = x > 0; always(lower)", "x.fmu"), (TIMED, "x.txt"), (TIMED, "fmu")):
        with pytest.raises(RtamtError):
            export_fmu(text, tmp_path / name, period=1)
    assert list(tmp_path.iterdir()) == []
    export_fmu(TIMED, tmp_path / "M.FMU", period=1)


def test_without_the_library_nothing_is_exported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    elsewhere = ModuleSpec("rtamt._native", None, origin=str(tmp_path / "_native.so"))
    monkeypatch.setattr(fmu, "find_spec", lambda _: elsewhere)
    with pytest.raises(InputError) as raised:
        export_fmu(TIMED, tmp_path / "monitor.fmu", period=1)
    assert str(raised.value) == (
        "the FMU library rtamt_monitor.so was not built; reinstall rtamt with a C++20 compiler"
    )
    assert list(tmp_path.iterdir()) == []


def test_an_unknown_platform_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(platform, "machine", lambda: "riscv64")
    with pytest.raises(InputError) as raised:
        export_fmu(TIMED, tmp_path / "monitor.fmu", period=1)
    assert str(raised.value) == (
        "there is no FMU library for this platform, linux riscv64; export on linux x86_64"
    )
