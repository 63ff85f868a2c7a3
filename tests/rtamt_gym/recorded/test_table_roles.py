"""Columns of times that other tools write, and tables of several objects or episodes."""

import io
import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.feather
import pyarrow.parquet as pq
import pytest
from scipy.io import savemat

from rtamt_gym.__main__ import main
from rtamt_gym.recorded import csv_reader

Output = pytest.CaptureFixture[str]
Columns = Mapping[str, Sequence[Any]]


def write(name: str, columns: Columns, mark: str = ",") -> str:
    """Write columns to a file in the format of its name."""
    path, table = Path(name), {n: list(each) for n, each in columns.items()}
    rows = [dict(zip(table, row, strict=True)) for row in zip(*table.values(), strict=True)]
    match path.suffix:
        case ".csv":
            lines = [mark.join(map(str, row)) for row in (table, *(each.values() for each in rows))]
            path.write_text("\n".join(lines) + "\n")
        case ".jsonl":
            path.write_text("\n".join(map(json.dumps, rows)))
        case ".parquet":
            pq.write_table(pa.table(table), path)
        case ".feather":
            pa.feather.write_feather(pa.table(table), path)
        case ".npz":
            np.savez(path, allow_pickle=False, **{n: np.array(each) for n, each in table.items()})
        case _:
            savemat(path, {n: np.array(each) for n, each in table.items()})
    return name


def judged(capsys: Output, spec: str, *arguments: str) -> tuple[int, str]:
    """Return the exit code and what the command printed."""
    code = main(["monitor", spec, *arguments])
    printed = capsys.readouterr()
    return code, printed.out + printed.err


FORMATS = [".csv", ".jsonl", ".parquet", ".feather", ".npz", ".mat"]
V = [1.0, 1.0, -1.0, 1.0, 1.0]  # violated at the third sample


@pytest.mark.parametrize(
    ("columns", "upto"),
    [
        ({"__time": [1.7e9, 1.7e9 + 0.5, 1.7e9 + 1, 1.7e9 + 1.5, 1.7e9 + 2]}, "1"),
        ({"elapsed_time": [0, 0.5, 1, 1.5, 2]}, "1"),
        ({"TimeUS": [0, 500_000, 1_000_000, 1_500_000, 2_000_000]}, "1"),
        ({"time_boot_ms": [7, 507, 1007, 1507, 2007]}, "1"),
        ({"timestep_time": [0, 10, 20, 30, 40]}, "20"),
        ({"secs": [5, 5, 6, 6, 7], "nsecs": [0, 500_000_000] * 2 + [0]}, "1"),
        ({"secs": [5, 5, 6, 6, 7], "usecs": [0, 500_000] * 2 + [0]}, "1"),
    ],
)
@pytest.mark.parametrize("extension", FORMATS)
def test_times_of_other_tools_are_recognised(
    capsys: Output, extension: str, columns: Columns, upto: str
) -> None:
    if extension == ".mat":  # MATLAB has no such names
        columns = {name.removeprefix("__"): each for name, each in columns.items()}
    name = write(f"log{extension}", {**columns, "v": V})
    code, text = judged(capsys, f"always[0:{upto}](v > 0)", name)
    assert (code, text[:8]) == (1, "VIOLATED"), text
    code, text = judged(capsys, f"always[0:{float(upto) / 4}](v > 0)", name, "--align", "inward")
    assert (code, text[:9]) == (0, "SATISFIED"), text


@pytest.mark.parametrize(
    ("text", "upto"),
    [
        ("%time,v\n0,1\n500000000,1\n1000000000,-1\n", "1"),
        ("%time,v\n0,1\n0.5,1\n1,-1\n", "1"),  # a comment mark, not rostopic's
        ("Zeit [s];v\n0,0;1\n0,5;1\n1,0;-1\n", "1"),
        (
            "Datum;Uhrzeit;v\n31.12.2024;23:59:59;1\n01.01.2025;00:00:00;1\n01.01.2025;00:00:01;-1\n",
            "2",
        ),
        (
            "Date,Time,v\n2024-05-01,12:00:00.0,1\n2024-05-01,12:00:00.5,1\n2024-05-01,12:00:01,-1\n",
            "1",
        ),
        (
            "Date,Time,v\n05/01/2024,12:00:00,1\n05/01/2024,12:00:01,1\n05/01/2024,12:00:02,-1\n",
            "2",
        ),
        ("Date,Time,v\n1,0,1\n1,0.5,1\n1,1,-1\n", "1"),  # numbers are not times of day
        (
            "Zeitstempel;v\n01.05.2024 12:00:00;1\n01.05.2024 12:00:01;1\n01.05.2024 12:00:02;-1\n",
            "2",
        ),
        ("Time,v\n01-May-2024 12:00:00,1\n01-May-2024 12:00:01,1\n01-May-2024 12:00:02,-1\n", "2"),
        ("time(UTC),v\n20180101:0000,1\n20180101:0001,1\n20180101:0002,-1\n", "120"),
        ("Time,v\n0 sec,1\n0.5 sec,1\n1 sec,-1\n", "1"),
        ("Time,v\n00:00:00,1\n00:00:01,1\n00:00:02,-1\n", "2"),
        ("stamp,secs,nsecs,v\n,0,0,1\n,0,500000000,1\n,1,0,-1\n", "1"),
        ("header.stamp.sec,header.stamp.nanosec,v\n0,0,1\n0,500000000,1\n1,0,-1\n", "1"),
        ("_time,_start,v\n2024-05-01T12:00Z,2024-05-01,1\n2024-05-01T12:01Z,2024-05-01,-1\n", "60"),
    ],
)
def test_times_in_texts_are_recognised(capsys: Output, text: str, upto: str) -> None:
    Path("log.csv").write_text(text)
    code, printed = judged(capsys, f"always[0:{upto}](v > 0)", "log.csv")
    assert (code, printed[:8]) == (1, "VIOLATED"), printed
    assert "bounds count samples" not in printed


def test_dates_of_two_readings_are_refused(capsys: Output) -> None:
    days = ["03/04/2024", "04/04/2024", "05/04/2024"]
    write("log.csv", {"Date": days, "v": [1, 1, -1]})
    code, text = judged(capsys, "always[0:200000](v > 0)", "log.csv")
    assert code == 2
    assert "--date-order dmy" in text
    assert "--date-order mdy" in text
    daily = judged(capsys, "always[0:172800](v > 0)", "log.csv", "--date-order", "dmy")
    assert daily[0] == 1
    assert "one every 86400 s" in daily[1]
    code, text = judged(capsys, "always(v > 0)", "log.csv", "--date-order", "mdy")
    assert code == 2 or "86400" not in text


def test_time_like_column_stops_time_bounds(capsys: Output) -> None:
    name = write("log.csv", {"clk": [0, 20, 40, 60, 80], "v": V})
    for bound in ("always[0:40]", "always(once[0:20]", "always(once[9,)"):
        spec = f"{bound}(v > 0)" + ")" * bound.count("(")
        assert judged(capsys, spec, name) == (
            2,
            (
                "rtamt: error: log.csv: expected a column of times for the time bounds, got none, "
                "but 'clk', which nothing reads, looks like one. Give --time clk --time-unit s (a "
                "sample every 20 s), --time clk --time-unit ms (a sample every 0.02 s), or "
                "--period 1 to count samples.\n"
            ),
        )
    for spec in ("always(v > -2)", "always[0:0](v > -2)", "always(next(prev(v > -2)))"):
        assert judged(capsys, spec, name)[0] in (0, 3), spec
    ms = judged(capsys, "always[0:40ms](v > 0)", name, "--time", "clk", "--time-unit", "ms")
    assert ms[0] == 1
    assert judged(capsys, "always[0:2](v > 0)", name, "--period", "1")[0] == 1
    assert judged(capsys, "always[0:1](v > 0)", name, "--period", "1")[0] == 0
    _, dense = judged(capsys, "always(v > 0)", name, "--dense")
    assert "--time clk --time-unit s" in dense


@pytest.mark.parametrize(("seconds", "part"), [("s", "ns"), ("s", "nsec"), ("gps_s", "gps_ns")])
def test_short_names_of_split_times_stop_time_bounds(
    capsys: Output, seconds: str, part: str
) -> None:
    half = 500_000_000
    split: Columns = {seconds: [7, 7, 8, 8, 9], part: [0, half, 0, half, 0], "v": V}
    name = write("log.csv", split)
    code, text = judged(capsys, "always[0:2](v > 0)", name)
    assert code == 2
    assert f"'{seconds}' and '{part}', which nothing reads, look like seconds and their ns" in text
    assert f"Give --time {seconds}+{part}, or --period 1 to count samples." in text
    code, text = judged(capsys, "always[0:1](v > 0)", name, "--time", f"{seconds}+{part}")
    assert (code, "one every 0.5 s, 7 s to 9 s" in text) == (1, True)
    for other in ({part: [0, -1, 0, -1, 0]}, {seconds: [7, 7, 7, 8, 8]}, {part: ["a"] * 5}):
        name = write("log.csv", {**split, **other})
        assert judged(capsys, "always[0:2](v > 0)", name)[0] in (0, 1)


def test_unlisted_times_that_fall_are_refused(capsys: Output) -> None:
    name = write("log.csv", {"Abtastung": [0.8, 0.6, 0.4, 0.2, 0.0], "v": V})
    code, text = judged(capsys, "always[0:0.4](v > 0)", name)
    assert code == 2
    assert "looks like one with the newest row first. Sort the rows by 'Abtastung'" in text
    assert "--time Abtastung --time-unit s" in text
    code, text = judged(capsys, "always[0:0.4](v > 0)", name, "--time", "Abtastung")
    assert (code, "the newest first" in text) == (2, True)


@pytest.mark.parametrize("extension", FORMATS)
@pytest.mark.parametrize(
    "column",
    [
        {"odometer": [10.0, 10.5, 11.0, 11.5, 12.0]},
        {"ramp": [0.0, 0.1, 0.2, 0.3, 0.4]},
        {"counter": [3, 6, 9, 12, 15]},
        {"sample": [0, 1, 2, 3, 4]},
        {"A": [0, 1, 2, 3, 4]},
        {"A": [5, 6, 7, 8, 9]},
        {"A": [0.0, 0.3, 0.4, 1.9, 2.0]},
        {"lap_time": [3.0, 5.0, 4.0, 4.0, 3.0]},
        {"T": [20.0, 20.0, 20.5, 21.0, 21.0]},
    ],
)
def test_other_columns_do_not_look_like_times(
    capsys: Output, extension: str, column: Columns
) -> None:
    name = write(f"log{extension}", {**column, "v": V})
    code, text = judged(capsys, "always[0:2](v > 0)", name)
    assert (code, text[:8]) == (1, "VIOLATED"), text


def test_uncertain_unit_error_lists_readings(capsys: Output) -> None:
    name = write("log.csv", {"timestamp": [0, 4000, 8000, 12000, 16000], "v": V})
    code, text = judged(capsys, "always[0:8ms](v > 0)", name)
    assert code == 2
    assert "got 4000 s apart (4 s as ms or 0.004 s as us)" in text
    assert judged(capsys, "always[0:8ms](v > 0)", name, "--time-unit", "us")[0] == 1


@pytest.mark.parametrize("options", [[], ["--dense"], ["--period", "1"], ["--jitter", "5%"]])
def test_newest_first_is_refused(capsys: Output, options: list[str]) -> None:
    for times in ([4, 3, 2, 1, 0], [f"2024-05-01 12:00:0{9 - i}" for i in range(5)]):
        name = write("log.csv", {"time": times, "v": V})
        code, text = judged(capsys, "always(v > -9)", name, *options)
        assert code == 2
        assert "the newest first" in text
        assert "--period" not in text


@pytest.mark.parametrize("dense", [[], ["--dense"]])
def test_times_that_repeat_or_go_back_are_named(capsys: Output, dense: list[str]) -> None:
    name = write("log.csv", {"time": [0, 1, 1, 2, 2], "v": V})
    code, text = judged(capsys, "always(v > 0)", name, *dense)
    assert code == 2
    assert "expected one value at 1 s, got " in text
    assert "--period" not in text
    name = write("log.csv", {"time": [0, 1, 2, 0, 1], "v": V})
    code, text = judged(capsys, "always(v > 0)", name, *dense)
    assert code == 2
    assert "line 5: expected times that increase, got 0 after 2. Sort" in text
    assert "--period" not in text


# Several objects. ---------------------------------------------------------------------------------

FCD: Columns = {
    "time": [0.0, 0.0, 1.0, 1.0, 2.0, 2.0],
    "vehicle_id": [0, 1] * 3,
    "speed": [9.0, 0.0] * 3,
}
RUNS: Columns = {
    "time": [0.0, 1.0, 2.0, 3.0, 4.0, 5.0],
    "run": ["a"] * 3 + ["b"] * 3,
    "speed": [9.0] * 3 + [0.0] * 3,
}


@pytest.mark.parametrize("extension", FORMATS)
@pytest.mark.parametrize(("table", "way"), [(FCD, "vehicle_id=0"), (RUNS, "run=a")])
@pytest.mark.parametrize("options", [[], ["--dense"], ["--period", "1"]])
def test_several_objects_are_refused(
    capsys: Output, extension: str, table: Columns, way: str, options: list[str]
) -> None:
    name = write(f"fcd{extension}", table)
    code, text = judged(capsys, "eventually(speed > 5)", name, *options)
    column, _, _ = way.partition("=")
    assert code == 2
    assert f"expected one trace, got 2 values of '{column}', which no requirement reads" in text
    assert f"Give --by {column} for a trace of each, --where {way} to judge the rows of one" in text
    code, text = judged(capsys, "eventually(speed > 5)", name, *options, "--where", way)
    assert (code, text[:9]) == (0, "SATISFIED")
    assert f"note: --where {way} selects 3 rows" in text
    other = f"{column}={'1' if way.endswith('0') else 'b'}"
    assert judged(capsys, "eventually(speed > 5)", name, *options, "--where", other)[0] == 1


def test_one_trace_is_stated(capsys: Output) -> None:
    name = write("runs.csv", RUNS)
    assert judged(capsys, "eventually(speed > 5)", name, "--one-trace")[0] == 0
    name = write("fcd.csv", FCD)
    code, text = judged(capsys, "eventually(speed > 5)", name, "--one-trace")
    assert code == 2
    assert "expected one value at 0 s, got 9 and 0 (and at 2 more times)" in text
    assert judged(capsys, "eventually(speed > 5)", name, "--one-trace", "--period", "1")[0] == 0


def test_objects_without_an_id_are_refused(capsys: Output) -> None:
    table: Columns = {
        "time": FCD["time"],
        "x": [0.5, 7.5, 1.5, 7.5, 2.5, 7.5],
        "speed": FCD["speed"],
    }
    for options in ([], ["--period", "1"], ["--dense"]):
        code, text = judged(capsys, "eventually(speed > 5)", write("fcd.csv", table), *options)
        assert code == 2
        assert "times repeat or go back while other columns change" in text
        assert "--one-trace" in text
    restart: Columns = {**table, "time": [0.0, 1.0, 2.0, 0.0, 1.0, 2.0]}
    assert (
        judged(capsys, "eventually(speed > 5)", write("ep.csv", restart), "--period", "1")[0] == 2
    )


@pytest.mark.parametrize(
    "column",
    [
        {"frame_index": [0, 0, 0, 1, 1, 1]},
        {"step": [0, 0, 0, 1, 1, 1]},
        {"id": [0, 1, 2, 3, 4, 5]},
        {"vehicle_id": [7] * 6},
        {"gear": [1, 1, 1, 2, 2, 2]},
        {"mode": ["a", "a", "a", "b", "b", "b"]},
    ],
)
def test_one_object_stays_readable(capsys: Output, column: Columns) -> None:
    table: Columns = {"time": RUNS["time"], **column, "speed": RUNS["speed"]}
    assert judged(capsys, "eventually(speed > 5)", write("log.csv", table))[0] == 0


def test_different_variables_are_one_trace(capsys: Output) -> None:
    Path("wide.csv").write_text("time,id,a,b\n0,7,1,\n0.5,8,,1\n1,7,1,\n1.5,8,,1\n")
    assert judged(capsys, "always(a > 0 or b > 0)", "wide.csv", "--dense")[0] == 0
    Path("long.csv").write_text("time,variable,value\n0,a,1\n0,b,1\n1,a,1\n1,b,1\n")
    assert judged(capsys, "always(a > 0 and b > 0)", "long.csv", "--dense")[0] == 0
    Path("long.csv").write_text("time,car,variable,value\n0,0,a,1\n0,1,a,-1\n1,0,a,1\n1,1,a,-1\n")
    code, text = judged(capsys, "always(a > 0)", "long.csv", "--dense")
    assert code == 2
    assert "got 2 values of 'car'" in text
    assert judged(capsys, "always(a > 0)", "long.csv", "--dense", "--where", "car=0")[0] == 0


def test_where_is_checked(capsys: Output) -> None:
    name = write("fcd.csv", FCD)
    for option, words in {
        "vehicle_i=0": "no column 'vehicle_i', which --where names; the columns are ",
        "vehicle_id=7": "no row with '7' in the column 'vehicle_id', which --where names; its "
        "values are 0, 1",
        "vehicle_id": "expected COLUMN=VALUE",
        "=3": "expected COLUMN=VALUE",
    }.items():
        code, text = judged(capsys, "always(speed > 5)", name, "--where", option)
        assert code == 2
        assert words in text
    twice = ["--where", "vehicle_id=0", "--where", "vehicle_id=1"]
    assert (
        "expected one value of 'vehicle_id'" in judged(capsys, "always(speed > 5)", name, *twice)[1]
    )
    both = ["--where", "vehicle_id=0", "--where", "time=1.0"]
    code, text = judged(capsys, "eventually(speed > 5)", name, *both)
    assert (code, "selects 1 row\n" in text) == (0, True)
    apart = ["--where", "vehicle_id=0", "--where", "speed=0.0"]
    assert (
        "no row with vehicle_id=0 and speed=0.0"
        in judged(capsys, "always(speed > 5)", name, *apart)[1]
    )


def test_where_comes_before_anything_else(capsys: Output) -> None:
    Path("log.csv").write_text("time,id,v\n0,a,1\n0,b,N/A\n1,a,1\n-,b,\n2,a,1\n")
    for block in (1, 1 << 14):
        pytest.MonkeyPatch().setattr(csv_reader, "_BLOCK", block)
        assert judged(capsys, "always[0:2](v > 0)", "log.csv", "--where", "id=a")[0] == 0
    code, text = judged(capsys, "always[0:2](v > 0)", "log.csv", "--where", "id=b")
    assert code == 2
    assert "log.csv, line 3, column 'v'" in text


def test_where_selects_in_a_stream(capsys: Output, monkeypatch: pytest.MonkeyPatch) -> None:
    text = Path(write("fcd.csv", FCD)).read_text()
    monkeypatch.setattr(sys, "stdin", io.StringIO(text))
    assert (
        "--where vehicle_id=0 to judge the rows of one"
        in judged(capsys, "always(speed > 5)", "-")[1]
    )
    monkeypatch.setattr(sys, "stdin", io.StringIO(text))
    assert judged(capsys, "always(speed > 5)", "-", "--where", "vehicle_id=0")[0] == 0


def test_long_files_are_selected_by_pyarrow(
    capsys: Output, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(csv_reader, "_LONG", 1)
    name = write("fcd.csv", FCD)
    assert (
        "--where vehicle_id=0 to judge the rows of one"
        in judged(capsys, "always(speed > 5)", name)[1]
    )
    assert judged(capsys, "always(speed > 5)", name, "--where", "vehicle_id=0")[0] == 0
    assert (
        "values are 0, 1" in judged(capsys, "always(speed > 5)", name, "--where", "vehicle_id=7")[1]
    )
    speeds = [9.0, 0.0, 9.0, 0.0, 8.0, 0.0]
    name = write("dup.csv", {**FCD, "time": [0.0, 9.0, 1.0, 9.0, 1.0, 9.0], "speed": speeds})
    code, text = judged(capsys, "always(speed > 5)", name, "--where", "vehicle_id=0")
    assert code == 2
    assert "dup.csv, column 'speed': expected one value at 1 s, got 9 and 8;" in text


def test_episodes_of_lerobot_are_refused(capsys: Output) -> None:
    n = 6
    table: Columns = {
        "episode_index": [i // 3 for i in range(n)],
        "frame_index": [i % 3 for i in range(n)],
        "timestamp": [i % 3 / 30 for i in range(n)],
        "index": list(range(n)),
        "task_index": [0] * n,
        "observation.state": [[float(i // 3), 5.0] for i in range(n)],
    }
    for name in (write("file.parquet", table), write("file.feather", table)):
        signal = ["--signal", "s=observation.state[0]"]
        code, text = judged(capsys, "always[0:0.06](s > 0.5)", name, *signal)
        assert code == 2
        assert "--where episode_index=0 to judge the rows of one" in text
        assert "--period" not in text
        for episode, code in (("0", 1), ("1", 3)):
            where = ["--where", f"episode_index={episode}"]
            assert judged(capsys, "always[0:3s](s > 0.5)", name, *signal, *where)[0] == code
        _, text = judged(capsys, "always(s > 0)", name, "--signal", "s=observation.state[2]")
        assert "observation.state[0], observation.state[1]" in text


def test_lists_of_another_length_are_refused(capsys: Output) -> None:
    name = write("lists.parquet", {"t": [0.0, 1.0], "a": [[1.0, 2.0], [1.0]]})
    code, text = judged(capsys, "always(x > 0)", name, "--signal", "x=a[1]")
    assert code == 2
    assert "row 2, column 'a': expected a list of 2, as in the first row, got 1" in text


@pytest.mark.parametrize("command", ["explain", "mine", "mutants"])
def test_all_commands_read_tables_alike(capsys: Output, command: str) -> None:
    name = write("fcd.csv", FCD)
    spec = "always(speed > ?v)" if command == "mine" else "always(speed > 5)"
    options = ["--range", "v=0:10"] if command == "mine" else []
    command_of = (
        ["monitor", spec, name, "--mutants"] if command == "mutants" else [command, spec, name]
    )
    assert main([*command_of, *options]) == 2
    assert "--where vehicle_id=0" in capsys.readouterr().err
    assert main([*command_of, *options, "--where", "vehicle_id=0"]) in (0, 3)


def test_result_keeps_selected_rows(capsys: Output) -> None:
    where = ["--where", "vehicle_id=1", "--json"]
    assert main(["monitor", "always(speed > 5)", write("fcd.csv", FCD), *where]) == 1
    columns = json.loads(capsys.readouterr().out)["reading"]["columns"]
    assert columns == {"where": {"vehicle_id": "1"}}


def test_three_even_rows_look_like_times(capsys: Output) -> None:
    name = write("log.csv", {"a": [0, 0.5, 1], "v": [1, 1, 1]})
    code, text = judged(capsys, "always[0:1](v > 0)", name)
    assert code == 2
    assert "'a', which nothing reads, looks like one. Give --time a --time-unit s" in text
    for values in ([0, 0.5, 1.2], [3, 1, 2], [1, 2, 3]):  # uneven, no order, row numbers
        write("log.csv", {"a": values, "v": [1, 1, 1]})
        assert judged(capsys, "always[0:1](v > 0)", name)[0] != 2, values


def turns(column: str, values: Sequence[int], offsets: Sequence[float]) -> Columns:
    """Return rows in which objects take turns ten times, ten times a second."""
    count = 10 * len(values)
    return {
        "time": [
            round(0.1 * (k // len(values)) + offsets[k % len(values)], 3) for k in range(count)
        ],
        column: [values[k % len(values)] for k in range(count)],
        "x": [k % 3 for k in range(count)],
    }


@pytest.mark.parametrize("options", [[], ["--dense"], ["--max-gap", "1s"], ["--jitter", "5%"]])
@pytest.mark.parametrize("values", [(3, 7, 12), (1, 2, 3), (5, 4), (0, 1, 2)])
@pytest.mark.parametrize("end", [".csv", ".parquet"])
def test_alternating_objects_error(
    values: tuple[int, ...], options: list[str], end: str, capsys: Output
) -> None:
    path = write(f"run{end}", turns("zone", values, (0, 0.03, 0.06)))
    words = ["monitor", "always(x < 3)", path, *options]
    assert main(words) == 2
    error = capsys.readouterr().err
    assert f"expected one trace, got {len(values)} values of 'zone'" in error
    assert "Give --by zone for a trace of each" in error
    assert "--dense" not in error
    for more in (["--by", "zone"], ["--where", f"zone={values[0]}"]):
        assert main([*words, *more]) == 0
    assert main([*words[:3], "--dense", "--one-trace"]) == 0


@pytest.mark.parametrize(
    "table",
    [
        turns("mode", (3, 7, 12), (0, 0.03, 0.06)),
        turns("alive_counter", (0, 1, 2), (0, 0.03, 0.06)),
        turns("light", (0, 1), (0, 0.03)),
        turns("zone", (3, 7, 12), (0, 0.1 / 3, 0.2 / 3)),
        {"time": [0, 1, 4, 9, 11, 12, 19, 20], "adc": [3, 4, 3, 4, 3, 4, 3, 4], "x": [1] * 8},
        {"time": [0, 1, 4, 5, 8, 9, 12, 13], "adc": [3, 4, 4, 3, 3, 4, 3, 3], "x": [1] * 8},
    ],
    ids=["state", "counter", "flags", "even", "events", "signal"],
)
def test_signals_of_events_are_one_trace(table: Columns) -> None:
    assert main(["monitor", "always(x < 3)", write("run.csv", table), "--dense"]) == 0
