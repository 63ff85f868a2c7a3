"""Variables with a declared default, in tables without values of them."""

from __future__ import annotations

import json
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

import rtamt
from rtamt_gym import EvaluationOptions
from rtamt_gym.__main__ import main
from rtamt_gym.recorded.columns import Columns, Missing
from rtamt_gym.recorded.trace import EventTrace, Trace
from rtamt_gym.recorded.trace_files import read_ruled
from rtamt_gym.results.codec import trials_of

TEXT = "input float64 x; input float64 limit = 0.5; out = always(x < limit)"
SPEC = rtamt.parse(TEXT)
ABSENT = "time,x\n1,0.25\n2,0.125\n3,0\n"
LATE = "time,x,limit\n1,0.25,\n2,0.125,\n3,0,0.75\n"


def table(folder: Path, text: str) -> str:
    """Write a file and return its name."""
    path = folder / "run.csv"
    path.write_text(text)
    return str(path)


@pytest.mark.parametrize(
    ("text", "missing", "limits", "notes"),
    [
        (ABSENT, "raise", [0.5] * 3, ["'limit' is 0.5, its default: the column is missing"]),
        (
            LATE,
            "hold",
            [0.5, 0.5, 0.75],
            [
                "empty cells hold the value before (limit: 2)",
                "'limit' is 0.5, its default: its first cell is empty",
            ],
        ),
        (LATE, "drop", [0.75], ["2 rows with an empty cell left out"]),
    ],
)
def test_default_before_first_value(
    tmp_path: Path, text: str, missing: Missing, limits: list[float], notes: list[str]
) -> None:
    columns = Columns(missing=missing, time_unit="s")
    trace, _ = read_ruled(table(tmp_path, text), {"": SPEC}, EvaluationOptions(), columns)
    assert isinstance(trace, Trace)
    assert trace.columns["limit"].tolist() == limits
    assert trace.notes == notes


@pytest.mark.parametrize(
    ("text", "limits", "notes"),
    [
        (
            ABSENT,
            [[1, 0.5], [3, 0.5]],
            ["'limit' is 0.5, its default: it has no event"],
        ),
        (
            LATE,
            [[1, 0.5], [3, 0.75]],
            [
                "empty cells are not events: the value before holds (limit: 2)",
                "'limit' is 0.5, its default: its first event comes at 3 s",
            ],
        ),
        (
            "time,variable,value\n1,x,0.25\n2,x,0.125\n3,x,0\n",
            [[1, 0.5], [3, 0.5]],
            ["'limit' is 0.5, its default: it has no event"],
        ),
        (
            "time,variable,value\n1,x,0.25\n2,x,0.125\n2,limit,0.75\n3,x,0\n",
            [[1, 0.5], [2, 0.75], [3, 0.75]],
            ["'limit' is 0.5, its default: its first event comes at 2 s"],
        ),
        (
            "time,x,limit\n1,0.25,0.75\n3,0,\n",
            [[1, 0.75], [3, 0.75]],
            ["empty cells are not events: the value before holds (limit: 1)"],
        ),
        (
            "time,x,limit\n1,0.25,\n",
            [[1, 0.5]],
            [
                "empty cells are not events: the value before holds (limit: 1)",
                "'limit' is 0.5, its default: it has no event",
            ],
        ),
    ],
)
def test_a_default_is_an_event_at_the_first_row(
    tmp_path: Path, text: str, limits: list[list[float]], notes: list[str]
) -> None:
    trace, _ = read_ruled(
        table(tmp_path, text), {"": SPEC}, EvaluationOptions(dense=True), Columns(time_unit="s")
    )
    assert isinstance(trace, EventTrace)
    assert list(trace.signals) == ["x", "limit"]
    assert trace.tables["limit"].tolist() == limits
    assert trace.notes == notes


def test_missing_requested_column_error(tmp_path: Path) -> None:
    path = table(tmp_path, ABSENT)
    with pytest.raises(rtamt.InputError) as caught:
        read_ruled(path, {"": SPEC}, EvaluationOptions(), Columns({"limit": "lim"}))
    assert str(caught.value) == (
        f"{path}: no column 'lim', which the specification reads; the columns are time, x"
    )


NEAR = """\
'{variable}', which has a default, but '{near}'; give --signal {signal} to read it{unit}, or \
--default {variable} to take the default 0.5"""


@pytest.mark.parametrize("reading", [EvaluationOptions(), EvaluationOptions(dense=True)])
@pytest.mark.parametrize(
    ("variable", "near"),
    [
        *[("limit", each) for each in ("Limit", "LIMIT", "limit [m/s]", "limti", "limits")],
        ("speed_limit", "SpeedLimit"),
        ("speed_limit", "speed limit (m/s)"),
    ],
)
def test_default_with_misspelt_column_error(
    variable: str, near: str, reading: EvaluationOptions, tmp_path: Path
) -> None:
    path = table(tmp_path, f"time,x,{near}\n1,0.25,1\n2,0.125,1\n")
    specs = {"": rtamt.parse(TEXT.replace("limit", variable))}
    with pytest.raises(rtamt.InputError) as caught:
        read_ruled(path, specs, reading, Columns())
    said = f"{variable}={near}"
    signal = said if near.isalnum() else f"'{said}'"
    unit = " if the specification counts in m/s" if "m/s" in near else ""
    expected = NEAR.format(variable=variable, near=near, signal=signal, unit=unit)
    assert str(caught.value) == f"{path}: no column {expected}"
    # Both hints work.
    found, _ = read_ruled(path, specs, reading, Columns({variable: near}))
    assert not found.defaults
    found, _ = read_ruled(path, specs, reading, Columns(defaults=[variable]))
    assert found.defaults == {variable: 0.5}


@pytest.mark.parametrize("other", ["x1", "delimiter", "limit2", "speed", "li"])
def test_a_column_of_another_name_is_no_slip(other: str, tmp_path: Path) -> None:
    path = table(tmp_path, f"time,x,{other}\n1,0.25,1\n2,0.125,1\n")
    trace, _ = read_ruled(path, {"": SPEC}, EvaluationOptions(), Columns())
    assert trace.defaults == {"limit": 0.5}


def test_column_of_other_variable_is_not_misspelt(tmp_path: Path) -> None:
    text = "input float64 limit = 0.5; input float64 limits; always(limits < limit)"
    path = table(tmp_path, "time,limits\n1,0.25\n2,0.125\n")
    trace, _ = read_ruled(path, {"": rtamt.parse(text)}, EvaluationOptions(), Columns())
    assert trace.defaults == {"limit": 0.5}


def test_misspelt_event_error(tmp_path: Path) -> None:
    path = table(tmp_path, "time,variable,value\n1,x,0.25\n2,x,0.125\n2,Limit,0.75\n")
    with pytest.raises(rtamt.InputError, match="but 'Limit'; give --signal limit=Limit"):
        read_ruled(path, {"": SPEC}, EvaluationOptions(dense=True), Columns())


@pytest.mark.parametrize("reading", [EvaluationOptions(), EvaluationOptions(dense=True)])
@pytest.mark.parametrize(("text", "missing"), [(ABSENT, "raise"), (LATE, "hold")])
def test_defaults_error_with_no_defaults(
    text: str, missing: Missing, reading: EvaluationOptions, tmp_path: Path
) -> None:
    path = table(tmp_path, text)
    columns = Columns(missing=missing, no_defaults=True)
    with pytest.raises(rtamt.InputError) as caught:
        read_ruled(path, {"": SPEC}, reading, columns)
    said = str(caught.value)
    assert said.startswith(
        f"{path}: expected records of 'limit', as --no-defaults requires, got its "
    )
    assert said.endswith("; give --signal limit=COLUMN, or --default limit to take it")
    columns = Columns(missing=missing, no_defaults=True, defaults=("limit",))
    trace, _ = read_ruled(path, {"": SPEC}, reading, columns)
    assert trace.defaults == {"limit": 0.5}


def test_verdicts_that_rest_on_a_default_say_so(capsys: pytest.CaptureFixture[str]) -> None:
    Path("absent.csv").write_text(ABSENT.replace("time", "time_s"))
    Path("whole.csv").write_text("time_s,x,limit\n1,0.25,0.125\n2,0.125,1\n3,0,1\n")
    specs = [TEXT, "other = always(x < 1)"]
    files = ["--junit", "o.xml", "--markdown", "o.md"]
    assert main(["monitor", *specs, *files, "--", "absent.csv", "whole.csv"]) == 1
    said = capsys.readouterr().out.splitlines()
    assert said[:6] == [
        "trace       length  period  verdict       out     other",
        "absent.csv     2 s     1 s  SATISFIED    0.25  d   0.75",
        "whole.csv      2 s     1 s  VIOLATED   -0.125 V    0.75",
        "",
        "numbers are robustness; V: violated, U: undecided, E: error, otherwise",
        "    satisfied; d: rests on a default",
    ]
    assert "| 0.25  d |" in Path("o.md").read_text()
    root = ET.parse("o.xml").getroot()  # noqa: S314 - our own
    found = [
        (case.get("classname"), case.get("name"), each.get("name"), each.get("value"))
        for case in root.iter("testcase")
        for each in case.iter("property")
    ]
    assert found == [("absent.csv", "out", "default:limit", "0.5")]
    assert main(["monitor", *specs, "--json", "--", "absent.csv", "whole.csv"]) == 1
    kept = json.loads(capsys.readouterr().out)
    defaults = [[cell.get("defaults") for cell in t["outcomes"].values()] for t in kept["trials"]]
    assert defaults == [[{"limit": 0.5}, None], [None, None]]
    again = trials_of(kept)[0].outcomes["out"]
    assert again.defaults == {"limit": 0.5}


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--default", "limti"], "no specification declares one for 'limti'; did you mean 'limit'"),
        (["--default", "gear"], "no specification declares one for 'gear'; they declare one for '"),
    ],
)
def test_undeclared_default_error(
    options: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["monitor", TEXT, table(tmp_path, ABSENT), *options]) == 2
    assert f"--default: {said}" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "has", "options"),
    [
        (ABSENT, "time, x", []),
        (ABSENT, "time, x", ["--dense"]),
        ("time,Limit\n1,2\n2,2\n", "time, Limit; did you mean 'Limit'?", []),
        ("time,variable,value\n1,x,0.25\n", "x", ["--dense"]),
    ],
)
def test_defaults_alone_pass_no_gate(
    text: str,
    has: str,
    options: list[str],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = table(tmp_path, text)
    alone = "input float64 limit = 0.5; input float64 low = 0; always(limit > low)"
    assert main(["monitor", alone, *options, path]) == 2
    assert capsys.readouterr().err == (
        f"rtamt: error: {path}: expected a record of 'limit', 'low', got none: defaults alone are "
        f"not a trace; it has {has}\n"
    )


def test_defaults_only_requirement_does_not_stop_others(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    alone = "input float64 limit = 0.5; alone = always(limit > 0)"
    assert main(["monitor", TEXT, alone, table(tmp_path, ABSENT), "--json"]) == 2
    (found,) = json.loads(capsys.readouterr().out)["trials"]
    verdicts = {name: cell["verdict"] for name, cell in found["outcomes"].items()}
    assert verdicts == {"out": "SATISFIED", "alone": "ERROR"}


def test_two_defaults_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    texts = [TEXT, TEXT.replace("= 0.5", "= 0.75").replace("out", "other")]
    assert main(["monitor", *texts, table(tmp_path, ABSENT)]) == 2
    assert capsys.readouterr().err == (
        "rtamt: error: expected one default for 'limit', which two specifications read, got 0.5 "
        "and 0.75; rename one variable, or judge the specifications separately\n"
    )


def test_a_default_is_kept_with_the_outcomes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = table(tmp_path, ABSENT)
    assert main(["monitor", TEXT, path, "--json"]) == 0
    outcomes = json.loads(capsys.readouterr().out)
    assert outcomes["reading"]["columns"] == {"starts": {"limit": 0.5}}
    (cell,) = outcomes["trials"][0]["outcomes"].values()
    assert cell["robustness"] == 0.25
    # The formula of the outcomes has lost its declarations.
    again = rtamt.parse(outcomes["requirements"]["out"])
    trace, _ = read_ruled(
        path, {"": again}, EvaluationOptions(), Columns(**outcomes["reading"]["columns"])
    )
    assert "'limit' is 0.5, its default: the column is missing" in trace.notes


def test_a_default_holds_in_every_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = table(tmp_path, ABSENT)
    assert main(["explain", TEXT, path]) == 0
    assert "  0.5  limit\n" in capsys.readouterr().out
    text = TEXT.replace("limit)", "limit + ?v)")
    assert main(["mine", text, "--range", "v=-1:1", path]) == 0
    out = capsys.readouterr().out
    assert out.startswith("v = -0.24999 is the smallest for which the trace satisfies ")
    note = f"note: {path}: 'limit' is 0.5, its default: the column is missing"
    assert note in " ".join(out.split())
