"""Recordings whose misreading would turn a violation into a pass, with verdicts by hand."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from asammdf import MDF, Signal
from scipy.io import savemat

from rtamt_gym.__main__ import main

Output = pytest.CaptureFixture[str]


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
def test_overlooked_times_error_and_hint(capsys: Output, head: str) -> None:
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
def test_counters_and_ramps_are_not_times(capsys: Output, column: str) -> None:
    name = write_log(f"{column},v", [str(10 * i) for i in range(5)], low=1)
    assert judged(capsys, "always[0:2](v > 0)", name)[0] == 1


@pytest.mark.parametrize("column", ["arc_length", "chainage", "xpos", "wheel_rot", "battery"])
def test_even_later_columns_are_not_times(capsys: Output, column: str) -> None:
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


ROWS = range(8)


def write_blocks(column: str, names: tuple[object, object], value: str = "v") -> str:
    """Write two objects, one after the other; only the second exceeds 5."""
    rows = [f"{i},{names[i // 4]},{1 + 8 * (i // 4)}" for i in ROWS]
    Path("log.csv").write_text("\n".join([f"time,{column},{value}", *rows]) + "\n")
    return "log.csv"


@pytest.mark.parametrize(
    ("column", "names"),
    [
        ("topic", ("/a", "/b")),
        ("metric", ("cpu", "memory")),
        ("sensor", ("s1", "s2")),
        ("child_frame_id", ("base", "arm")),
        ("filename", ("a.log", "b.log")),
        ("unit", (1, 2)),
        ("driver", (3, 4)),
        ("Subject", (3, 4)),
        ("batch_idx", (0, 1)),
        ("random_seed", (7, 8)),
        ("mc_run", (3, 4)),
        ("MMSI", (211, 212)),
        ("part no", (17, 18)),
    ],
)
def test_more_objects_are_refused(
    capsys: Output, column: str, names: tuple[object, object]
) -> None:
    name = write_blocks(column, names)
    code, text = judged(capsys, "eventually(v > 5)", name)
    assert (code, f"--where '{column}" in text or f"--where {column}" in text) == (2, True), text
    way = ("--where", f"{column}={names[0]}")
    assert judged(capsys, "eventually(v > 5)", name, *way)[0] == 1


@pytest.mark.parametrize(
    ("column", "names"),
    [
        ("driver", (0, 1)),
        ("device", (1, 0)),
        ("dry_run", (0, 1)),
        ("car", (2, 3)),
        ("gear", ("a", "b")),
        ("test", ("on", "off")),
    ],
)
def test_flags_and_counts_are_no_objects(
    capsys: Output, column: str, names: tuple[object, object]
) -> None:
    assert judged(capsys, "eventually(v > 5)", write_blocks(column, names))[0] == 0


@pytest.mark.parametrize("column", ["variable", "signal", "field", "_field", "kind", "VarName"])
@pytest.mark.parametrize("value", ["value", "_value", "VarValue", "Messwert"])
def test_value_column_next_to_signals(capsys: Output, column: str, value: str) -> None:
    name = write_blocks(column, ("a", "b"), value)
    code, text = judged(capsys, f"eventually({value} > 5)", name)
    assert (code, f"--where {column}=a" in text) == (2, True)


@pytest.mark.parametrize(
    ("column", "names"),
    [
        ("state", ("run", "stop")),
        ("quality", ("good", "bad")),
        ("open", ("yes", "no")),
        ("received", ("2024-05-01", "2024-05-02")),
    ],
)
def test_states_next_to_values_are_no_signals(
    capsys: Output, column: str, names: tuple[object, object]
) -> None:
    assert judged(capsys, "eventually(value > 5)", write_blocks(column, names, "value"))[0] == 0


@pytest.mark.parametrize(
    ("head", "cells"),
    [
        ("step", "0 1 2 3 0 1 2 3"),
        ("frame", "1 2 3 4 1 2 3 4"),
        ("", "0 1 2 3 0 1 2 3"),
        ("Unnamed: 0", "0 1 2 3 0 1 2 3"),
        ("clk", "0.0 0.1 0.2 0.3 0.0 0.1 0.2 0.3"),
        ("A", "0.0 0.1 0.2 0.3 0.0 0.1 0.2 0.3"),
        ("obs,terminated", "7,False 7,False 7,False 7,True 7,False 7,False 7,False 7,True"),
        ("obs,done", "7,0 7,0 7,0 7,1 7,0 7,0 7,0 7,1"),
        ("obs,is_first", "7,1 7,0 7,0 7,0 7,1 7,0 7,0 7,0"),
        ("sim_time,wall_time", "0,5 1,6 2,7 3,8 0,9 1,10 2,11 3,12"),
    ],
)
def test_runs_without_times_are_refused(capsys: Output, head: str, cells: str) -> None:
    rows = [f"{cell},{1 + 8 * (i // 4)}" for i, cell in enumerate(cells.split())]
    Path("log.csv").write_text("\n".join([f"{head},v", *rows]) + "\n")
    code, text = judged(capsys, "eventually(v > 5)", "log.csv")
    assert code == 2
    assert "another one starts in line 6. Cut the file there, or give --one-trace" in text
    assert judged(capsys, "eventually(v > 5)", "log.csv", "--one-trace")[0] == 0
    Path("log.csv").write_text("\n".join([f"{head},v", *rows[:4]]) + "\n")
    assert judged(capsys, "eventually(v > 5)", "log.csv")[0] == 1


@pytest.mark.parametrize(
    ("column", "cells"),
    [
        ("gear", "1 2 3 4 1 2 3 4"),
        ("alive_counter", "0 1 2 3 0 1 2 3"),
        ("phase", "0.0 0.1 0.2 0.3 0.0 0.1 0.2 0.3"),
        ("step", "0 0 1 1 0 0 1 1"),
        ("done", "0 0 0 0 0 0 0 1"),
    ],
)
def test_cycles_are_one_trace(capsys: Output, column: str, cells: str) -> None:
    rows = [f"{cell},{1 + 8 * (i // 4)}" for i, cell in enumerate(cells.split())]
    Path("log.csv").write_text("\n".join([f"{column},v", *rows]) + "\n")
    assert judged(capsys, "eventually(v > 5)", "log.csv")[0] == 0


@pytest.mark.parametrize(
    "head", ["t1,v,t2,w", "time,v,time.1,w", "time_v,v,time_w,w", "Time - v,v,Time - w,w"]
)
@pytest.mark.parametrize("formula", ["always(v < 4 or w < 4)", "always[0:0.3](v < 4 or w < 4)"])
def test_columns_with_own_times_error(capsys: Output, head: str, formula: str) -> None:
    # v falls and w rises at the same time, but w was recorded at twice the rate
    rows = [f"{i / 10:.1f},{8 - i},{i / 20:.2f},{i}" for i in ROWS]
    Path("log.csv").write_text("\n".join([head, *rows]) + "\n")
    assert judged(capsys, formula, "log.csv")[0] == 2
    if "[" not in formula:
        assert "differs from" in judged(capsys, formula, "log.csv")[1]
        first = ("--time", head.split(",", maxsplit=1)[0])
        assert judged(capsys, formula, "log.csv", *first)[0] == 1
    same = [f"{i / 10:.1f},{8 - i},{i / 10:.1f},{i}" for i in ROWS]
    Path("log.csv").write_text("\n".join([head, *same]) + "\n")
    assert judged(capsys, "always(v < 4 or w < 4)", "log.csv")[0] == 1


@pytest.mark.parametrize("head", ["timestamp,timestamp_sample,v", "time,v,log_time,w"])
def test_clocks_of_one_rate_are_one_clock(capsys: Output, head: str) -> None:
    cells = {"v": "1", "w": "1", "timestamp_sample": "{}", "timestamp": "{}", "time": "{}"}
    rows = []
    for i in ROWS:
        late = f"{1.7e9 + i / 10 + 0.001 * (i % 3):.3f}"
        row = [cells.get(n, late).format(f"{i / 10:.1f}") for n in head.split(",")]
        rows.append(",".join(row))
    Path("log.csv").write_text("\n".join([head, *rows]) + "\n")
    assert judged(capsys, "always[0:0.3](v > 0)", "log.csv")[0] == 0


@pytest.mark.parametrize(
    ("column", "times", "way"),
    [
        ("hour", range(8), "--time hour --time-unit h"),
        ("Minute", range(8), "--time Minute --time-unit min"),
        ("hour", [22, 23, 0, 1, 2, 3, 4, 5], "--period SECONDS"),
        ("day", range(1, 9), "--period SECONDS"),
        ("Date", range(45413, 45421), "--period SECONDS"),
        ("year", range(1990, 1998), "--period SECONDS"),
    ],
)
def test_parts_of_dates_do_not_count_samples(
    capsys: Output, column: str, times: list[int], way: str
) -> None:
    name = write_log(f"{column},v", [*map(str, times)], low=2)
    code, text = judged(capsys, "eventually[0:2](v < 0)", name)
    assert (code, way in text) == (2, True), text
    if way.startswith("--time"):
        assert judged(capsys, "eventually[0:2](v < 0)", name, *way.split())[0] == 2
        assert judged(capsys, "always[0:1h](v < 9)", name, *way.split())[0] in (0, 3)
    else:
        assert judged(capsys, "eventually(v < 0)", name, "--time", column)[0] == 2
    assert judged(capsys, "eventually[0:2](v < 0)", name, "--period", "1")[0] == 0


@pytest.mark.parametrize(
    ("start", "step"), [(45413.5, 1), (45413.5, 3600), (739000.5, 0.1), (0.5, 1), (2460432.5, 60)]
)
def test_dates_as_days_are_no_seconds(capsys: Output, start: float, step: float) -> None:
    name = write_log("Time,v", [f"{start + i * step / 86400:.9f}" for i in range(30)])
    code, text = judged(capsys, "eventually[0:1](v < 0)", name)
    assert (code, "may be a date" in text) == (2, True), text


@pytest.mark.parametrize(("start", "step"), [(45413.5, 0.01), (45413.5, 1 / 30), (0.5, 1e-5)])
def test_seconds_are_no_days(capsys: Output, start: float, step: float) -> None:
    name = write_log("time,v", [f"{start + i * step:.7f}" for i in range(30)])
    assert judged(capsys, "always(v > 0)", name)[0] == 1


@pytest.mark.parametrize("column", ["recv_ms", "clk [ms]"])
def test_a_named_column_has_the_unit_in_its_name(capsys: Output, column: str) -> None:
    name = write_log(f"v,{column}", [str(100 * i) for i in range(30)])
    code, text = judged(capsys, "always[0:2](v > 0)", name, "--time", column)
    assert (code, "one every 0.1 s" in text) == (1, True)


@pytest.mark.parametrize("mark", ["", "\ufeff"])
def test_a_stated_separator_is_obeyed(capsys: Output, mark: str) -> None:
    rows = [f"{i / 10:.1f};{-1 if i == 15 else 1}".replace(".", ",") for i in range(30)]
    Path("log.csv").write_text(f"{mark}sep=;\nZeit;v\n" + "\n".join(rows) + "\n", "utf-8")
    code, text = judged(capsys, "always[0:2](v > 0)", "log.csv")
    assert (code, "one every 0.1 s" in text) == (1, True)


def test_annotations_of_influx_are_not_the_names(capsys: Output) -> None:
    above = "#group,false,true\n#datatype,string,double\n#default,_result,\n,_time,_value\n"
    rows = [f",2024-05-01T12:00:0{i}Z,{-1 if i == 3 else 1}" for i in ROWS]
    Path("log.csv").write_text(above + "\n".join(rows) + "\n")
    code, text = judged(capsys, "always[0:3](_value > 0)", "log.csv")
    assert (code, "line 4" in text) == (1, True)


VALUES = [-1 if i == 15 else 1 for i in range(30)]  # in samples, [0:2] would end before it


@pytest.mark.parametrize(
    "line",
    [
        "# dt = 0.1",
        "# Sample Rate: 10 Hz",
        "Sample Interval,1.0E-1,s",
        "% sampling period: 100 ms",
        "Sampling frequency [Hz]: 10",
    ],
)
def test_period_above_names_error(capsys: Output, line: str) -> None:
    rows = "\n".join(f"{value},0" for value in VALUES)
    Path("log.csv").write_text(f"{line}\nRecord,1,a\nv,w\n{rows}\n")
    code, text = judged(capsys, "always[0:2](v > 0)", "log.csv")
    assert (code, "Give --period 1/10, or --period 1 to count samples" in text) == (2, True), text
    assert judged(capsys, "always[0:2](v > 0)", "log.csv", "--period", "1/10")[0] == 1
    assert judged(capsys, "always[0:2](v > 0)", "log.csv", "--period", "1")[0] == 0
    assert judged(capsys, "always(v > 0)", "log.csv")[0] == 1


@pytest.mark.parametrize("head", ["dt,v", "v,sample_time_s", "v,Delta_X"])
def test_period_column_error(capsys: Output, head: str) -> None:
    name = write_log(head, ["0.1"] * 30)
    code, text = judged(capsys, "always[0:2](v > 0)", name)
    assert (code, "Give --period 1/10" in text) == (2, True), text
    assert judged(capsys, "always[0:2](v > 0)", write_log("gain,v", ["0.1"] * 30))[0] == 0


@pytest.mark.parametrize(("name", "value"), [("dt", 0.1), ("Ts", 0.1), ("fs", 10)])
@pytest.mark.parametrize("extension", ["npz", "mat"])
def test_period_next_to_arrays_error(
    capsys: Output, name: str, value: float, extension: str
) -> None:
    file = f"log.{extension}"
    columns = {name: np.array(value), "gain": np.array(2.0), "v": np.array(VALUES, float)}
    if extension == "mat":
        savemat(file, columns)
    else:
        np.savez(file, allow_pickle=False, **columns)
    code, text = judged(capsys, "always[0:2](v > 0)", file)
    assert (code, "Give --period 1/10" in text) == (2, True), text


@pytest.mark.parametrize("column", ["index", "Unnamed: 0", "__index_level_0__"])
def test_an_index_of_fractions_is_one_of_times(capsys: Output, column: str) -> None:
    name = write_log(f"v,{column}", TENTHS)
    code, text = judged(capsys, "always[0:2](v > 0)", name)
    assert (code, "--time-unit s" in text) == (2, True), text
    hint = ("--time", column, "--time-unit", "s")
    assert judged(capsys, "always[0:2](v > 0)", name, *hint)[0] == 1
    name = write_log(f"v,{column}", [str(10 * i) for i in range(30)], low=1)
    assert judged(capsys, "always[0:2](v > 0)", name)[0] == 1


@pytest.mark.parametrize(
    ("domain", "words"), [(2, "angle ('axis')"), (3, "distance"), (4, "row numbers"), (None, "")]
)
def test_records_over_other_axes_are_no_times(
    capsys: Output, domain: int | None, words: str
) -> None:
    path, master = Path("log.mf4"), ("axis", domain or 1)
    for name in ("v", "w"):
        with MDF(path) if path.exists() else MDF() as file:
            own = master if name == "v" else ("time", 1)
            at = np.arange(30.0)
            file.append([Signal(np.array(VALUES, float), at, name=name, master_metadata=own)])
            if name == "w" and domain is None:
                axis: Any = file.groups[0].channels[file.masters_db[0]]
                axis.channel_type = axis.sync_type = 0
            file.save(Path("new.mf4"), overwrite=True)
        Path("new.mf4").replace(path)
    code, text = judged(capsys, "always[0:2](v > 0)", "log.mf4")
    assert (code, "expected records over time" in text, words in text) == (2, True, True), text
    assert judged(capsys, "always(w > 0)", "log.mf4")[0] == 1
    assert judged(capsys, "always(w > 0)", "log.mf4", "--dense")[0] == 1


@pytest.mark.parametrize("step", [625, 16000, 40])
def test_late_integers_are_not_seconds(capsys: Output, step: int) -> None:
    name = write_log("timestamp,v", [str(12_345_678 + step * i) for i in range(30)])
    code, text = judged(capsys, "always(v > 0)", name)
    assert (code, "--time-unit" in text, " as ms" in text or " as us" in text) == (2, True, True)
    assert judged(capsys, "always(v > 0)", name, "--time-unit", "us")[0] == 1
    for start in (0, 1_700_000_000, 345_678):
        name = write_log("timestamp,v", [str(start + 60 * i) for i in range(30)])
        assert judged(capsys, "always(v > 0)", name)[0] == 1


def test_rounded_times_have_no_choice_of_records(capsys: Output) -> None:
    name = write_log("time,v", [str(1_700_000_000 + i // 10) for i in range(40)])
    code, text = judged(capsys, "always(v > 0)", name)
    assert (code, "--same-time" in text) == (2, True)  # at one time only
    rows = [f"{i // 3},{i}" for i in range(30)]
    Path("log.csv").write_text("\n".join(["time,v", *rows]) + "\n")
    for options in ([], ["--dense"]):
        code, text = judged(capsys, "always(v < 20)", "log.csv", *options)
        assert (code, "as if times were rounded" in text, "--same-time" in text) == (2, True, False)


def test_events_without_rows_error(capsys: Output) -> None:
    Path("log.csv").write_text("a,v\n")
    code, text = judged(capsys, "always[0:1](v > 0)", "log.csv", "--dense")
    assert (code, "no column 'time', which --dense reads" in text) == (2, True)


def test_unnamed_days_are_not_seconds(capsys: Output) -> None:
    name = write_log("A,v", [f"{45413.5 + i / 24:.8f}" for i in range(30)], low=2)
    code, text = judged(capsys, "eventually[0:3600](v < 0)", name)
    assert (code, "--period SECONDS" in text, "--time-unit" in text) == (2, True, False)


@pytest.mark.parametrize(
    "times",
    [
        ["115930", "115945", "120000", "120015"],
        ["225958.5", "225959.0", "225959.5", "230000.0"],
        ["1158", "1159", "1200", "1201"],
        ["1000", "1030", "1100", "1130"],
        ["90058", "90059", "90100", "90101"],
    ],
)
@pytest.mark.parametrize("options", [[], ["--dense"], ["--jitter", "5%"]])
def test_unmarked_times_of_day_are_not_seconds(
    capsys: Output, times: list[str], options: list[str]
) -> None:
    name = write_log("UTC time,v", times, low=3)
    assert judged(capsys, "always(v > -5)", name, *options)[0] == 2
    code, text = judged(capsys, "always[0:9](v > -5)", write_log("UTC,v", times, low=3))
    assert (code, "--time-unit" in text) == (2, False)
    name = write_log("UTC time,v", ["1157", "1158", "1159", "1160"], low=3)
    assert judged(capsys, "always(v > -5)", name, *options)[0] == 0


@pytest.mark.parametrize("column", ["room", "location", "zone", "wheel"])
def test_interleaved_records_error(capsys: Output, column: str) -> None:
    rows = [f"{i + 0.01 * k:.2f},{name},{9 * k}" for i in ROWS for k, name in enumerate("ab")]
    Path("log.csv").write_text("\n".join([f"time,{column},v", *rows]) + "\n")
    for options in ([], ["--dense"], ["--jitter", "5%"]):
        code, text = judged(capsys, "eventually(v > 5)", "log.csv", *options)
        assert (code, f"--where {column}=a" in text) == (2, True)
    assert judged(capsys, "eventually(v > 5)", "log.csv", "--where", f"{column}=a")[0] == 1


@pytest.mark.parametrize("cells", ["aaaabbbbccccdddd", "abcdefghijklmnop", "aaaaaaaabbbbbbbb"])
def test_texts_of_one_trace_stay_readable(capsys: Output, cells: str) -> None:
    rows = [f"{i + 0.1 * (i % 2):.2f},{cell},{i}" for i, cell in enumerate(cells)]
    Path("log.csv").write_text("\n".join(["time,room,v", *rows]) + "\n")
    assert judged(capsys, "eventually(v > 5)", "log.csv", "--dense")[0] == 0


def test_several_parts_of_dates_are_not_one_time(capsys: Output) -> None:
    rows = [f"{90 * i // 60},{90 * i % 60},{-1 if i == 2 else 1}" for i in ROWS]
    Path("log.csv").write_text("\n".join(["minute,second,v", *rows]) + "\n")
    code, text = judged(capsys, "eventually[0:3](v < 0)", "log.csv")
    assert (code, "--period SECONDS" in text, "--time" in text) == (2, True, False)


@pytest.mark.parametrize("label", ["Sum", "", "N/A"])
def test_a_row_of_totals_is_not_a_sample(capsys: Output, label: str) -> None:
    rows = "0,1\n1,1\n2,1\n3,1\n"
    Path("log.csv").write_text(f"row,v\n{rows}{label},4\n")
    code, text = judged(capsys, "eventually(v > 3)", "log.csv")
    assert (code, "a row of totals" in text) == (2, True)
    assert judged(capsys, "eventually(v > 3)", "log.csv", "--one-trace")[0] == 0
    Path("log.csv").write_text(f"row,v\n{rows}")
    assert judged(capsys, "eventually(v > 3)", "log.csv")[0] == 1


def test_the_line_with_the_names_is_proposed(capsys: Output) -> None:
    rows = "\n".join(f"{i / 10:.1f},{value}" for i, value in enumerate(VALUES))
    Path("log.csv").write_text(f'Model,MSO44\nInterval,0.1\n\n"TIME","CH1"\n{rows}\n')
    code, text = judged(capsys, "always[0:2](CH1 > 0)", "log.csv")
    assert (code, "give --skip 3 if line 4, which has 'CH1', has the names" in text) == (2, True)
    assert judged(capsys, "always[0:2](CH1 > 0)", "log.csv", "--skip", "3")[0] == 1


def test_accepted_tables_of_the_page(capsys: Output) -> None:
    """Tables that `docs/traces.md` describes as read, next to a refused one of the same kind."""

    def code(text: str) -> int:
        Path("log.csv").write_text(text)
        return judged(capsys, "always(v > 0)", "log.csv")[0]

    rows = "0,1,0\n1,1,1\n2,1,0\n3,1,1\n"
    assert code(f"time,v,done\n{rows}") == 0
    assert code(f"time,v,terminated\n{rows}") == 2
    assert code("v,done\n1,0\n1,1\n1,0\n1,1\n") == 2
    assert code("time,v\n0,1\n1,1\n1,1\n2,1\n") == 0
    assert code("time,v\n0,1\n1,1\n1,2\n2,1\n") == 2
    assert code("time,v\n45413.5,1\n45413.6,1\n45413.7,1\n") == 0
    assert code("time,v\n45413.5,1\n45413.500012,1\n45413.500024,1\n") == 2
    assert code("time,v\n115945,1\n115946,1\n115947,1\n") == 0
    assert code("time,v\n115930,1\n115945,1\n120000,1\n") == 2


# Times and periods whose unit is in doubt: errors and notes name the reading that fits. ----------


RESPONSE = "always(req > 0.5 implies eventually[0:0.2](gnt > 0.5))"
SLOWS = "always(speed > 30 implies eventually[0:0.2](speed < 30))"


@pytest.fixture(autouse=True)
def files() -> None:
    rows = ["0,1,0", "100,0,", "200,0,", "300,0,", "400,0,1", "500,0,0", "600,0,0"]
    Path("late.csv").write_text("\n".join(["time,req,gnt", *rows]))
    Path("ms.csv").write_text("time,speed\n0,20\n100,40\n200,20\n300,20\n")
    Path("half.csv").write_text("time,speed\n0,20\n0.5,40\n1,20\n1.5,20\n")


@pytest.mark.parametrize("command", ["monitor", "explain"])
def test_bounds_need_times(command: str, capsys: Output) -> None:
    words = [command, RESPONSE, "late.csv", "--time-unit", "ms", "--missing", "drop"]
    assert main(words) == 2
    error = capsys.readouterr().err
    assert "expected samples at even distances" in error
    assert "--period" not in error
    assert main([*words, "--jitter", "5%"]) == 1
    assert main([*words, "--dense"]) == 1
    capsys.readouterr()
    Path("uneven.csv").write_text("time,req\n0,1\n1,1\n5,1\n6,1\n7,1\n")
    assert main([command, "always(req < 2)", "uneven.csv"]) == 2
    assert "or --period to leave the column 'time' aside" in capsys.readouterr().err


def test_dropped_rows_keep_the_note_on_times(capsys: Output) -> None:
    assert main(["monitor", RESPONSE, "late.csv", "--missing", "drop", "--period", "100ms"]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert "--period leaves the column 'time' aside, which has the rows 100 s apart" in shown
    assert "400 s after late.csv, line 2: 600 s in all, not 0.3 s" in shown
    assert "longest gap" not in shown


@pytest.mark.parametrize("command", ["monitor", "explain"])
def test_bound_without_unit_error(command: str, capsys: Output) -> None:
    assert main([command, SLOWS, "ms.csv"]) == 2
    error = capsys.readouterr().err
    assert "bound 0.2 s is not a multiple of the period 100 s" in error
    assert "if these are milliseconds, --time-unit ms; if seconds, --time-unit s" in error
    assert "--align" not in error
    assert main([command, SLOWS, "ms.csv", "--time-unit", "ms"]) == 0
    assert main([command, SLOWS, "ms.csv", "--time-unit", "s"]) == 2
    assert "let --align round it" in capsys.readouterr().err


@pytest.mark.parametrize(("period", "meant"), [("500", "500ms"), ("500000", "500000us")])
def test_period_in_other_unit(period: str, meant: str, capsys: Output) -> None:
    question = f"--period without a unit is in seconds; did you mean --period {meant}?"
    spec = SLOWS.replace("0.2", "0.5")
    assert main(["monitor", spec, "half.csv", "--period", period]) == 2
    assert f"hint: {question}" in capsys.readouterr().err
    assert main(["monitor", "always(speed < 50)", "half.csv", "--period", period]) == 0
    assert question in " ".join(capsys.readouterr().out.split())
    assert main(["monitor", spec, "half.csv", "--period", meant]) == 0
    assert "did you mean" not in capsys.readouterr().out
