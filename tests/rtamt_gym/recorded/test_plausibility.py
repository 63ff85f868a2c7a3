"""Values outside their ranges, constant and invalid values, and verdicts without evidence."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from asammdf import MDF, Signal

import rtamt
from rtamt_gym import EvaluationOptions
from rtamt_gym.__main__ import main
from rtamt_gym.recorded.columns import Columns, Missing
from rtamt_gym.recorded.trace import EventTrace, Trace
from rtamt_gym.recorded.trace_files import read_ruled

Output = pytest.CaptureFixture[str]

SPEC = "input float x in [0, 120]; float g; p = always(x < 500 and g > 0)"
OUTSIDE = "2 of 3 values of x are outside the declared range [0, 120], the first is 130 at 1 s"


@pytest.fixture(autouse=True)
def folder(folder: Path) -> Path:
    Path("out.csv").write_text("time [s],x,g\n0,5,1\n1,130,1\n2,-1,1\n")
    Path("in.csv").write_text("time [s],x,g\n0,0,1\n1,120,2\n2,1,1\n")
    return folder


def notes(arguments: list[str], code: int, capsys: Output) -> list[str]:
    """Return the notes on one trace, whose JSON has the expected exit code."""
    assert main(["monitor", *arguments, "--json"]) == code
    kept = json.loads(capsys.readouterr().out)
    assert kept["exit_code"] == code
    return list(kept["trials"][0].get("notes", []))


@pytest.mark.parametrize("dense", [[], ["--dense"]])
def test_values_outside_declared_ranges_are_counted(dense: list[str], capsys: Output) -> None:
    assert notes([SPEC, "in.csv", *dense], 0, capsys) == []
    assert notes([SPEC, "in.csv", "--strict-ranges", *dense], 0, capsys) == []
    constant = "constant over the whole trace: g (1)"
    assert notes([SPEC, "out.csv", *dense], 0, capsys) == [OUTSIDE, constant]
    assert notes([SPEC, "out.csv", "--strict-ranges", *dense], 3, capsys) == [OUTSIDE, constant]
    worse = SPEC.replace("500", "100")
    assert notes([worse, "out.csv", "--strict-ranges", *dense], 1, capsys) == [OUTSIDE, constant]


def test_type_ranges_ignore_unknown_values(capsys: Output) -> None:
    Path("t.csv").write_text('gear\n0\n""\n300\n-1\n')
    words = ["uint8 gear; always(gear > -9)", "t.csv", "--missing", "unknown"]
    expected = (
        "2 of 4 values of gear are outside the declared range [0, 255], the first is 300 in "
        "t.csv, line 4"
    )
    assert notes([*words, "--strict-ranges"], 3, capsys)[1] == expected


def test_strict_ranges_fail_in_every_output(capsys: Output) -> None:
    words = ["monitor", SPEC, "free = always(g > 0)", "--strict-ranges", "--junit", "o.xml"]
    assert main([*words, "--", "out.csv", "in.csv"]) == 3
    assert capsys.readouterr().out.endswith("\n\noutside declared ranges: out.csv\n")
    failures = [
        (case.get("classname"), case.get("name"), failure.get("type"), failure.get("message"))
        for case in ET.parse("o.xml").iter("testcase")  # noqa: S314 - our own file
        for failure in case.iter("failure")
    ]
    assert failures == [("out.csv", "p", "out of range", OUTSIDE)]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("x,y\n1,2\n1,2\n", ["constant over the whole trace: x (1), y (2)"]),
        ("x,y\n1,2\n1,3\n", ["constant over the whole trace: x (1)"]),
        ("x,y\n1,2\n", []),
    ],
)
def test_constant_variables_are_noted(text: str, expected: list[str], capsys: Output) -> None:
    Path("t.csv").write_text(text)
    assert notes(["always(x < y)", "t.csv"], 0, capsys) == expected


@pytest.fixture(autouse=True)
def folder_passes(folder: Path) -> Path:
    """The working directory, with a trace of 10 seconds."""
    rows = (f"{i},{5 if i == 3 else 8},{i // 2 % 2}" for i in range(11))
    (folder / "trace.csv").write_text("\n".join(["time_s,x,gear", *rows]))
    return folder


WRONG_PASSES = {
    "a violated formula that is not the last": ("near = always(x > 6); slow = always(x < 9)", 1),
    "a violated formula that is not the last, and open": (
        "near = always(x > 6); late = always[20:30](x > 5)",
        1,
    ),
    "no margin": ("always(x > 5)", 1),
    "no margin that is needed": ("always(x >= 5)", 0),
    "a mode that does not hold": ("always(gear == 1)", 1),
    "a mode that holds": ("always[2:3](gear == 1)", 0),
    "a window that was never recorded": ("always[20:30](x > 5)", 3),
    "a window that was recorded in part": ("always[5:30](x > 5)", 3),
    "a window without end that begins after the trace": ("always[20:inf](x > 5)", 3),
    "an open request": ("always(x <= 5 implies eventually[0:8](x > 9))", 3),
    "an invariant over recorded time": ("always(x > 4)", 0),
}


@pytest.mark.parametrize("command", ["monitor", "explain"])
@pytest.mark.parametrize("dense", [[], ["--dense"]])
@pytest.mark.parametrize(("text", "code"), WRONG_PASSES.values(), ids=WRONG_PASSES)
def test_what_is_not_satisfied_does_not_pass(
    command: str, dense: list[str], text: str, code: int
) -> None:
    assert main([command, text, "trace.csv", *dense]) == code


@pytest.mark.parametrize("text", ["always[20:30](x > 5)", "always[20:inf](x > 5)"])
@pytest.mark.parametrize("dense", [[], ["--dense"]])
def test_end_mode_decides_unrecorded_windows(text: str, dense: list[str], capsys: Output) -> None:
    codes = [
        main(["monitor", text, "trace.csv", "--end", end, *dense])
        for end in ("open", "cut", "complete")
    ]
    assert codes == [3, 3, 0]
    capsys.readouterr()


def test_undecided_verdict_states_remedy(capsys: Output) -> None:
    assert main(["monitor", "late = always[20:30](x > 5)", "trace.csv"]) == 3
    assert capsys.readouterr().out == (
        "UNDECIDED, robustness inf\n"
        "    always[20:30](x > 5): not recorded: 20 s to 30 s\n"
        "    if nothing follows (--end complete), the verdict is SATISFIED\n"
        "trace.csv: 11 samples, one every 1 s, 0 s to 10 s, 10 s long, longest gap 1 s\n"
        "\n"
        "formula  at the start  minimum   at  violated from\n"
        "late              inf      inf  0 s              -\n"
    )


def test_unrecorded_intervals_use_trace_times(folder_passes: Path, capsys: Output) -> None:
    (folder_passes / "later.csv").write_text("time,x\n100,4\n101,8\n102,4\n")
    text = "always(x < 5 implies eventually[0:4](x > 9))"
    assert main(["monitor", text, "later.csv"]) == 3
    said = capsys.readouterr().out
    assert "\n    eventually[0:4](x > 9) at 100 s: not recorded: 103 s to 104 s\n" in said
    assert main(["monitor", text, "later.csv", "--dense"]) == 3
    said = capsys.readouterr().out
    assert "\n    eventually[0:4](x > 9) at 100 s: not recorded: 102 s to 104 s\n" in said


def test_verdicts_name_requirements(capsys: Output) -> None:
    text = "near = always(x > 6); limit = x < 9; slow = always(limit); late = always[20:30](x > 5)"
    assert main(["monitor", text, "trace.csv"]) == 1
    assert capsys.readouterr().out == (
        "near: VIOLATED, robustness -1, certain from 3 s on\n"
        "    why: decided by x > 6 at 3 s, where x = 5\n"
        "slow: SATISFIED, robustness 1, at the end of the trace\n"
        "    why: decided by x < 9 at 0 s, where x = 8\n"
        "late: UNDECIDED, robustness inf\n"
        "    always[20:30](x > 5): not recorded: 20 s to 30 s\n"
        "    if nothing follows (--end complete), the verdict is SATISFIED\n"
        "trace.csv: 11 samples, one every 1 s, 0 s to 10 s, 10 s long, longest gap 1 s\n"
        "\n"
        "spec  formula  at the start  minimum   at  violated from\n"
        "near  near               -1       -1  0 s            0 s\n"
        "slow  limit               1        1  0 s              -\n"
        "      slow                1        1  0 s              -\n"
        "late  late              inf      inf  0 s              -\n"
    )


def test_unused_helper_error(capsys: Output) -> None:
    assert main(["monitor", "near = x > 6; slow = always(x < 9)", "trace.csv"]) == 2
    assert capsys.readouterr().err == (
        "rtamt: error: requirement 'near' is about the first sample only; no other formula uses "
        "it, so that it is a requirement by itself: use it in another, write always(x > 6) or "
        "--view step\n"
    )


# Times that were taken for something else. --------------------------------------------------------

LATE = "always(req >= 3 implies eventually[0:1](gnt >= 3))"


def write_late(folder_passes: Path, column: str, step: float) -> None:
    """Write a request at 1 s that is granted at 4 s, one sample a second."""
    rows = [f"{i * step:.15g},{4 * (i == 1)},{4 * (i == 4)}" for i in range(8)]
    (folder_passes / "late.csv").write_text("\n".join([f"{column},req,gnt", *rows]))


@pytest.mark.parametrize(
    ("column", "options"),
    [("timestamp_ns", []), ("timestamp", ["--time-unit", "ns"]), ("time [ns]", [])],
)
@pytest.mark.parametrize("dense", [[], ["--dense"]])
def test_nanoseconds_are_no_seconds(
    column: str, options: list[str], dense: list[str], folder_passes: Path, capsys: Output
) -> None:
    write_late(folder_passes, column, 1e9)
    assert main(["monitor", LATE, "late.csv", *options, *dense]) == 1
    assert main(["monitor", LATE.replace("[0:1]", "[0:3]"), "late.csv", *options, *dense]) == 0
    assert ", 0 s to 7 s, 7 s long, longest gap 1 s\n" in capsys.readouterr().out


def test_a_trace_that_was_resampled_says_so(folder_passes: Path, capsys: Output) -> None:
    (folder_passes / "odd.csv").write_text("time,x\n0,6\n0.1,6\n0.2,7\n0.3,7\n0.45,6\n0.5,6\n")
    assert main(["monitor", "always[0:0.2](x > 5)", "odd.csv"]) == 2
    words = ["monitor", "always[0:0.2](x > 5)", "--jitter", "5%"]
    capsys.readouterr()
    assert main([*words, "odd.csv"]) == 0
    out = capsys.readouterr().out
    assert out.splitlines()[4].startswith("note: resampled every 0.1 s by holding values: 1 of 6 ")
    assert max(map(len, out.splitlines())) <= 80
    (folder_passes / "more.csv").write_text((folder_passes / "odd.csv").read_text())
    assert (
        main([*words, "--junit", "o.xml", "--markdown", "o.md", "--", "odd.csv", "more.csv"]) == 0
    )
    said = "note on odd.csv and 1 more: resampled every 0.1 s by holding values: 1 of 6 rows"
    assert said in " ".join(capsys.readouterr().out.split())
    assert said in (folder_passes / "o.md").read_text()
    assert (folder_passes / "o.xml").read_text().count(
        "resampled every 0.1 s by holding values"
    ) == 2


VALUES = [1.0, 2.0, -5.0, -6.0, 3.0, 4.0]
MARKED = [0, 0, 1, 1, 0, 0]


def write(
    path: Path, marked: Sequence[int] | None, values: Sequence[float] = VALUES, kind: str = "f8"
) -> str:
    """Write a measurement of x, some samples of which are marked, and of y, at other times too."""
    times = np.arange(6) / 10
    bits = None if marked is None else np.array(marked, bool)
    samples = np.array(values).astype(kind)
    with MDF(version="4.10") as file:
        file.append([Signal(samples, times, name="x", invalidation_bits=bits)])
        file.append([Signal(np.ones(6), times, name="y")])
        file.save(path, overwrite=True)
    return str(path)


@pytest.mark.parametrize("kind", ["f8", "f4", "i4"])
@pytest.mark.parametrize("time", [[], ["--dense"]])
def test_invalid_samples_do_not_pass(
    time: list[str], kind: str, tmp_path: Path, capsys: Output
) -> None:
    path = write(tmp_path / "run.mf4", MARKED, kind=kind)
    words = ["monitor", "always(x > 0 and y > 0)", path, *time]
    assert main(words) == 2
    assert capsys.readouterr().err == (
        f"rtamt: error: {path}, at 0.2 s, channel 'x': expected a number, got a sample that is nan "
        "or marked as not valid (2 samples in all); give --missing unknown, --missing hold or "
        "--missing drop\n"
    )
    assert main([*words, "--missing", "unknown"]) == 3
    said = "empty cells" if not time else "events without a number"
    assert said in capsys.readouterr().out
    for missing in ("hold", *([] if not time else ["drop"])):
        assert main([*words, "--missing", missing]) == 0
    assert main(["monitor", "always(y > 0)", path, *time]) == 0
    plain = write(tmp_path / "plain.mf4", None, kind=kind)
    assert main(["monitor", "always(x > 0 and y > 0)", plain, *time]) == 1


def test_a_sample_that_is_nan_is_no_sample(tmp_path: Path, capsys: Output) -> None:
    path = write(tmp_path / "run.mf4", None, [1.0, 2.0, np.nan, 3.0, 3.0, 4.0])
    for time in ([], ["--dense"]):
        assert main(["monitor", "always(x > 0)", path, *time]) == 2
        assert "at 0.2 s, channel 'x': expected a number, got a sample" in capsys.readouterr().err
        assert main(["monitor", "always(x > 0)", path, *time, "--missing", "unknown"]) == 3


@pytest.mark.parametrize(
    ("missing", "values"),
    [("hold", [1, 2, 2, 2, 3, 4]), ("unknown", [1, 2, None, None, 3, 4])],
)
def test_a_marked_sample_is_an_empty_cell(
    missing: Missing, values: list[float | None], tmp_path: Path
) -> None:
    path, spec = write(tmp_path / "run.mf4", MARKED), rtamt.parse("always(x > 0)")
    trace, _ = read_ruled(path, {"": spec}, EvaluationOptions(), Columns(missing=missing))
    assert isinstance(trace, Trace)
    found = [None if np.isnan(value) else value for value in trace.columns["x"]]
    assert found == values
    events, _ = read_ruled(
        path, {"": spec}, EvaluationOptions(dense=True), Columns(missing=missing)
    )
    assert isinstance(events, EventTrace)
    at, kept = events.signals["x"]
    if missing == "unknown":
        assert [None if np.isnan(value) else value for value in kept] == values
    else:
        assert np.round(at, 9).tolist() == [0.0, 0.1, 0.4, 0.5]


@pytest.mark.parametrize("suffix", [".mf4", ".csv"])
def test_times_of_a_channel_have_the_unit_of_its_name(
    suffix: str, tmp_path: Path, capsys: Output
) -> None:
    path = tmp_path / f"run{suffix}"
    x, at = np.array([1.0, 2.0, 3.0, -4.0, 5.0]), np.arange(5) * 100.0
    if suffix == ".csv":
        rows = zip(at, x, strict=True)
        path.write_text("t_ms,x\n" + "".join(f"{time},{value}\n" for time, value in rows))
    else:
        with MDF(version="4.10") as file:
            signals = {"x": x, "t_ms": at}
            file.append([Signal(cells, at / 1000, name=name) for name, cells in signals.items()])
            file.save(path, overwrite=True)
    words = ["monitor", "always[0:1](x > 0)", str(path), "--time", "t_ms"]
    for reading in ([], ["--dense"]):
        assert main([*words, *reading]) == 1
        assert "0 s to 0.4 s" in capsys.readouterr().out


def test_times_of_a_channel_at_other_times(tmp_path: Path, capsys: Output) -> None:
    path = tmp_path / "run.mf4"
    with MDF(version="4.10") as file:
        at = np.arange(5) / 10
        file.append([Signal(np.ones(5), at, name="x"), Signal(10 + at, at, name="clk")])
        file.append([Signal(np.ones(3), np.array([0.0, 0.15, 0.4]), name="y")])
        file.save(path, overwrite=True)
    words = ["--dense", "--time", "clk"]
    assert main(["monitor", "always[0:1](x + y > 0)", str(path), *words]) == 2
    expected = f"{path}: 'clk' has no record at the times of 'y'; leave --time out"
    assert expected in capsys.readouterr().err
    assert main(["monitor", "always[0:1](x > 0)", str(path), *words]) != 2


def test_other_channel_times_are_not_invalid(tmp_path: Path) -> None:
    with MDF(version="4.10") as file:
        file.append([Signal(np.ones(3), np.array([0.0, 0.2, 0.4]), name="x")])
        file.append([Signal(np.ones(5), np.arange(5) / 10, name="y")])
        file.save(tmp_path / "run.mf4", overwrite=True)
    spec = rtamt.parse("always(x > y)")
    columns = Columns(missing="unknown")
    path = str(tmp_path / "run.mf4")
    trace, _ = read_ruled(path, {"": spec}, EvaluationOptions(dense=True), columns)
    assert not trace.unknown
    trace, _ = read_ruled(path, {"": spec}, EvaluationOptions(dense=True), Columns())
    assert isinstance(trace, EventTrace)
    assert [len(at) for at, _ in trace.signals.values()] == [3, 5]
    assert not any("milliseconds" in note for note in trace.notes)
