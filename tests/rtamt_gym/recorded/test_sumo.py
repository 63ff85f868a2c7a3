"""Floating car data of SUMO: a trace per object, from its first step to its last."""

import gzip
import json
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import rtamt
from rtamt_gym import EvaluationOptions
from rtamt_gym.__main__ import main
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.readers import traces_in
from rtamt_gym.recorded.trace import Trace
from rtamt_gym.recorded.trace_files import read_ruled

Object = tuple[str, str, int, Sequence[float]]
"""The kind and the name of an object, its first step, and its speeds."""


def write_fcd(path: Path, objects: Sequence[Object], step: float = 0.5) -> Path:
    """Write floating car data as SUMO does: two decimals, also steps without an object."""
    root = ET.Element("fcd-export")
    for at in range(2 + max((first + len(speeds) for _, _, first, speeds in objects), default=0)):
        element = ET.SubElement(root, "timestep", time=f"{at * step:.2f}")
        for kind, name, first, speeds in objects:
            if 0 <= at - first < len(speeds):
                cells = {"id": name, "speed": f"{speeds[at - first]:.2f}"}
                cells |= {"lane": "A_0"} if kind == "vehicle" else {"edge": "A"}
                ET.SubElement(element, kind, cells)
    text = ET.tostring(root, encoding="UTF-8", xml_declaration=True)
    path.write_bytes(gzip.compress(text) if path.suffix == ".gz" else text)
    return path


TWO: Sequence[Object] = [("vehicle", "a", 0, [1, 2, 3]), ("vehicle", "b", 1, [5, 4])]


def read(path: Path | str, where: dict[str, str] | None = None) -> Trace:
    spec, columns = rtamt.parse("always(speed < 10)"), Columns(where=where or {})
    trace, _ = read_ruled(str(path), {"": spec}, EvaluationOptions(), columns)
    assert isinstance(trace, Trace)
    return trace


@pytest.mark.parametrize("name", ["fcd.xml", "fcd.xml.gz"])
def test_verdicts_match_pandas(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    generator = np.random.default_rng(5)
    firsts, speeds = generator.integers(0, 30, 12).tolist(), generator.uniform(0, 20, (12, 31))
    objects = [
        ("vehicle", f"flow.{at}", first, speeds[at, : 20 + at].tolist())
        for at, first in enumerate(firsts)
    ]
    path = write_fcd(tmp_path / name, objects)
    main(["monitor", "r = always[0:3](speed < 15)", "--json", "--", str(path)])
    trials = json.loads(capsys.readouterr().out)["trials"]
    text = gzip.decompress(path.read_bytes()) if name.endswith("gz") else path.read_bytes()
    frame = pd.DataFrame(
        [
            {"time": float(step.get("time", "")), **element.attrib}
            for step in ET.fromstring(text)  # noqa: S314 - written above
            for element in step
        ]
    ).astype({"speed": float})
    expected = {
        f"{path}[id={key}]": 15 - rows[rows.time <= rows.time.min() + 3].speed.max()
        for key, rows in frame.groupby("id")
    }
    assert {t["name"]: t["outcomes"]["r"]["robustness"] for t in trials} == expected
    starts = {f"{path}[id={key}]": rows.time.min() for key, rows in frame.groupby("id")}
    assert {t["name"]: t["extent"]["begin"] for t in trials} == starts


@settings(max_examples=25, deadline=None)
@given(st.text(st.characters(exclude_categories=["C"]), min_size=1))
def test_any_name_is_one_trace(tmp_path_factory: pytest.TempPathFactory, name: str) -> None:
    path = write_fcd(
        tmp_path_factory.mktemp("fcd") / "fcd.xml", [("vehicle", name, 0, [1, 2]), *TWO[1:]]
    )
    traces = traces_in(str(path), {"id": name} if name.strip() == name else {})
    assert read(traces[0]).columns["speed"].tolist()[0] in (1, 5)


def test_kinds_of_one_name_are_told_apart(tmp_path: Path) -> None:
    path = write_fcd(tmp_path / "fcd.xml", [*TWO, ("person", "a", 0, [7, 8])])
    name = f"{path}[id=a]"
    with pytest.raises(
        rtamt.InputError, match=r"got a vehicle and a person.*--where object=person"
    ):
        read(name)
    assert read(name, {"object": "person"}).columns["speed"].tolist() == [7, 8]
    assert read(name, {"object": "vehicle"}).columns["speed"].tolist() == [1, 2, 3]
    assert traces_in(str(path), {"object": "person"}) == [name]


def test_times_of_day_are_seconds(tmp_path: Path) -> None:
    path = tmp_path / "fcd.xml"
    write_fcd(path, TWO)
    text = path.read_text()
    for old, new in {"0.00": "23:59:59", "0.50": "1:00:00:00", "1.00": "1:00:00:01"}.items():
        text = text.replace(f'time="{old}"', f'time="{new}"')
    path.write_text(text)
    trace = read(f"{path}[id=a]")
    assert (trace.start, trace.period()) == (86399.0, Fraction(1))
    path.write_text(text.replace("23:59:59", "noon"))
    with pytest.raises(rtamt.InputError, match=r"expected a time of a timestep, got 'noon'"):
        read(f"{path}[id=a]")


def test_object_that_returns_is_uneven(tmp_path: Path) -> None:
    path = write_fcd(tmp_path / "fcd.xml", [("vehicle", "a", 0, [1, 2]), ("vehicle", "a", 9, [3])])
    with pytest.raises(rtamt.InputError, match="samples at even distances"):
        read(f"{path}[id=a]").period()


@pytest.mark.parametrize("steps", [(0, 5), (0, 2, 4), (0, 1, 2, 5)])
@pytest.mark.parametrize("step", [1.0, 0.1, 1 / 3])
def test_step_is_that_of_the_file(
    steps: Sequence[int], step: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """An object that is absent in a step has a gap, even if its own rows are even."""
    objects: list[Object] = [("vehicle", "a", at, [8.0]) for at in steps]
    path = write_fcd(tmp_path / "fcd.xml", [*objects, ("vehicle", "b", 3, [7.0])], step)
    command = ["monitor", "always(speed < 9)", "--where", "id=a", str(path)]
    assert main(command) == 2
    assert f"elsewhere {step:.2g}" in capsys.readouterr().err
    main([*command, "--max-gap", f"{1.2 * step:.3f}", "--json"])
    (trial,) = json.loads(capsys.readouterr().out)["trials"]
    assert (trial["extent"]["samples"], trial["verdict"]) == (steps[-1] + 1, "UNDECIDED")


def test_single_step_object_has_file_step(tmp_path: Path) -> None:
    path = write_fcd(tmp_path / "fcd.xml", [*TWO, ("vehicle", "c", 1, [3])])
    spec = {"": rtamt.parse("always[0:1](speed < 9)")}
    _, period = read_ruled(f"{path}[id=c]", spec, EvaluationOptions(), Columns())
    assert period == Fraction(1, 2)


def test_one_trace_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = write_fcd(tmp_path / "fcd.xml", TWO)
    assert main(["monitor", "always(speed < 10)", str(path), "--one-trace"]) == 2
    assert "expected a table for --one-trace, got SUMO" in capsys.readouterr().err


def test_attribute_of_another_kind_is_missing(tmp_path: Path) -> None:
    path = write_fcd(tmp_path / "fcd.xml", [*TWO, ("person", "p", 0, [7, 8])])
    spec = rtamt.parse("always(lane < 1)")
    with pytest.raises(rtamt.InputError, match=r"no column 'lane'.*time, object, id, speed, edge"):
        read_ruled(f"{path}[id=p]", {"": spec}, EvaluationOptions(), Columns())
    with pytest.raises(
        rtamt.InputError, match=r"row 1, column 'lane': expected a number, got 'A_0'"
    ):
        read_ruled(f"{path}[id=a]", {"": spec}, EvaluationOptions(), Columns())


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("<routes/>", "got XML with <routes>"),
        ("<fcd-export/>", "expected an object, got none"),
        ("<fcd-export><timestep><vehicle id='a'/></timestep></fcd-export>", "without a time"),
        ("<fcd-export><timestep time='0'><vehicle/></timestep></fcd-export>", "without an id"),
        ("<!DOCTYPE fcd-export [<!ENTITY a 'b'>]><fcd-export/>", "the declaration of fcd-export"),
        ("time,x\n1,2\n", "in whole, got an error"),
        ("<?xml version='1.0' encoding='UTF-9'?><fcd-export/>", "unknown encoding: UTF-9"),
    ],
)
def test_other_xml_errors(
    text: str, error: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "other.xml"
    path.write_text(text)
    assert main(["monitor", "always(speed < 10)", "--", str(path)]) == 2
    assert error in capsys.readouterr().err


@pytest.mark.parametrize("name", ["fcd.xml", "fcd.xml.gz"])
def test_cut_file_error(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = write_fcd(tmp_path / name, TWO)
    whole = path.read_bytes()
    for part in range(20):
        path.write_bytes(whole[: len(whole) * part // 20])
        assert main(["monitor", "always(speed < 10)", "--", str(path)]) == 2
        assert f"{path}: expected floating car data of SUMO" in capsys.readouterr().err


@pytest.mark.parametrize("name", ["fcd.csv", "fcd.parquet"])
def test_table_of_xml2csv_has_the_same_verdicts(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The table has a row with empty cells for a step without an object."""
    path = write_fcd(tmp_path / "fcd.xml", TWO)
    rows: list[dict[str, object]] = []
    for step in ET.parse(path).getroot():  # noqa: S314 - written above
        cells = [{f"vehicle_{key}": text for key, text in element.items()} for element in step]
        time: dict[str, object] = {"timestep_time": float(step.get("time", ""))}
        rows += [time | own for own in cells or [{}]]
    frame = pd.DataFrame(rows).astype({"vehicle_speed": float})
    table = tmp_path / name
    if table.suffix == ".csv":
        frame.to_csv(table, sep=";", index=False)
    else:
        frame.to_parquet(table)
    found = []
    signal = "speed=vehicle_speed"
    for command in ([str(path)], [str(table), "--by", "vehicle_id", "--signal", signal]):
        main(["monitor", "r = always[0:0.5](speed < 4.5)", "--json", *command])
        printed = json.loads(capsys.readouterr().out)
        found.append({t["outcomes"]["r"]["robustness"] for t in printed["trials"]})
    assert found == [{2.5, -0.5}] * 2
    assert "2 rows of the file without an object in no group" in str(printed["trials"])


def test_row_with_values_but_without_an_id_error(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = tmp_path / "fcd.csv"
    table.write_text("time;vehicle_id;speed\n0;a;1\n0.5;;\n1;;3\n")
    assert main(["monitor", "always(speed < 9)", str(table), "--by", "vehicle_id"]) == 2
    assert (
        "line 4, column 'vehicle_id': expected a value of this --by column"
        in capsys.readouterr().err
    )
