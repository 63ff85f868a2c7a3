"""The view of a stream in the terminal, and a recording that is replayed at its pace."""

import io
import math
from collections.abc import Sequence
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.cells import cell_len
from rich.console import Console

import rtamt
from rtamt_gym.__main__ import main
from rtamt_gym.options.evaluation import EvaluationOptions
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.watching.lines import Line
from rtamt_gym.watching.screen import Course, Screen
from rtamt_gym.watching.sources import paced
from rtamt_gym.watching.watch import StreamWatch, WatchOptions

SPECS = {
    "calm": rtamt.parse("always(x < 3)"),
    "a_requirement_with_a_long_name_that_is_cut": rtamt.parse("eventually[0:9](x > 9)"),
}


def drawn(width: int, text: str, *, by: Sequence[str] = (), encoding: str = "utf-8") -> list[str]:
    """Return the lines of the picture after a stream."""
    file = io.TextIOWrapper(io.BytesIO(), encoding=encoding)
    console = Console(width=width, file=file, color_system=None, force_terminal=True)
    now = [0.0]
    screen = Screen("stdin", console, lambda: now[0])
    watch = StreamWatch(
        WatchOptions(SPECS, EvaluationOptions(), Columns(), by=by), "stdin", screen.add
    )
    for line in text.splitlines(keepends=True):
        now[0] += 0.5
        watch.add(line.encode())
        screen.update(watch.newest(), watch.rows, watch.bad)
    now[0] += 2
    console.print(screen.picture())
    file.seek(0)
    return file.read().splitlines()


@given(st.lists(st.floats(-5, 5), min_size=1, max_size=300), st.integers(4, 40))
def test_a_course_keeps_the_minimum_of_each_part(values: list[float], points: int) -> None:
    course = Course(points)
    for value in values:
        course.add(value)
    stride = 1
    while -(-len(values) // stride) > points:
        stride *= 2
    assert course.values == [min(values[i : i + stride]) for i in range(0, len(values), stride)]
    bars = course.bars(points)
    assert len(bars) == len(course.values)
    below = [math.copysign(1, value) < 0 for value in course.values]
    assert [bar in "xX" for bar in bars] == below


@pytest.mark.parametrize("width", [80, 110])
@pytest.mark.parametrize("encoding", ["utf-8", "ascii"])
def test_the_picture_fits_and_says_everything_without_colours(width: int, encoding: str) -> None:
    text = "time,x\n" + "".join(f"{i}.0,{i / 10}\n" for i in range(60))
    head, names, calm, long = drawn(width, text, encoding=encoding)
    assert all(len(line) <= width for line in (head, names, calm, long))
    assert head.split(", ") == ["stdin", "60 rows", "at 59 s", "last row 2.0 s ago"]
    assert calm.split()[:2] == ["calm", "VIOLATED"]
    assert ("30 s" in calm) == (width > 100)
    assert "-2.9" in calm
    assert calm.split()[-1].count("x") + calm.split()[-1].count("X") > 4
    assert long.startswith("a_requirement_w")
    if encoding == "ascii":
        assert all(line.isascii() for line in (head, calm, long))


def test_of_many_groups_the_worst_are_shown() -> None:
    rows = [f"{time},{car % 7},car {car:02}" for time in (0, 1) for car in range(30)]
    lines = drawn(120, "\n".join(["time,x,car", *rows, ""]), by=("car",))
    assert len(lines) == 2 + 20 + 1
    assert lines[-1] == "and 40 rows with a higher robustness"
    assert all("VIOLATED" in line for line in lines[2:10])


@pytest.mark.parametrize("width", [40, 80, 100, 120])
def test_numbers_are_not_cut(width: int) -> None:
    """Names are cut, and columns are omitted, before a number would be cut."""
    group = "a_group_with_a_long_name_"
    rows = [f"{time},-1.25e+123,{group * 3}{car}" for time in range(4) for car in "ab"]
    _, names, *lines = drawn(width, "\n".join(["time,x,car", *rows, ""]), by=("car",))
    assert max(map(len, (names, *lines))) <= width
    calm = lines[::2]
    assert [line.split()[0][-1] for line in calm] == ["a", "b"]
    assert all("UNDECIDED" in line for line in calm)
    assert all(("-inf .. 1.25e+123" in line) == ("bounds" in names) for line in calm)
    assert ("bounds" in names) == (width > 40)


def test_wide_letters_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(SPECS, "\u6f22" * 30, rtamt.parse("always(x < 3)"))
    *_, line = drawn(80, "time,x\n0,1\n1,2\n")
    assert cell_len(line) <= 80
    assert line.split()[0].endswith("...")


def test_unknown_and_tiny_values_in_a_course() -> None:
    course = Course(points=3)
    for value in (math.nan, -1.0, 1e-320, 2.0, 1e10, math.nan):
        course.add(value)
    assert course.bars(3) == "X\u2581\u2588"
    assert course.bars(1) == "X"
    infinite = Course()
    for value in (math.inf, -math.inf, -0.0, math.nan, 2.0):
        infinite.add(value)
    assert infinite.bars(5) == "\u2588Xx \u2588"


def test_the_screen_needs_a_terminal(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "trace.csv"
    path.write_text("time,x\n0,1\n1,1\n")
    assert main(["watch", "always(x < 3)", str(path), "--screen"]) == 2
    assert "--screen draws on a terminal" in capsys.readouterr().err


@pytest.mark.parametrize("arguments", [["-", "--speed", "2"], ["trace.csv", "--speed", "0"]])
def test_what_cannot_be_replayed_is_refused(
    arguments: Sequence[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("trace.csv").write_text("time,x\n0,1\n1,1\n")
    assert main(["watch", "always(x < 3)", *arguments]) == 2
    assert "--speed" in capsys.readouterr().err


def test_rows_without_times_are_not_replayed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("bare.csv").write_text("x\n1\n1\n")
    arguments = ["watch", "always(x < 3)", "bare.csv", "--speed", "1e6"]
    assert main(arguments) == 2
    assert "Give --period TIME" in capsys.readouterr().err
    assert main([*arguments, "--period", "0.1"]) == 0
    assert main(arguments[:-2]) == 0
    for rows in ("time,x\n0,1\n1,1\n", "date,x\n2024-05-01,1\n2024-05-02,1\n"):
        Path("bare.csv").write_text(rows)
        assert main(arguments) == 0
        assert main([*arguments, "--dense"]) == 0


@given(st.lists(st.integers(1, 50), min_size=2, max_size=20), st.integers(1, 8))
def test_rows_come_when_they_are_due(steps: list[int], speed: int) -> None:
    times = [sum(steps[:i]) / 8 for i in range(len(steps))]
    text = "time,x\n" + "".join(f"{time},1\n" for time in times)
    lines: list[Line] = []
    options = WatchOptions({"it": SPECS["calm"]}, EvaluationOptions(dense=True), Columns())
    watch = StreamWatch(options, "stdin", lines.append)
    now = [100.0]
    came: list[float] = []

    def pause(seconds: float) -> None:
        now[0] += seconds

    for block in paced([text.encode()], watch.seconds, speed, lambda: now[0], pause):
        watch.add(block)
        if block and watch.rows > len(came):
            came.append(now[0] - 100.0)
    due = [0.0, *(time / speed for time in times[:-1])]
    assert came == pytest.approx(due)
