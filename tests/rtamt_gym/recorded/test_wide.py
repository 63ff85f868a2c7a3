"""Tables with a row per object and time, as one trace of all objects (``--wide``)."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from profiles import examples

from rtamt_gym.__main__ import main

SPEC = "always(x.Ego > 0 implies eventually[0:0.2](x.B2 - x.Ego > 1))"


def written(folder: Path, frame: pd.DataFrame, end: str) -> str:
    path = folder / f"log{end}"
    if end == ".csv":
        frame.to_csv(path, index=False)
    else:
        frame.to_parquet(path)
    return str(path)


presence = st.lists(
    st.tuples(st.integers(-3, 3), st.none() | st.integers(-3, 3)), min_size=2, max_size=8
)


@settings(max_examples=examples(40))
@given(presence, st.sampled_from((".csv", ".parquet")))
def test_wide_tables_equal_pivoted_files(
    tmp_path_factory: pytest.TempPathFactory, values: list[tuple[int, int | None]], end: str
) -> None:
    values = [*values, (1, 1)]  # both objects exist
    folder = tmp_path_factory.mktemp("wide")
    rows = []
    for k, (ego, other) in enumerate(values):
        rows += [{"time": k / 10, "name": "Ego", "x": float(ego)}]
        if other is not None:
            rows += [{"time": k / 10, "name": "B2", "x": float(other)}]
    frame = pd.DataFrame(rows)
    log = written(folder, frame, end)
    table = frame.pivot_table("x", "time", "name")  # pandas leaves cells without a row empty
    plain = folder / "plain.csv"
    columns = {f"x.{name}": table[name].to_numpy() for name in ("Ego", "B2")}
    pd.DataFrame({"time": table.index, **columns}).to_csv(plain, index=False)
    results = []
    for arguments in ([log, "--wide", "name"], [str(plain), "--missing", "unknown"]):
        target = folder / "out.xml"
        code = main(["monitor", SPEC, "--junit", str(target), *arguments])
        text = target.read_text().replace(log, "FILE").replace(str(plain), "FILE")
        results.append((code, text.partition("<system-out>samples")[0].splitlines()[:20]))
    assert [code for code, _ in results] == [results[0][0]] * 2
    cases = [
        [line for line in lines if "<testcase" in line or "<failure" in line]
        for _, lines in results
    ]
    assert cases[0] == cases[1] != []


def judged(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, dict[str, Any]]:
    code = main(["monitor", *arguments, "--json"])
    return code, json.loads(capsys.readouterr().out)


LOG = "time,name,x\n0,Ego,1\n0,B2,9\n1,Ego,1\n1,B2,9\n2,Ego,1\n3,Ego,1\n3,B2,-1\n"


@pytest.mark.parametrize("option", ["--one-trace", "--dense"])
def test_absent_objects_are_unknown(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], option: str
) -> None:
    log = tmp_path / "log.csv"
    log.write_text(LOG)
    for spec, verdict in (
        ("always[0:1](x.B2 > 5)", "SATISFIED"),
        ("always[0:2](x.B2 > 5)", "UNDECIDED"),  # held values would satisfy it
        ("always(x.B2 > 5)", "VIOLATED"),
        ("always(x.Ego > 0)", "SATISFIED"),
    ):
        _, found = judged(capsys, spec, str(log), "--wide", "name", option)
        assert [row["verdict"] for row in found["trials"]] == [verdict], spec


@pytest.mark.parametrize("end", [".csv", ".parquet"])
@pytest.mark.parametrize("option", ["--one-trace", "--dense"])
def test_times_equal_up_to_rounding_are_one_instant(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], option: str, end: str
) -> None:
    """A clock that counts k * 0.1, one that adds and one that rounds give the same trace."""
    added, counted = [0.0, *np.cumsum(np.full(39, 0.1)).tolist()], (np.arange(40) * 0.1).tolist()
    times = [*zip(added, counted, strict=True)]
    assert max(abs(first - second) for first, second in times) > 1e-15
    rows = [(time, name, k) for k, two in enumerate(times) for time, name in zip(two, "AB")]  # noqa: B905
    found = []
    for exact in (True, False):
        frame = pd.DataFrame(rows, columns=["time", "name", "x"])
        frame["time"] = frame["time"].round(9) if exact else frame["time"]
        log = written(tmp_path, frame, end)
        spec = "always(x.A > 2 implies eventually[0:0.2](x.B > x.A + 1))"
        code, outcome = judged(capsys, spec, log, "--wide", "name", option, "--end", "complete")
        found.append((code, outcome["trials"][0]["outcomes"]))
    assert found[0] == found[1]
    assert found[0][0] == 1


@pytest.mark.parametrize("end", [".csv", ".parquet"])
@pytest.mark.parametrize(
    ("columns", "objects", "error"),
    [
        (("x", "x.a"), ("a.b", "b"), "'x.a.b', got the column 'x' of 'a.b' or the column 'x.a' of"),
        (("x", "x.a.b"), ("a.b", "c"), "got the column 'x' of 'a.b' or a column of the file"),
    ],
)
def test_name_with_two_meanings_error(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    end: str,
    columns: tuple[str, str],
    objects: tuple[str, str],
    error: str,
) -> None:
    """Only a requirement that reads the name is refused."""
    rows = [(time, name, 1.0, 2.0) for time in range(3) for name in objects]
    log = written(tmp_path, pd.DataFrame(rows, columns=["time", "name", *columns]), end)
    words = ["monitor", "always(y < 3)", log, "--wide", "name"]
    assert main([*words, "--signal", "y=x.a.b"]) == 2
    assert error in capsys.readouterr().err
    assert main([*words, "--signal", f"y=x.{objects[1]}"]) == 0


def test_wide_groups(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = tmp_path / "log.csv"
    rows = [f"{run},{line}" for run in (1, 2) for line in LOG.splitlines()[1:]]
    log.write_text(
        "\n".join([f"run,{LOG.splitlines()[0]}", *rows]).replace("2,3,B2,-1", "2,3,B2,9")
    )
    _, found = judged(capsys, "always[2:3](x.B2 > 5)", str(log), "--wide", "name", "--by", "run")
    assert [row["name"] for row in found["trials"]] == [f"{log}[run=1]", f"{log}[run=2]"]
    assert [row["verdict"] for row in found["trials"]] == ["VIOLATED", "UNDECIDED"]


@pytest.mark.parametrize(
    ("text", "options", "error"),
    [
        (LOG, ["--wide", "nam"], "No column 'nam'."),
        (LOG, ["--wide", "name", "--wide", "x"], "one column of objects, got name and x"),
        (LOG, ["--wide", "name", "--missing", "hold"], "--missing unknown with --wide, got hold."),
        (LOG + "3,Ego,2\n", ["--wide", "name"], "line 9: expected times of 'Ego' that increase"),
        (LOG + "2,B2,2\n", ["--wide", "name"], "got a time before the row above"),
        (LOG + "4,,2\n", ["--wide", "name"], "expected the name of an object for --wide"),
        (LOG.replace("time", "k"), ["--wide", "name"], "expected a column of times"),
        (LOG.replace("B2", "C"), ["--wide", "name"], "the columns are time, x.Ego, x.C"),
    ],
)
def test_wide_errors(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, options: list[str], error: str
) -> None:
    log = tmp_path / "log.csv"
    log.write_text(text)
    assert main(["monitor", SPEC, str(log), *options]) == 2
    assert error in capsys.readouterr().err


GONE = pd.DataFrame(
    [
        (k / 10, name, float(x))
        for k in range(8)
        for name, x in (("Ego", k), ("B2", k + 12))
        if name == "Ego" or not 3 <= k < 6
    ],
    columns=["time", "name", "x"],
)
"""B2 is absent from 0.3 s to 0.5 s; the distance is 12 otherwise."""
GONE_SPECS = "always(x.B2 - x.Ego < 14)", "always(x.B2 - x.Ego > 11)"


@pytest.mark.parametrize("end", [".csv", ".parquet"])
@pytest.mark.parametrize(
    "options", [["--dense"], ["--jitter", "5%"], ["--max-gap", "1s"], ["--by", "run", "--dense"]]
)
@pytest.mark.parametrize("spec", GONE_SPECS)
def test_absent_objects_never_hold(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    end: str,
    options: list[str],
    spec: str,
) -> None:
    """No treatment of empty cells gives an absent object the value that it had before."""
    log = written(tmp_path, GONE.assign(run=1), end)
    words = ["monitor", spec, log, "--wide", "name", *options]
    assert main(words) == 3
    capsys.readouterr()
    for missing in ("drop", "hold"):
        assert main([*words, "--missing", missing]) == 2
        output = capsys.readouterr()
        text = " ".join((output.out + output.err).split())
        assert f"expected --missing unknown with --wide, got {missing}" in text


def test_wide_drop_keeps_common_samples(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Without an option that holds values, the samples of all objects are what pandas selects."""
    late = GONE[(GONE["name"] == "Ego") | (GONE["time"] > 0.5)]
    log = written(tmp_path, late, ".csv")
    table = late.pivot_table("x", "time", "name").dropna()
    code, found = judged(capsys, GONE_SPECS[0], log, "--wide", "name", "--missing", "drop")
    assert (code, found["trials"][0]["extent"]["samples"]) == (0, len(table))


OBD = (
    "SECONDS;PID;VALUE;UNITS\n0,0;Engine RPM;800;rpm\n0,1;Speed;0;km/h\n"
    "0,9;Engine RPM;2100;rpm\n1,3;Speed;15;km/h\n2,0;Engine RPM;900;rpm\n"
)
LONG = ["--dense", "--signal", "rpm=Engine RPM", "--signal", "speed=Speed"]


def test_long_tables_with_other_names(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The outcome is that of the usual names, time, variable and value."""
    spec = "always(rpm > 2000 implies eventually[0:0.5](speed > 10))"
    usual, obd = tmp_path / "usual.csv", tmp_path / "obd.csv"
    obd.write_text(OBD)
    usual.write_text(OBD.replace("SECONDS;PID;VALUE", "time;variable;value"))
    named = ["--long", "PID=VALUE", "--time", "SECONDS"]
    found = judged(capsys, spec, str(obd), *LONG, *named)
    expected = judged(capsys, spec, str(usual), *LONG)
    assert found[0] == expected[0] == 0
    assert found[1]["trials"][0]["outcomes"] == expected[1]["trials"][0]["outcomes"]
    longer = judged(capsys, spec.replace("0.5", "0.3"), str(obd), *LONG, *named)
    assert longer[0] == 1


@pytest.mark.parametrize(
    ("options", "error"),
    [
        (["--long", "PID=VALUE"], "expected --dense with --long"),
        ([*LONG, "--long", "PID"], "--long: expected NAMES=VALUES, such as PID=VALUE, got 'PID'"),
        ([*LONG, "--long", "PID=VALUE", "--wide", "PID"], "expected --long or --wide, got both"),
        ([*LONG, "--long", "PIDS=VALUE", "--time", "SECONDS"], "PIDS"),
    ],
)
def test_long_errors(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], error: str
) -> None:
    obd = tmp_path / "obd.csv"
    obd.write_text(OBD)
    assert main(["monitor", "always(rpm > 0 or speed < 9)", str(obd), *options]) == 2
    assert error in capsys.readouterr().err


CELLS = st.lists(
    st.tuples(st.sampled_from("ab"), st.sampled_from(["1", "2,5", "-3", "", "nan", "N/A"])),
    min_size=1,
    max_size=7,
)


@settings(max_examples=examples(40), deadline=None)
@given(CELLS, st.sampled_from(["hold", "drop", "unknown"]), st.booleans())
def test_empty_values_match_in_long_and_wide_tables(
    tmp_path_factory: pytest.TempPathFactory,
    cells: list[tuple[str, str]],
    missing: str,
    by: bool,  # noqa: FBT001 - from hypothesis
) -> None:
    """A file for each variable, with empty cells, has the same bounds as a row for each event."""
    folder = tmp_path_factory.mktemp("long")
    cells = [("a", "1"), ("b", "2,5"), *cells, ("a", "1"), ("b", "1")]
    rows = [f"{k};{name};{cell}" for k, (name, cell) in enumerate(cells)]
    texts = [f"{at + 0.5};state;on".replace(".", ",") for at in range(len(cells))]
    both = [row for pair in zip(rows, texts, strict=True) for row in pair]
    if by:
        both = [f"{row};{run}" for run in (1, 2) for row in both]
    log = folder / "log.csv"
    log.write_text("\n".join([f"time;PID;VALUE{';run' * by}", *both]) + "\n")
    end = folder / "end.csv"
    found = []
    for name in "ab":
        own = [f"{k};{cell}" for k, (other, cell) in enumerate(cells) if other == name]
        last = f"{len(cells) - 0.5};{cells[-1 if name == 'b' else -2][1]}".replace(".", ",")
        end.write_text("\n".join([f"time;{name}", *own, last]) + "\n")
        spec = f"always({name} > -2 or once[0:2]({name} > 2))"
        words = ["--dense", "--missing", missing, "--end", "complete", "--start", "known"]
        for path, more in ((end, []), (log, ["--long", "PID=VALUE", *(["--by", "run"] * by)])):
            target = folder / "out.xml"
            code = main(["monitor", spec, str(path), *words, *more, "--junit", str(target)])
            lines = target.read_text().splitlines()
            words_of = [
                line.split('message="')[1].split('"')[0] for line in lines if "message" in line
            ]
            found.append((code, set(words_of)))
        assert found[-1] == found[-2]


@pytest.mark.parametrize("end", [".csv", ".parquet"])
def test_empty_values_of_long_tables_hold_with_a_note(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], end: str
) -> None:
    frame = pd.DataFrame({"time": [0.0, 1, 2, 3], "PID": ["x", "x", "y", "x"]})
    log = written(tmp_path, frame.assign(VALUE=[1.0, None, 1.0, 2.0]), end)
    words = ["monitor", "always(x < 2)", log, "--dense", "--long", "PID=VALUE"]
    assert main(words) == 1
    assert "empty cells are not events: the value before holds (x: 1)" in capsys.readouterr().out
    assert main([*words, "--signal", "x=z"]) == 2
    log = written(tmp_path, frame.assign(VALUE=[None, None, 1.0, None]), end)
    capsys.readouterr()
    assert main([*words[:2], log, *words[3:]]) == 2
    assert "expected events of 'x', got none" in capsys.readouterr().err


def test_texts_of_variables_that_are_read_are_errors(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = tmp_path / "log.csv"
    words = ["monitor", "always(x < 2)", str(log), "--dense", "--long", "PID=VALUE"]
    for cell, error in (
        ("on", "log.csv, line 4, column 'VALUE': expected a number, got 'on'"),
        ("nan", "got 'nan'; give --missing drop to read nan as no event"),
        ("3,5", "line 4"),
    ):
        log.write_text(f"time;PID;VALUE\n0;x;0.5\n1;y;off\n2;x;{cell}\n3;x;1.5\n")
        assert main(words) == 2
        assert error in capsys.readouterr().err
