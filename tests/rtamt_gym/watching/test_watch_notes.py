"""`rtamt watch` prints the notes and warnings that `rtamt monitor` prints on the same rows."""

import json
from pathlib import Path

import numpy as np
import pytest
from played import play

import rtamt
from rtamt_gym.__main__ import main
from rtamt_gym.options.evaluation import EvaluationOptions
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.watching import notes
from rtamt_gym.watching.watch import WatchOptions

Output = pytest.CaptureFixture[str]

TABLES = {
    "even": "time,x\n0,1\n100,2\n200,3\n300,1\n",
    "uneven": "time,x\n0,1\n100,2\n250,3\n300,1\n",
    "fine": "time,x\n0,1\n0.5,2\n1,3\n",
    "one": "time,x\n0,1\n",
    "unit": "time [ms],x\n0,1\n100,2\n200,3\n",
    "comma": "time;x\n0,0;1,5\n0,5;2,5\n",
    "groups": "time,x\n0,1.500\n0.5,2.250\n1,3.125\n",
    "digits": "time,x\n0,1.500\n0.5,2.250\n1,3.12\n",
    "empty": "time,x\n0,1\n0.5,\n1,2\n1.5,\n2,3\n",
}

CASES = [
    ("even", []),
    ("even", ["--dense"]),
    ("even", ["--align", "outward"]),
    ("even", ["--time-unit", "ms"]),
    ("uneven", ["--dense"]),
    ("fine", []),
    ("one", []),
    ("unit", []),
    ("comma", []),
    ("comma", ["--decimal", ","]),
    ("groups", ["--decimal", "."]),
    ("digits", ["--decimal", "."]),
    ("empty", ["--missing", "hold"]),
    ("empty", ["--missing", "drop"]),
    ("empty", ["--missing", "unknown"]),
    ("empty", ["--missing", "unknown", "--dense"]),
    ("empty", ["--missing", "hold", "--dense"]),
]


@pytest.mark.parametrize(("name", "options"), CASES)
def test_a_stream_has_the_notes_of_its_file(
    name: str, options: list[str], capsys: Output, tmp_path: Path
) -> None:
    path = tmp_path / "trace.csv"
    path.write_text(TABLES[name])
    spec = "always(x > -9)"
    code = main(["monitor", spec, str(path), "--json", *options])
    (trial,) = json.loads(capsys.readouterr().out)["trials"]
    expected = [note.replace(f"{path}, ", "") for note in trial.get("notes", [])]
    assert main(["watch", spec, str(path), *options]) == code
    assert capsys.readouterr().err.splitlines() == expected


@pytest.mark.parametrize("size", [1, 10_000])
@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("time,x\ns,V\n0,1\n1,2\n2,1\n", 0),
        ("time,x\nms,V\n0,1\n1000,2\n2000,1\n", 0),
        ("time,x\n[s],[V]\n\n0,1\n1,-2\n2,1\n", 1),
        ("# of a logger\ntime;x\ns;V\n0;1\n1;2\n2;1\n", 0),
        ("time,x,y\n,V,\n0,1,2\n1,2,3\n2,1,1\n", 0),
        ("time [s],x\nms,V\n0,1\n1,2\n", 2),
        ("time,x\nfurlong,V\n0,1\n1,2\n", 2),
        ("time,x\ns,V\n", 2),
        ("time,x\ns,V\ns,V\n0,1\n1,1\n", 2),
        ("time,x\ns,no\n0,1\n1,2\n", 0),
    ],
)
def test_a_row_of_units_is_no_row(
    text: str, code: int, size: int, capsys: Output, tmp_path: Path
) -> None:
    path = tmp_path / "trace.csv"
    path.write_text(text)
    spec = "always[0:1](x > 0)"
    assert main(["monitor", spec, str(path), "--json"]) == code
    ((trial,),) = [json.loads(capsys.readouterr().out)["trials"]] if code < 2 else [[{}]]
    options = WatchOptions({"it": rtamt.parse(spec)}, EvaluationOptions(), Columns())
    stream = play(options, text, size)
    assert stream.code == code
    if code < 2:
        messages = [note.replace("stream, ", f"{path}, ") for note in stream.watch.messages()]
        assert messages == trial["notes"]
        assert any("is a row of units" in note for note in trial["notes"])


@pytest.mark.parametrize("size", [1, 10_000])
@pytest.mark.parametrize(
    "times",
    [
        ["115958", "115959", "120000"],
        ["1158", "1159", "1200"],
        [f"{120000 + 100 * (i // 60) + i % 60}" for i in range(150)],
        [f"{1000 + i}" for i in range(150)],
        ["115958.0", "115959.5", "115961.5", "116000.5"],
        ["0", "1", "3", "3.5"],
    ],
)
def test_times_of_day_without_marks_are_refused(
    times: list[str], size: int, tmp_path: Path
) -> None:
    text = "time,x\n" + "".join(f"{time},1\n" for time in times)
    path = tmp_path / "trace.csv"
    path.write_text(text)
    code = main(["monitor", "always[0:2](x > 0)", str(path), "--dense"])
    specs = {"it": rtamt.parse("always[0:2](x > 0)")}
    options = WatchOptions(specs, EvaluationOptions(dense=True), Columns())
    stream = play(options, text, size)
    assert (stream.code, "time of day" in stream.error) == (code, code == 2)
    assert main(["watch", "always[0:2](x > 0)", str(path), "--dense", "--time-unit", "s"]) == 0


@pytest.mark.parametrize("kind", [[], ["--dense"]])
def test_two_values_at_one_time_may_be_objects(
    kind: list[str], capsys: Output, tmp_path: Path
) -> None:
    path = tmp_path / "trace.csv"
    path.write_text("time,x,kind\n0.0,1,a\n0.0,2,b\n0.5,1,a\n0.5,2,b\n1.0,1,a\n1.0,3,b\n")
    assert main(["watch", "always(x > 0)", str(path), *kind]) == 2
    assert "give --by COLUMN if rows are of several objects" in capsys.readouterr().err
    assert main(["watch", "always(x > 0)", str(path), *kind, "--by", "kind"]) == 0


def test_the_source_may_follow_options(capsys: Output, tmp_path: Path) -> None:
    path = tmp_path / "trace.csv"
    path.write_text("time,x\n0,1\n1,-1\n")
    codes = [
        main(["watch", "always(x > 0)", "--period", "1", str(path)]),
        main(["watch", "--period", "1", "always(x > 0)", str(path)]),
        main(["watch", "always(x > 0)", str(path), "--period", "1"]),
    ]
    assert codes == [1, 1, 1]
    capsys.readouterr()
    assert main(["watch", "always(x > 0)", str(path), "--period", "1", "more.csv"]) == 2
    assert "unrecognized arguments: more.csv" in capsys.readouterr().err


@pytest.mark.parametrize("options", [[], ["--dense"]])
def test_a_variable_alone_is_a_warning(options: list[str], capsys: Output, tmp_path: Path) -> None:
    path = tmp_path / "trace.csv"
    path.write_text("time,p,q\n0.0,0,0\n0.5,0,0\n")
    main(["monitor", "always(p or q)", str(path), "--json", *options])
    expected = capsys.readouterr().err.split()
    main(["watch", "always(p or q)", str(path), *options])
    assert capsys.readouterr().err.split() == expected
    assert "alone" in expected


@pytest.mark.parametrize("options", [[], ["--dense"], ["--end", "complete"], ["--view", "step"]])
@pytest.mark.parametrize(
    "spec",
    [
        "always(x > 5 implies y > 0)",
        "always(x > 0 implies y > 0)",
        "always(x > 5 implies y > 5) and always(x > 0 implies eventually[0:1](y > -9))",
        "always(x > 0 implies eventually[0:9](y > 5))",
        "always(x implies y)",
        "x > 9 implies always(y > 9)",
    ],
)
@pytest.mark.parametrize("seed", range(3))
def test_warnings_on_triggers_are_those_of_a_file(
    seed: int, spec: str, options: list[str], capsys: Output, tmp_path: Path
) -> None:
    values = np.random.default_rng(seed).integers(-2, 4, (8, 2)).tolist()
    path = tmp_path / "trace.csv"
    rows = "".join(f"{i / 2},{x},{y}\n" for i, (x, y) in enumerate(values))
    path.write_text(f"time,x,y\n{rows}")
    spec = spec if spec.startswith("always") else f"({spec}) and always(x > -9)"
    code = main(["monitor", spec, str(path), "--json", *options])
    expected = capsys.readouterr().err.split()
    assert main(["watch", spec, str(path), *options]) == code
    assert capsys.readouterr().err.split() == expected


@pytest.mark.parametrize("kind", [[], ["--dense"]])
def test_groups_count_as_traces(kind: list[str], capsys: Output, tmp_path: Path) -> None:
    path = tmp_path / "trace.csv"
    path.write_text("time,x,car\n0.0,1,a\n0.0,2,b\n0.5,1,a\n0.5,2,b\n")
    spec = "always(x > {} implies x < 9)"
    assert main(["watch", spec.format(5), str(path), "--by", "car", *kind]) == 0
    assert "never triggered: spec in 0 of 2 traces" in capsys.readouterr().err
    assert main(["watch", spec.format(1.5), str(path), "--by", "car", *kind]) == 0
    assert "never triggered" not in capsys.readouterr().err


@pytest.mark.parametrize("kind", [[], ["--dense"]])
@pytest.mark.parametrize(("rows", "counted"), [(10, True), (11, False)])
def test_triggers_of_long_streams_are_not_counted(
    rows: int,
    counted: bool,  # noqa: FBT001
    kind: list[str],
    capsys: Output,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(notes, "_MOST", 10 + notes._TRACE)
    path = tmp_path / "trace.csv"
    path.write_text("time,x\n" + "".join(f"{i / 2},1\n" for i in range(rows)))
    assert main(["watch", "always(x > 5 implies x < 9)", str(path), *kind]) == 0
    errors = capsys.readouterr().err
    assert ("never triggered: spec in 0 of 1 trace" in errors) == counted
    assert ("triggers of implications are not counted" in errors) == (not counted)


def test_the_unit_of_times_is_the_first_hint_at_a_bound(capsys: Output, tmp_path: Path) -> None:
    path = tmp_path / "trace.csv"
    path.write_text(TABLES["even"])
    assert main(["watch", "always[0:2](x > 0)", str(path)]) == 2
    errors = capsys.readouterr().err
    assert "if these are milliseconds, --time-unit ms; if seconds, --time-unit s" in errors
    assert "--align" not in errors


@pytest.mark.parametrize(
    ("spec", "offered"), [("always[0:2](x > 0)", False), ("always(x > 0)", True)]
)
def test_times_are_left_aside_only_without_bounds(
    spec: str,
    offered: bool,  # noqa: FBT001
    capsys: Output,
    tmp_path: Path,
) -> None:
    path = tmp_path / "trace.csv"
    path.write_text("time,x\n0.0,1\n1.0,1\n3.0,1\n")
    assert main(["watch", spec, str(path)]) == 2
    errors = capsys.readouterr().err
    assert "give --dense" in errors
    assert ("--period to leave the times aside" in errors) == offered


@pytest.mark.parametrize("period", ["100ms", "100", "1", "50ms", "104ms"])
@pytest.mark.parametrize(
    "times",
    [
        [0.0, 0.1, 0.2, 0.3],
        [0.0, 0.1, 0.2, 6.6, 6.7, 6.8],
        [0.0, 0.1, 0.1, 0.2],
        [0.0, 0.3, 0.4],
        [0.0],
    ],
)
def test_times_next_to_a_stated_period(
    times: list[float], period: str, capsys: Output, tmp_path: Path
) -> None:
    path = tmp_path / "trace.csv"
    path.write_text("time,x\n" + "".join(f"{time},1\n" for time in times))
    arguments = ["always(x > 0)", str(path), "--period", period]
    assert main(["monitor", *arguments, "--json"]) == 0
    captured = capsys.readouterr()
    trial = json.loads(captured.out)["trials"][0]
    notes = [note for note in trial.get("notes", []) if "aside" in note]
    assert main(["watch", *arguments]) == 0
    read = [line for line in capsys.readouterr().err.splitlines() if "aside" in line]
    assert read == notes


def test_other_times_of_groups_and_bad_lines(capsys: Output, tmp_path: Path) -> None:
    path = tmp_path / "trace.csv"
    path.write_text("time,car,x\n0,a,1\n0,b,1\n1,a,1\n9,b,1\n8,a,1\n2,c,1\n3,c,1\n")
    assert main(["watch", "always(x > 0)", str(path), "--period", "1", "--by", "car"]) == 0
    note = capsys.readouterr().err
    assert note.startswith("group 'a': --period leaves the column 'time' aside")
    assert note.endswith("8 s in all, not 2 s (and 1 more group with other times)\n")
    path.write_text("time,x\n0,1\n1,1\n2,bad\n3,1\n4,1\n")
    main(["watch", "always(x > 0)", str(path), "--period", "1", "--skip-bad"])
    assert "aside" not in capsys.readouterr().err


@pytest.mark.parametrize(
    "rows", ["0,1\n0.5,\n1,2\n1.5,\n", "0,1\n1,\n2,\n3,4\n", "0,\n1,2\n2,\n3,4\n"]
)
def test_two_rows_around_a_gap_are_no_step(rows: str, capsys: Output, tmp_path: Path) -> None:
    path = tmp_path / "trace.csv"
    path.write_text(f"time,x\n{rows}")
    file, error = [str(path), "--time-unit", "s"], "expected samples at even distances"
    for command in ["monitor"], ["watch"], ["watch", "--stop", "decided"]:
        code = main([*command, "always(x > 0)", *file, "--missing", "drop"])
        assert (code, error in capsys.readouterr().err) == (2, True)
    assert main(["watch", "always(x > -9)", *file, "--missing", "unknown"]) == 3


@pytest.mark.parametrize("first", ["a", "b"])
def test_two_rows_of_a_group_around_a_gap_are_no_step(
    first: str, capsys: Output, tmp_path: Path
) -> None:
    cars = [*((i, "a") for i in range(6)), (0, "b"), (5, "b")]
    rows = sorted(cars, key=lambda row: row[1] != first)
    path = tmp_path / "trace.csv"
    path.write_text("time,car,x\n" + "".join(f"{time},{car},5\n" for time, car in rows))
    options = [str(path), "--time-unit", "s", "--by", "car"]
    for command in "monitor", "watch":
        assert main([command, "always[0:5](x > 3)", *options]) == 2
        assert "expected samples at even distances" in capsys.readouterr().err
    assert main(["watch", "always[0:5](x > 3)", *options, "--dense"]) == 0


def drifting(rows: int) -> str:
    """A table whose rows are 1 s apart first, and 1.001 s after that."""
    times = [0.0, *(1 + 1.001 * row for row in range(rows - 1))]
    return "time,x\n" + "".join(f"{time:.3f},1\n" for time in times)


@pytest.mark.parametrize("skip", [[], ["--skip-bad"]])
@pytest.mark.parametrize("group", [[], ["--by", "id"]])
def test_rows_that_drift_from_the_first_period(
    skip: list[str], group: list[str], capsys: Output, tmp_path: Path
) -> None:
    path, bounded = tmp_path / "trace.csv", "always[0:2](x > 0)"
    path.write_text(drifting(510).replace(",1\n", ",1,a\n").replace("time,x", "time,x,id"))
    options = [str(path), "--decimal", ".", "--time-unit", "s", *skip, *group]
    assert main(["monitor", bounded, "--", str(path)]) == 2
    capsys.readouterr()
    assert main(["watch", bounded, *options]) == 2
    errors = capsys.readouterr().err
    assert "line 503: expected samples 1 s apart, as the first two are, but the later" in errors
    assert "501.5 s is sample 501. Give --period 1s to count rows" in errors
    assert main(["watch", bounded, *options, "--dense"]) == 0
    capsys.readouterr()
    assert main(["watch", "always(x > 0)", *options, "--min-duration", "509.3s"]) == 0
    assert "rows drift from the period of the first two, 1 s: 509.508 s in all" in (
        capsys.readouterr().err
    )


@pytest.mark.parametrize("text", ["always[0:2](x > 0)", "always(x > 0)"])
def test_rows_that_drift_less_than_half_a_step(text: str, capsys: Output, tmp_path: Path) -> None:
    path = tmp_path / "trace.csv"
    path.write_text(drifting(490))
    assert main(["watch", text, str(path), "--decimal", ".", "--time-unit", "s"]) == 0
    assert "drift" not in capsys.readouterr().err


@pytest.mark.parametrize("period", [[], ["--period", "1s"]])
@pytest.mark.parametrize("rows", [3, 40])
def test_a_stopped_stream_does_not_drift(
    rows: int, period: list[str], capsys: Output, tmp_path: Path
) -> None:
    path = tmp_path / "trace.csv"
    values = [*[1] * (rows - 1), -1, 1, 1]
    path.write_text("time,x\n" + "".join(f"{time}.0,{x}\n" for time, x in enumerate(values)))
    options = ["--decimal", ".", "--time-unit", "s", "--stop", "decided", *period]
    assert main(["watch", "always(x > 0)", str(path), *options]) == 1
    text = capsys.readouterr().err
    assert f"ended the stream at line {rows + 1}" in text
    assert "drift" not in text


LEFT_OUT = "x,y\n1,1\n1,{}\n1,2\n1,2\n"


@pytest.mark.parametrize("options", [[], ["--period", "1"]])
@pytest.mark.parametrize(
    ("text", "counts"),
    [("always[0:1](x + y > 0)", True), ("always(next(y > 0))", True), ("always(x + y > 0)", False)],
)
def test_dropped_row_between_counted_rows(
    text: str,
    counts: bool,  # noqa: FBT001
    options: list[str],
    capsys: Output,
    tmp_path: Path,
) -> None:
    path = tmp_path / "trace.csv"
    path.write_text(LEFT_OUT.format(""))
    options = [*options, "--missing", "drop"]
    if options[0] != "--period" and "[" in text:
        options = ["--period", "1", *options]  # rtamt watch does not count rows by itself
    for command in (["monitor", text, *options, "--", str(path)], ["watch", text, str(path)]):
        code = main(command if command[0] == "monitor" else [*command, *options])
        errors = capsys.readouterr().err
        assert ("line 4: --missing drop leaves out the row before" in errors) is counts
        assert code == (2 if counts else 0)
    assert main(["watch", text, str(path), *options, "--one-trace"]) in {0, 3}
    path.write_text(LEFT_OUT.format("1").replace("1,1\n", "1,\n", 1))
    assert main(["watch", text, str(path), *options]) in {0, 3}
