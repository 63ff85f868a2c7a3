"""Missing, misspelt and late fields of a stream are errors or counted, as in `rtamt monitor`."""

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest

from rtamt_gym.__main__ import main

Output = pytest.CaptureFixture[str]
SPEC = "always(speed < 5)"
Row = Mapping[str, object]
KINDS = [["--missing", "hold"], ["--missing", "drop"], ["--missing", "unknown"], ["--dense"]]


PLAIN: Row = {"speed": 1}


def rows(*changed: Row, before: Row = PLAIN, count: int = 6) -> list[Row]:
    """Return rows of equal values, with other values in some middle rows."""
    plain: list[Row] = [before] * count
    plain[3 : 3 + len(changed)] = changed
    return [{"time": i, **row} for i, row in enumerate(plain)]


def as_json(path: Path, table: Sequence[Row]) -> Path:
    path = path / "rows.ndjson"
    path.write_text("".join(json.dumps(row) + "\n" for row in table))
    return path


def as_csv(path: Path, table: Sequence[Row]) -> Path:
    path = path / "rows.csv"
    names = [*dict.fromkeys(name for row in table for name in row)]
    lines: list[list[object]] = [[*names], *([row.get(n, "") for n in names] for row in table)]
    path.write_text("".join(",".join(map(str, line)) + "\n" for line in lines))
    return path


def both(capsys: Output, path: Path, *options: str, spec: str = SPEC) -> tuple[int, str]:
    """Return exit code and errors of `watch`, and check that `monitor` has the same code."""
    code = main(["monitor", spec, str(path), *options])
    capsys.readouterr()
    assert main(["watch", spec, str(path), *options]) == code
    return code, capsys.readouterr().err


def finals(capsys: Output, path: Path, *options: str) -> list[dict[str, Any]]:
    main(["watch", SPEC, str(path), *options])
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    return [line for line in lines if line["final"]]


@pytest.mark.parametrize("write", [as_json, as_csv])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ["Speed", "sped", "Speed [km/h]"])
def test_a_misspelt_field_is_an_error(
    name: str,
    kind: list[str],
    write: Callable[[Path, Sequence[Row]], Path],
    capsys: Output,
    tmp_path: Path,
) -> None:
    path = write(tmp_path, rows({name: 9}))
    code, errors = both(capsys, path, *kind)
    assert code == 2
    assert f"no value of 'speed', but one of '{name}', which nothing reads" in errors
    assert both(capsys, path, *kind, "--signal", "speed=speed")[0] != 2 or kind[-1] == "drop"


@pytest.mark.parametrize("kind", KINDS)
def test_another_signal_is_not_a_misspelling(
    kind: list[str], capsys: Output, tmp_path: Path
) -> None:
    beside = as_json(tmp_path, rows({"speed": 1, "Speed": 9}))
    assert both(capsys, beside, *kind)[0] == 0
    axis = as_json(tmp_path, rows({"acceleration_y": 9}, before={"acceleration_x": 1}, count=4))
    code, _ = both(capsys, axis, "--dense", spec="always(acceleration_x < 5)")
    assert code == 0


def test_empty_cells_are_counted_in_the_final_line(capsys: Output, tmp_path: Path) -> None:
    path = as_json(tmp_path, rows({"velocity": 9}, {"speed": None}))
    for kind in (*KINDS[::2], KINDS[3]):
        assert [line["missing"] for line in finals(capsys, path, *kind)] == [{"speed": 2}]
    path = as_json(tmp_path, rows())
    assert all("missing" not in line for line in finals(capsys, path, *KINDS[0]))


@pytest.mark.parametrize("orders", [[], ["--missing", "hold"]])
def test_events_that_are_not_there_are_counted(
    orders: list[str], capsys: Output, tmp_path: Path
) -> None:
    path = as_json(tmp_path, rows({}, {}))
    note = "empty cells are not events: the value before holds (speed: 2)"
    assert main(["monitor", SPEC, str(path), "--dense", *orders]) == 0
    assert note in " ".join(capsys.readouterr().out.split())
    assert main(["watch", SPEC, str(path), "--dense", *orders]) == 0
    assert note in capsys.readouterr().err


@pytest.mark.parametrize("name", ["limit", "Limit", "limti"])
def test_a_late_field_of_a_default_is_an_error(name: str, capsys: Output, tmp_path: Path) -> None:
    spec = "input float speed; input float limit = 5; always(speed < limit)"
    path = as_json(tmp_path, rows({"speed": 1, name: 0}))
    assert main(["watch", spec, str(path)]) == 2
    assert f"line 4: got '{name}', but 'limit' is not in the first line" in capsys.readouterr().err
    if name != "limit":
        assert main(["monitor", spec, str(path)]) == 2
        assert main(["watch", spec, str(path), "--default", "limit"]) == 0


@pytest.mark.parametrize("kind", [[], *KINDS])
def test_a_late_field_tells_objects(kind: list[str], capsys: Output, tmp_path: Path) -> None:
    late: list[Row] = [{"speed": 1, "vehicle_id": i} for i in (3, 7, 3)]
    code, errors = both(capsys, as_json(tmp_path, rows(*late)), *kind)
    assert code == 2
    assert "'vehicle_id', which no requirement reads, has several values" in errors


@pytest.mark.parametrize("kind", [[], *KINDS])
@pytest.mark.parametrize(
    ("value", "column", "fault"),
    [
        ({"a": [1]}, "a[1]", "expected a list with this element, got a list of 1"),
        ({"a": []}, "a[1]", "expected a list with this element, got a list of 0"),
        ({"a": 5}, "a[1]", "expected a list with this element, got 5"),
        ({"a": 5}, "a.b", "expected an object in 'a', got 5"),
        ({"a": [1, 2]}, "a.b", "expected an object in 'a', got a list of 2"),
        ({"a": {"b": 1}}, "a", "expected a number, got an object"),
        ({"a": [9, 9]}, "a", "expected a number, got a list of 2"),
        ({"a": [1, "x"]}, "a[1]", "expected a number, got 'x'"),
    ],
)
def test_a_field_of_another_kind_is_not_missing(
    value: Row, column: str, fault: str, kind: list[str], capsys: Output, tmp_path: Path
) -> None:
    plain = {"a[1]": [1, 2], "a.b": {"b": 1}, "a": 1}[column]
    path = as_json(tmp_path, rows(value, before={"a": plain}))
    code, errors = both(capsys, path, "--signal", f"speed={column}", *kind)
    assert code == 2
    assert f"line 4: column '{column}': {fault}" in errors


def test_a_stream_of_empty_cells_is_an_error(capsys: Output, tmp_path: Path) -> None:
    path = as_csv(tmp_path, [{"time": i, "speed": ""} for i in range(3)])
    code, errors = both(capsys, path, "--missing", "drop")
    assert code == 2
    assert "expected a row without an empty cell, got none" in errors


@pytest.mark.parametrize("kind", [["--missing", "hold"], ["--dense"]])
def test_a_default_before_the_first_value_is_noted(
    kind: list[str], capsys: Output, tmp_path: Path
) -> None:
    spec = "input float speed = 9; always(speed < 5)"
    path = as_csv(tmp_path, [{"time": i, "speed": 1 if i else ""} for i in range(3)])
    code, errors = both(capsys, path, *kind, spec=spec)
    assert code == 1
    why = "its first event comes at 1 s" if kind == ["--dense"] else "its first cell is empty"
    assert f"'speed' is 9, its default: {why}" in errors
    assert both(capsys, path, *kind, "--no-defaults", spec=spec)[0] == 2


def test_marks_between_digits_are_noted(capsys: Output, tmp_path: Path) -> None:
    path = tmp_path / "rows.csv"
    path.write_text("time;speed\n0;1,000.5\n1;2.5\n")
    code, errors = both(capsys, path)
    assert code == 1
    assert "marks between groups of three digits are left out: '1,000.5' is 1000.5" in errors


@pytest.mark.parametrize(
    ("names", "code", "fault"),
    [
        ("time,speed,gear", 0, "expected values, got the names of the columns again"),
        ("time,gear,speed", 2, "got other names of columns than in line 1: time, gear, speed"),
        ("time,gear", 2, "got other names of columns than in line 1: time, gear"),
    ],
)
def test_names_in_the_middle(
    names: str, code: int, fault: str, capsys: Output, tmp_path: Path
) -> None:
    path = tmp_path / "rows.csv"
    path.write_text(f"time,speed,gear\n0,1,2\n1,1,2\n{names}\n2,1,9\n3,1,9\n")
    assert main(["watch", SPEC, str(path), "--skip-bad"]) == code
    assert fault in capsys.readouterr().err
    assert main(["watch", SPEC, str(path)]) == main(["monitor", SPEC, str(path)]) == 2


@pytest.mark.parametrize("kind", [[], ["--dense"]])
def test_two_values_at_one_time_are_not_skipped(
    kind: list[str], capsys: Output, tmp_path: Path
) -> None:
    path = tmp_path / "rows.csv"
    path.write_text("time,speed\n0,1\n1,1\n1,9\n2,1\n")
    assert main(["watch", SPEC, str(path), "--skip-bad", *kind]) == 2
    assert "expected one value of 'speed' at one time, got 1 and 9" in capsys.readouterr().err


@pytest.mark.parametrize("cells", [["9,", ",1"], [",1", "9,"], ["9,1", ",1"], [",1", "9,1"]])
def test_rows_of_one_time_are_not_left_out(
    cells: Sequence[str], capsys: Output, tmp_path: Path
) -> None:
    """A file has the values of both rows in one sample, which violates the requirement."""
    path, options = tmp_path / "rows.csv", ["--missing", "drop"]
    path.write_text(f"time,speed,y\n0,1,1\n1,{cells[0]}\n1,{cells[1]}\n2,1,1\n")
    spec = "always(speed < 5 and y < 5)"
    assert main(["monitor", spec, str(path), *options]) == 1
    assert main(["watch", spec, str(path), *options]) == 2
    assert "line 4: expected the values of one time in one row" in capsys.readouterr().err
    assert main(["watch", spec, str(path), "--dense"]) == 1
