"""Recordings whose misreading would turn a violation into a pass, with verdicts by hand."""

from __future__ import annotations

from pathlib import Path

import pytest

from rtamt_gym.__main__ import main

Output = pytest.CaptureFixture[str]


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An empty working directory."""
    monkeypatch.chdir(tmp_path)


def judged(capsys: Output, text: str, name: str, *options: str) -> tuple[int, str]:
    """Return the exit code and the output, on one line."""
    code = main(["monitor", text, name, *options])
    output = capsys.readouterr()
    return code, " ".join((output.out + output.err).split())


def write_log(head: str, times: list[str], low: int = 15) -> str:
    """Write v = 1 at all times but one; ``head`` names ``v`` and a column of times."""
    rows = []
    for i, time in enumerate(times):
        value = "-1" if i == low else "1"
        rows.append(",".join(value if name == "v" else time for name in head.split(",")))
    Path("log.csv").write_text("\n".join([head, *rows]) + "\n")
    return "log.csv"


TENTHS = [f"{i / 10:.1f}" for i in range(30)]


@pytest.mark.parametrize(
    "head", ["frame_time,v", "step_time,v", "epoch,v", "Sample Time [s],v", "v,foo"]
)
def test_overlooked_times_are_refused_and_the_hint_is_right(capsys: Output, head: str) -> None:
    name = write_log(head, TENTHS)  # -1 at 1.5 s; in samples, [0:2] would end before it
    column = head.replace("v", "", 1).strip(",") if head.startswith("v,") else head[:-2]
    code, text = judged(capsys, "always[0:2](v > 0)", name)
    assert code == 2
    assert "--time-unit s" in text
    hint = ("--time", column, "--time-unit", "s")
    assert judged(capsys, "always[0:2](v > 0)", name, *hint)[0] == 1


def test_falling_clock_is_refused(capsys: Output) -> None:
    name = write_log("clk,v", TENTHS[::-1])
    assert judged(capsys, "always[0:1](v > 0)", name)[0] == 2
    code, text = judged(capsys, "always[0:1](v > 0)", name, "--time", "clk", "--time-unit", "s")
    assert code == 2
    assert "the newest first" in text


@pytest.mark.parametrize("column", ["odometer", "ramp", "step", "counter", "epoch", "tick_count"])
def test_counters_and_ramps_do_not_look_like_times(capsys: Output, column: str) -> None:
    name = write_log(f"{column},v", [str(10 * i) for i in range(5)], low=1)
    assert judged(capsys, "always[0:2](v > 0)", name)[0] == 1


@pytest.mark.parametrize("column", ["arc_length", "chainage", "xpos", "wheel_rot", "battery"])
def test_even_quantities_behind_other_columns_are_no_times(capsys: Output, column: str) -> None:
    name = write_log(f"v,{column}", TENTHS, low=1)
    assert judged(capsys, "always[0:2](v > 0)", name)[0] == 1


DAYS = ["20240530", "20240531", "20240601", "20240602"]


@pytest.mark.parametrize("column", ["date", "Datum", "time", "timestamp"])
@pytest.mark.parametrize("clock", ["", "1200", "120000"])
def test_dates_without_marks_are_no_seconds(capsys: Output, column: str, clock: str) -> None:
    name = write_log(f"{column},v", [day + clock for day in DAYS], low=2)
    text = "always[0:172800](v > 0)"  # two days: the third row violates it
    assert judged(capsys, text, name)[0] == 2
    code, output = judged(capsys, text, name, "--time", column)
    if column in ("date", "Datum"):
        assert (code, "one every 86400 s" in output) == (1, True)
        assert judged(capsys, "always[0:86400](v > 0)", name, "--time", column)[0] == 0
    else:
        assert code == 2
        assert "may be a date without marks" in output


def test_numbers_that_are_no_dates_stay_seconds(capsys: Output) -> None:
    name = write_log("time,v", [str(20240590 + i) for i in range(4)], low=2)
    assert judged(capsys, "always[0:2](v > 0)", name)[0] == 1


@pytest.mark.parametrize(("step", "noted"), [(10.0073, True), (0.0107, False)])
@pytest.mark.parametrize("options", [[], ["--dense"]])
def test_fractional_milliseconds_are_noted(
    capsys: Output, step: float, *, noted: bool, options: list[str]
) -> None:
    name = write_log("time,v", [f"{20.0131 + i * step:.4f}" for i in range(30)])
    output = judged(capsys, "always(v > 0)", name, *options)[1]
    assert ("if these are milliseconds" in output) is noted


@pytest.mark.parametrize(
    "column", ["object", "veh", "env", "seed", "player", "simulation", "drone"]
)
def test_objects_one_after_another_are_refused(capsys: Output, column: str) -> None:
    rows = [f"{i},{i // 3},{9 - 9 * (i // 3)}" for i in range(6)]  # the second never exceeds 5
    Path("log.csv").write_text("\n".join([f"time,{column},v", *rows]))
    code, text = judged(capsys, "eventually(v > 5)", "log.csv")
    assert code == 2
    assert f"--where {column}=0" in text
    assert judged(capsys, "eventually(v > 5)", "log.csv", "--where", f"{column}=1")[0] == 1
