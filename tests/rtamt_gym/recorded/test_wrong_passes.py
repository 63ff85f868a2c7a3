"""What once passed as satisfied on the command line, and what each says now."""

from __future__ import annotations

from pathlib import Path

import pytest

from rtamt_gym.__main__ import main

Output = pytest.CaptureFixture[str]


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working directory, with a trace of 10 seconds."""
    monkeypatch.chdir(tmp_path)
    rows = (f"{i},{5 if i == 3 else 8},{i // 2 % 2}" for i in range(11))
    (tmp_path / "trace.csv").write_text("\n".join(["time_s,x,gear", *rows]))
    return tmp_path


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
def test_the_end_decides_what_a_window_that_was_not_recorded_says(
    text: str, dense: list[str], capsys: Output
) -> None:
    codes = [
        main(["monitor", text, "trace.csv", "--end", end, *dense])
        for end in ("open", "cut", "complete")
    ]
    assert codes == [3, 3, 0]
    capsys.readouterr()


def test_an_undecided_verdict_says_what_was_not_recorded_and_the_way_out(capsys: Output) -> None:
    assert main(["monitor", "late = always[20:30](x > 5)", "trace.csv"]) == 3
    assert capsys.readouterr().out == (
        "UNDECIDED, robustness inf\n"
        "    always[20:30](x > 5): not recorded: 20 s to 30 s\n"
        "    if the trace is all there is, --end complete says SATISFIED\n"
        "trace.csv: 11 samples, one every 1 s, 0 s to 10 s, 10 s long, longest gap 1 s\n"
        "\n"
        "formula  at the start  least   at  violated from\n"
        "late              inf    inf  0 s              -\n"
    )


def test_what_was_not_recorded_is_told_in_the_times_of_the_trace(
    folder: Path, capsys: Output
) -> None:
    (folder / "later.csv").write_text("time,x\n100,4\n101,8\n102,4\n")
    text = "always(x < 5 implies eventually[0:4](x > 9))"
    assert main(["monitor", text, "later.csv"]) == 3
    said = capsys.readouterr().out
    assert "\n    eventually[0:4](x > 9) at 100 s: not recorded: 103 s to 104 s\n" in said
    assert main(["monitor", text, "later.csv", "--dense"]) == 3
    said = capsys.readouterr().out
    assert "\n    eventually[0:4](x > 9) at 100 s: not recorded: 102 s to 104 s\n" in said


def test_each_requirement_is_named_with_its_verdict(capsys: Output) -> None:
    text = "near = always(x > 6); limit = x < 9; slow = always(limit); late = always[20:30](x > 5)"
    assert main(["monitor", text, "trace.csv"]) == 1
    assert capsys.readouterr().out == (
        "near: VIOLATED, robustness -1, certain from 3 s on\n"
        "slow: SATISFIED, robustness 1, at the end of the trace\n"
        "late: UNDECIDED, robustness inf\n"
        "    always[20:30](x > 5): not recorded: 20 s to 30 s\n"
        "    if the trace is all there is, --end complete says SATISFIED\n"
        "trace.csv: 11 samples, one every 1 s, 0 s to 10 s, 10 s long, longest gap 1 s\n"
        "\n"
        "spec  formula  at the start  least   at  violated from\n"
        "near  near               -1     -1  0 s            0 s\n"
        "slow  limit               1      1  0 s              -\n"
        "      slow                1      1  0 s              -\n"
        "late  late              inf    inf  0 s              -\n"
    )


def test_a_helper_that_nothing_uses_is_refused_by_its_name(capsys: Output) -> None:
    assert main(["monitor", "near = x > 6; slow = always(x < 9)", "trace.csv"]) == 2
    assert capsys.readouterr().err == (
        "rtamt: error: requirement 'near' speaks of the first sample only; no other formula uses "
        "it, so that it is a requirement by itself: use it in another, write always(x > 6) or "
        "--view step\n"
    )


# Times that were taken for something else. --------------------------------------------------------

LATE = "always(req >= 3 implies eventually[0:1](gnt >= 3))"


def write_late(folder: Path, column: str, step: float) -> None:
    """A request at 1 s that is granted at 4 s, one sample a second."""
    rows = [f"{i * step:.15g},{4 * (i == 1)},{4 * (i == 4)}" for i in range(8)]
    (folder / "late.csv").write_text("\n".join([f"{column},req,gnt", *rows]))


@pytest.mark.parametrize("column", ["time", "timestamp", "t", "stamp", "Time [s]"])
@pytest.mark.parametrize("dense", [[], ["--dense"]])
def test_a_column_of_times_is_no_index(column: str, dense: list[str], folder: Path) -> None:
    write_late(folder, column, 0.5)  # granted after 1.5 s, 3 samples
    assert main(["monitor", LATE, "late.csv", *dense]) == 1
    assert main(["monitor", LATE.replace("[0:1]", "[0:1.5]"), "late.csv", *dense]) == 0


@pytest.mark.parametrize(
    ("column", "options"),
    [("timestamp_ns", []), ("timestamp", ["--time-unit", "ns"]), ("time [ns]", [])],
)
@pytest.mark.parametrize("dense", [[], ["--dense"]])
def test_nanoseconds_are_no_seconds(
    column: str, options: list[str], dense: list[str], folder: Path, capsys: Output
) -> None:
    write_late(folder, column, 1e9)
    assert main(["monitor", LATE, "late.csv", *options, *dense]) == 1
    assert main(["monitor", LATE.replace("[0:1]", "[0:3]"), "late.csv", *options, *dense]) == 0
    assert ", 0 s to 7 s, 7 s long, longest gap 1 s\n" in capsys.readouterr().out


@pytest.mark.parametrize("dense", [[], ["--dense"]])
def test_times_that_can_hardly_be_seconds_need_a_unit(
    dense: list[str], folder: Path, capsys: Output
) -> None:
    write_late(folder, "timestamp", 1e9)
    assert main(["monitor", LATE, "late.csv", *dense]) == 2
    assert "; say the unit with --time-unit, such as ns, ms or s\n" in capsys.readouterr().err


def test_a_trace_that_was_resampled_says_so(folder: Path, capsys: Output) -> None:
    (folder / "odd.csv").write_text("time,x\n0,6\n0.1,6\n0.2,7\n0.3,7\n0.45,6\n0.5,6\n")
    assert main(["monitor", "always[0:0.2](x > 5)", "odd.csv"]) == 2
    words = ["monitor", "always[0:0.2](x > 5)", "--jitter", "5%"]
    capsys.readouterr()
    assert main([*words, "odd.csv"]) == 0
    out = capsys.readouterr().out
    assert out.splitlines()[3].startswith("note: resampled every 0.1 s by holding values: 1 of 6 ")
    assert max(map(len, out.splitlines())) <= 80
    (folder / "more.csv").write_text((folder / "odd.csv").read_text())
    assert (
        main([*words, "--junit", "o.xml", "--markdown", "o.md", "--", "odd.csv", "more.csv"]) == 0
    )
    said = "note on odd.csv and 1 more: resampled every 0.1 s by holding values: 1 of 6 rows"
    assert said in " ".join(capsys.readouterr().out.split())
    assert said in (folder / "o.md").read_text()
    assert (folder / "o.xml").read_text().count("resampled every 0.1 s by holding values") == 2
