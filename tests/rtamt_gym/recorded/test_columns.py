"""Columns of times, gaps, separators and decimal marks: detected, set by options, or refused."""

from __future__ import annotations

import json
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

import rtamt
from rtamt_gym.__main__ import main
from rtamt_gym.recorded.columns import Columns, Missing, read_columns
from rtamt_gym.recorded.csv_reader import CsvRecording
from rtamt_gym.recorded.event_rows import read_events
from rtamt_gym.recorded.times import simple
from rtamt_gym.recorded.trace import EventTrace, Trace
from rtamt_gym.recorded.trace_files import read_trace


def read(text: str, columns: Columns | None = None, variables: Sequence[str] = ("x",)) -> Trace:
    recording = CsvRecording(text.splitlines(keepends=True), "t.csv", columns)
    return read_trace(recording, variables, columns, if_events="give --dense")


def events(text: str, columns: Columns | None = None) -> EventTrace:
    return read_events(CsvRecording(text.splitlines(keepends=True), "t.csv"), ["x"], columns)


def timed(name: str, times: Sequence[object]) -> str:
    return "\n".join([f"{name},x", *(f"{time},{i}" for i, time in enumerate(times))])


def refused(text: str, columns: Columns | None = None) -> str:
    with pytest.raises(rtamt.InputError) as caught:
        read(text, columns).period()
    return str(caught.value)


# Which column, and its unit. ---------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "times"),
    [
        ("time", ["0", "0.5", "1"]),
        ("Time [s]", ["0", "0.5", "1"]),
        ("timestamp", ["10", "10.5", "11.0"]),
        ("t", ["0", "0.5", "1"]),
        ("stamp", ["0", "0.5", "1"]),
        ("header.stamp", ["0", "0.5", "1"]),
        ("/imu/stamp", ["0", "0.5", "1"]),
        ("out.tout", ["0", "0.5", "1"]),
        ("time_ns", ["1700000000000000000", "1700000000500000000", "1700000001000000000"]),
        ("Time [ms]", ["0", "500", "1000"]),
        ("timestamp (µs)", ["0", "500000", "1000000"]),
        ("t min", ["0", repr(1 / 120), repr(1 / 60)]),
        ("time", ["2024-05-01T12:00:00Z", "2024-05-01T12:00:00.5Z", "2024-05-01T14:00:01+02:00"]),
        ("Datetime", ["2024-05-01 12:00", "2024-05-01 12:00:00.500", "2024-05-01 12:00:01"]),
        ("recorded", ["2024-05-01T12:00:00", "2024-05-01T12:00:00.5", "2024-05-01T12:00:01"]),
    ],
)
def test_time_column_and_unit_are_recognised(name: str, times: Sequence[str]) -> None:
    assert read(timed(name, times)).period() == Fraction(1, 2)
    found, _ = events(timed(name, times)).signals["x"]
    assert np.diff(found) == pytest.approx([0.5, 0.5])


def test_other_names_are_not_times() -> None:
    for name in ("T", "timer", "time_zone", "y", "lead.t"):
        assert read(timed(name, ["0", "0.5", "1"])).period() is None


def test_a_column_and_a_unit_can_be_named() -> None:
    text = timed("clock", ["0", "5", "10"])
    assert read(text).period() is None
    assert read(text, Columns(time="clock", time_unit="ms")).period() == Fraction(5, 1000)
    assert refused(text, Columns(time="clok")) == (
        "t.csv: no column 'clok', which --time names; the columns are clock, x; "
        "did you mean 'clock'?"
    )
    # What is said goes before the name.
    assert read(timed("time_ns", [0, 1]), Columns(time_unit="us")).period() == Fraction(1, 10**6)


def test_time_has_priority_over_other_columns() -> None:
    rows = "\n0,7,1\n2,8,1\n"
    assert read(f"time,stamp,x{rows}").period() == 2
    assert refused(f"t,stamp,x{rows}") == (
        "t.csv: expected one column of times, got 't', 'stamp'; choose one with --time 't'"
    )
    assert read(f"t,stamp,x{rows}", Columns(time="stamp")).period() == 1


@pytest.mark.parametrize(
    ("times", "got"),
    [
        ([0, 10_000_000, 20_000_000], "1e+07 s apart (10 s as us or 0.01 s as ns)"),
        ([0, 10_000, 20_000], "10000 s apart (10 s as ms or 0.01 s as us)"),
        (
            [1_700_000_000_000, 1_700_000_000_010],
            "1.7e+12 s, a time after the year 5000 (0.01 s as ms)",
        ),
    ],
)
def test_implausible_seconds_error(times: Sequence[int], got: str) -> None:
    message = (
        f"t.csv: expected times in seconds in the column 'timestamp', got {got}; give the unit "
        "with --time-unit, such as ns, ms or s"
    )
    text = timed("timestamp", times)
    assert refused(text) == message
    with pytest.raises(rtamt.InputError) as caught:
        events(text)
    assert str(caught.value) == message
    seconds = read(text, Columns(time_unit="s")).period()
    assert seconds == times[1] - times[0]


@pytest.mark.parametrize(
    ("dates", "period"),
    [
        (["2024-02-28", "2024-02-29", "2024-03-01"], 86400),
        (["2024-05-01 12:00:00+02", "2024-05-01 10:00:01+00", "2024-05-01T10:00:02Z"], 1),
        (["2024-05-01T12:00-0130", "2024-05-01T13:31Z", "2024-05-01T15:32+02"], 60),
    ],
)
def test_dates_without_time_and_hour_offsets(dates: list[str], period: int) -> None:
    text = "\n".join(["begun,x", *(f"{date},1" for date in dates)])
    assert read(text).period() == period


@pytest.mark.parametrize("text", ["2024-05-01Z", "2024-05-01+02:00", "2024-05", "2024-05-01T12"])
def test_what_is_no_date_is_refused(text: str) -> None:
    assert refused(f"time,x\n{text},1\n") == (
        f"t.csv, line 2, column 'time': expected a number, got {text!r}"
    )


def test_an_unknown_unit_is_refused() -> None:
    assert refused(timed("Time [ticks]", [0, 1])) == (
        "t.csv, column 'Time [ticks]': expected a unit of time, got 'ticks'; give the unit with "
        "--time-unit (ns, us, ms, s, min, h)"
    )


def test_duplicate_time_column_error() -> None:
    text = "time,x,time\n0,1,5\n1,2,7\n"
    message = "t.csv, line 1: expected one column 'time', got two"
    assert refused(text) == message
    with pytest.raises(rtamt.InputError) as caught:
        events(text)
    assert str(caught.value) == message


def test_invalid_time_error_states_line() -> None:
    assert refused("time,x\n0,1\nx,2\n") == (
        "t.csv, line 3, column 'time': expected a number, got 'x'"
    )
    assert refused("time,x\n2024-05-01T12:00:00,1\n2024-05-01T12:00:61,2\n") == (
        "t.csv, line 3, column 'time': expected a date like the first, got '2024-05-01T12:00:61'"
    )


@given(st.integers(0, 2**62), st.integers(1, 10**9), st.integers(2, 30))
def test_integer_times_are_exact(start: int, step: int, n: int) -> None:
    text = timed("time_ns", [start + i * step for i in range(n)])
    assert read(text).period() == Fraction(step, 10**9)


# Jitter. -----------------------------------------------------------------------------------------


@given(
    st.integers(1, 1000),
    st.lists(st.floats(-0.049, 0.049), min_size=3, max_size=60),
)
def test_samples_near_the_grid_count_as_on_it(hertz: int, jitter: Sequence[float]) -> None:
    times = [(i + off) / hertz for i, off in enumerate(jitter)]
    trace = read(timed("time", times))
    period = trace.period()
    assert period is not None
    assert float(period) == pytest.approx(1 / hertz, rel=0.1 / (len(times) - 1))
    assert [*trace.notes] == []


def test_a_jitter_does_not_make_an_odd_period() -> None:
    rng = np.random.default_rng(0)
    times = (np.arange(2000) + rng.uniform(-0.04, 0.04, 2000)) / 100
    assert read(timed("time", times.tolist())).period() == Fraction(1, 100)


def test_a_clock_that_drifts_is_even() -> None:
    steps = np.linspace(0.01, 0.010099, 3000)
    assert read(timed("time", np.cumsum(steps).tolist())).period() is not None


def test_off_grid_sample_error_or_resampling() -> None:
    text = timed("time", [0, 0.1, 0.2, 0.36, 0.4, 0.5, 0.8, 0.9, 1.0])
    assert refused(text) == (
        "t.csv, line 5: expected samples at even distances, got time 0.36 after 0.2, elsewhere "
        "0.1 s; give --dense, --jitter 5% to resample by holding values, or --period to leave the "
        "column 'time' aside"
    )
    trace = read(text, Columns(jitter=0.05))
    assert trace.period() == Fraction(1, 10)
    # At 0.3 the value of 0.2 holds, from 0.5 to 0.7 the value of 0.5.
    assert trace.columns["x"].tolist() == [0, 1, 2, 2, 4, 5, 5, 5, 6, 7, 8]
    assert [*trace.notes] == [
        (
            "resampled every 0.1 s by holding values: 1 of 9 rows lay more than 5% of that off the "
            "grid; the longest gap, 0.3 s, follows t.csv, line 7"
        ),
        "left out between samples: 1 row with another value, first t.csv, line 5",
    ]
    assert trace.where(6) == "t.csv, line 7"


def test_long_times_are_told_since_the_first() -> None:
    times = [1.7e9 + i + 0.5 * (i > 3) for i in range(8)]
    assert refused(timed("time", times)).startswith(
        "t.csv, line 6: expected samples at even distances, got time 4.5 s since the first after "
        "3 s since the first, elsewhere 1 s; give "
    )


@given(st.lists(st.integers(1, 12), min_size=2, max_size=40), st.integers(0, 4))
def test_resampling_holds_last_value(steps: list[int], late: int) -> None:
    """Against a walk over the grid: times in hundredths, a grid of the usual step."""
    ticks = [0, *np.cumsum(steps).tolist()]
    times = [tick / 100 for tick in ticks]
    trace = read(timed("t", times), Columns(jitter=late / 100))
    period = trace.period()
    assert period is not None
    if not trace.notes:
        assert trace.columns["x"].tolist() == list(range(len(times)))
        return
    assert (
        trace.samples
        == int((times[-1] + late / 100 * float(np.median(np.diff(times)))) / period) + 1
    )
    near = late / 100 * float(np.median(np.diff(times)))
    for i, held in enumerate(trace.columns["x"].tolist()):
        at = i * float(period)
        assert times[int(held)] <= at + near + 1e-9
        assert int(held) + 1 == len(times) or times[int(held) + 1] > at + near - 1e-9


@pytest.mark.parametrize("columns", [Columns(), Columns(jitter=0.05, time_unit="s")])
def test_infinite_time_distance_error(columns: Columns) -> None:
    begin = -1.7e308
    times = [begin, begin + 1e300, begin + 2e300, begin + 3e300, 1.7e308]
    assert refused(timed("t", times), columns) == (
        "t.csv, line 6, column 't': expected times at finite distances, got 1.7e+308 after "
        "-1.7e+308; --period reads samples and ignores the column"
    )
    text = timed("t [h]", [0, 1e305])
    assert "finite distances, got 1e+305 after 0.0; " in refused(text)


@given(st.floats(1e-300, 1e300), st.floats(1e-12, 0.01))
def test_a_simple_fraction_lies_within_the_blur(value: float, blur: float) -> None:
    assert abs(simple(value, blur * value) - Fraction(value)) <= Fraction(blur * value)
    assert simple(0.1 + blur / 1000, 0.02) == Fraction(1, 10)


def test_a_gap_too_long_to_resample_is_refused() -> None:
    assert refused(timed("t", [0, 0.1, 0.2, 1e6]), Columns(jitter=0.0, time_unit="s")) == (
        "t.csv, line 5: expected a gap that can be resampled every 0.1 s, got 1e+06 s; "
        "cut the trace there"
    )


def test_no_time_notes_without_time_column() -> None:
    for columns, option in (
        (Columns(jitter=0.1), "--jitter"),
        (Columns(time_unit="s"), "--time-unit"),
    ):
        assert refused("x\n1\n", columns) == (
            f"t.csv: expected a column of times, which {option} needs; the columns are x; "
            "give --time COLUMN"
        )


def test_events_have_no_jitter() -> None:
    with pytest.raises(rtamt.InputError) as caught:
        events("time,x\n0,1\n", Columns(jitter=0.1))
    assert str(caught.value) == "expected --jitter or --dense, which reads events at any time"


# Cells. ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("missing", ["hold", "drop"])
def test_nan_as_empty_cell(missing: Missing) -> None:
    text = "x,y\n1,1\nnan,2\n3,3\n"
    assert refused(text) == (
        "t.csv, line 3, column 'x': expected a number, got 'nan'; "
        "give --missing unknown, or --missing hold if the value before holds; give --dense"
    )
    found, _ = events("time,x\n0,1\n1,nan\n2,3\n", Columns(missing=missing)).signals["x"]
    assert found.tolist() == [0.0, 2.0]
    expected = [1.0, 1.0, 3.0] if missing == "hold" else [1.0, 3.0]
    assert read(text, Columns(missing=missing)).columns["x"].tolist() == expected


def test_nothing_is_held_before_the_first_value() -> None:
    assert refused("x\n,\n".replace(",", '""') + "2\n", Columns(missing="hold")) == (
        "t.csv, line 2, column 'x': expected a number to hold, got an empty cell; "
        "give --missing unknown"
    )
    assert refused('x\n""\n', Columns(missing="drop")) == (
        "t.csv: expected a row without an empty cell, got none"
    )


def test_separators_and_decimal_commas_are_noted() -> None:
    for mark in ";\t|":
        trace = read(f"time{mark}x\n0{mark}1\n0,5{mark}-2,5e1\n")
        assert trace.columns["x"].tolist() == [1.0, -25.0]
        assert trace.period() == Fraction(1, 2)
        assert [*trace.notes] == ["numbers are read with a decimal comma"]
    said = Columns(separator=" ", decimal=",")
    assert read("time x\n0 1\n0,5 2,5\n", said).columns["x"].tolist() == [1.0, 2.5]
    assert [*read("time x\n0 1\n0,5 2,5\n", said).notes] == []
    assert read('x,y\n"1,5",0\n', Columns(decimal=",")).columns["x"].tolist() == [1.5]


# What is asked for. ------------------------------------------------------------------------------


def test_a_variable_may_be_called_otherwise() -> None:
    text = "Vehicle Speed [km/h],gear\n3,1\n4,1\n"
    named = read_columns(signals=["speed = Vehicle Speed [km/h]"])
    assert read(text, named, ["speed"]).columns["speed"].tolist() == [3.0, 4.0]
    recording = CsvRecording(text.splitlines(), "t.csv")
    for variables, hint in {
        "speed": "; give --signal 'speed=Vehicle Speed [km/h]' if the specification counts in km/h",
        "brake": "; give --signal brake=COLUMN",
        "gera": "; did you mean 'gear'?",
    }.items():
        with pytest.raises(rtamt.InputError) as caught:
            read_trace(recording, [variables])
        assert str(caught.value).endswith(f"the columns are Vehicle Speed [km/h], gear{hint}")
    with pytest.raises(rtamt.InputError) as caught:
        read(text, named, ["sped"])
    assert str(caught.value) == (
        "--signal: expected a variable of a specification, got 'speed'; the variables are sped; "
        "did you mean 'sped'?"
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            {"signals": ["speed"]},
            "--signal: expected VARIABLE=COLUMN, such as 'speed=Vehicle Speed [km/h]', got 'speed'",
        ),
        ({"signals": ["a=b", "a=c"]}, "--signal: expected one column for 'a', got two"),
        ({"jitter": "much"}, "--jitter: expected a part of the period, such as 5%, got 'much'"),
        (
            {"jitter": "60%"},
            "--jitter: expected less than half of the period, such as 5% or 0.05, got 0.6",
        ),
        ({"time_unit": "sec"}, "--time-unit: expected ns, us, ms, s, min, h, got 'sec'"),
        ({"separator": "::"}, "--separator: expected one character or tab, got '::'"),
        ({"decimal": "'"}, '--decimal: expected ., ,, got "\'"'),
        (
            {"decimal": ",", "separator": ","},
            "expected a --separator other than the --decimal mark, got ',' as both",
        ),
    ],
)
def test_bad_words_about_columns_are_refused(arguments: dict[str, str], message: str) -> None:
    with pytest.raises(rtamt.InputError) as caught:
        read_columns(**arguments)
    assert str(caught.value) == message


def test_malformed_text_error_states_line() -> None:
    with pytest.raises(rtamt.InputError) as caught:
        read_trace(CsvRecording(["time,x\n", "0,1\r2,3\n"], "t.csv"), ["x"])
    assert str(caught.value) == "t.csv, line 2: new-line character seen in unquoted field"


# The two forms of CSV that esmini writes, by hand: lines above the names, many objects. ----------


Output = pytest.CaptureFixture[str]
SPEEDS = np.random.default_rng(4).uniform(25, 35, (40, 2)).round(6)
NAMES = ("Ego", "Other")


@pytest.fixture
def rows(tmp_path: Path) -> Path:
    """Return a file of dat2csv."""
    lines = [
        "Version: 4, OpenDRIVE: road.xodr, 3DModel: road.osgb",
        "time, id, name, x, y, z, h, p, r, speed, wheel_angle, wheel_rot",
    ]
    for step, speeds in enumerate(SPEEDS):
        for index, (name, speed) in enumerate(zip(NAMES, speeds, strict=True)):
            cells = f"{step / 20:.3f}, {index}, {name}, 1, 2, 0, 0, 0, 0, {speed:.6f}, 0, 0"
            lines.append(cells)
    path = tmp_path / "scenario.csv"
    path.write_text("\n".join([*lines, ""]))
    return path


@pytest.fixture
def columns(tmp_path: Path) -> Path:
    """Return a file of the logger."""
    fields = ("Entitity_Name [-]", "Entitity_ID [-]", "Current_Speed [m/s]")
    header = ["Index [-]", "TimeStamp [s]"]
    header += [f"#{index} {field}" for index in (1, 2) for field in fields]
    lines = ["esmini GIT REV: v2.40", "Scenario File Name: cut-in.xosc", "Number of Vehicles: 2"]
    lines.append(" , ".join([*header, ""]))
    for step, (ego, other) in enumerate(SPEEDS):
        lines.append(f"{step}, {step / 20:.6f}, Ego, 0, {ego:.6f}, Other, 1, {other:.6f}, ")
    path = tmp_path / "log.csv"
    path.write_text("\n".join([*lines, ""]))
    return path


@pytest.mark.parametrize("name", NAMES)
def test_object_of_rows(name: str, rows: Path, capsys: Output) -> None:
    frame = pd.read_csv(rows, skiprows=1, skipinitialspace=True)
    least = 31 - frame[(frame.name == name) & (frame.time <= 1)].speed.max()
    command = ["monitor", "always[0:1](speed < 31)", str(rows), "--where", f"name={name}"]
    assert main(command) == (1 if least < 0 else 0)
    printed = capsys.readouterr().out
    assert f"robustness {least:.6g}" in printed
    assert "line 1 is skipped" in printed


def test_rows_without_a_choice_are_refused(rows: Path, capsys: Output) -> None:
    assert main(["monitor", "always(speed < 31)", str(rows)]) == 2
    assert "got 2 values of 'id', which no requirement reads" in capsys.readouterr().err


def test_two_objects_of_columns(columns: Path, capsys: Output) -> None:
    least = 5 - (SPEEDS[:21, 1] - SPEEDS[:21, 0]).max()
    names = {"ego": "#1 Current_Speed [m/s]", "other": "#2 Current_Speed [m/s]"}
    signals = [f"--signal={name}={column}" for name, column in names.items()]
    command = ["monitor", "always[0:1](other - ego < 5)", str(columns), *signals]
    assert main(command) == (1 if least < 0 else 0)
    printed = capsys.readouterr().out
    assert f"robustness {least:.6g}" in printed
    assert "40 samples, one every 0.05 s" in printed
    assert "lines 1 to 3 are skipped: the names of the columns are in line 4" in printed


# Columns that a specification names with ``@ column``, in the commands that read traces. ---------


SPEC = """\
@ column(level, "Level [mm]")
@ column(flow, "Flow")
high = always(level < 5)
low = always(flow > 0)
"""


@pytest.fixture(autouse=True)
def folder(folder: Path) -> Path:
    (folder / "tank.stl").write_text(SPEC)
    (folder / "tank.csv").write_text("time,Level [mm],Flow,level\n0,1,1,0\n1,9,2,0\n2,1,3,0\n")
    return folder


@pytest.mark.parametrize("words", [[], ["--dense"]])
def test_monitor_reads_the_named_columns(words: list[str], capsys: Output) -> None:
    assert main(["monitor", "tank.stl", "tank.csv", "--json", *words]) == 1
    found = json.loads(capsys.readouterr().out)
    outcomes = found["trials"][0]["outcomes"]
    assert (outcomes["high"]["robustness"], outcomes["low"]["robustness"]) == (-4, 1)
    assert found["reading"]["columns"]["signals"] == {"level": "Level [mm]", "flow": "Flow"}


def test_signal_overrides_an_annotation() -> None:
    assert main(["monitor", "tank.stl", "tank.csv"]) == 1
    assert main(["monitor", "tank.stl", "tank.csv", "--signal", "level=level"]) == 0


def test_explain_reads_the_named_columns(capsys: Output) -> None:
    assert main(["explain", "tank.stl", "tank.csv", "--only", "high"]) == 1
    assert "robustness -4 at 0 s" in capsys.readouterr().out


def test_unselected_requirements_need_no_column(folder: Path, capsys: Output) -> None:
    (folder / "short.csv").write_text("time,Level [mm]\n0,1\n1,2\n")
    assert main(["monitor", "tank.stl", "short.csv", "--only", "high"]) == 0
    assert main(["monitor", "tank.stl", "short.csv"]) == 2
    assert "Flow" in capsys.readouterr().err


def test_signal_of_an_unselected_requirement_is_ignored(capsys: Output) -> None:
    words = ["monitor", "tank.stl", "tank.csv", "--only", "high"]
    assert main([*words, "--signal", "flow=Nowhere"]) == 1
    assert main([*words, "--signal", "height=Nowhere"]) == 2
    assert "no specification reads 'height'" in capsys.readouterr().err


def test_two_columns_of_one_variable_are_refused(folder: Path, capsys: Output) -> None:
    (folder / "other.stl").write_text('@ column(level, "level")\nother = always(level < 5)')
    words = ["monitor", "tank.stl", "other.stl", "--", "tank.csv"]
    assert main(words) == 2
    assert (
        "two specifications name different columns of 'level', 'Level [mm]' and 'level'. "
        "Give --signal level=COLUMN, or rename one variable."
    ) in capsys.readouterr().err
    assert main([*words, "--signal", "level=level"]) == 0


def test_report_page_reads_the_trace_again(folder: Path, capsys: Output) -> None:
    main(["monitor", "tank.stl", "tank.csv", "--json"])
    (folder / "outcomes.json").write_text(capsys.readouterr().out)
    assert main(["report", "outcomes.json", "-o", "page.html"]) == 0
    assert "is not shown in full" not in (folder / "page.html").read_text()


def test_stored_outcomes_depend_on_the_named_columns(folder: Path, capsys: Output) -> None:
    words = ["monitor", "tank.stl", "--results", "kept", "--", "tank.csv"]
    assert main(words) == 1
    (folder / "tank.stl").write_text(SPEC.replace("Level [mm]", "level"))
    assert main(words) != 1  # judged again, or refused, and not the outcome of before
    capsys.readouterr()


def test_clips_keep_the_named_columns(folder: Path) -> None:
    assert main(["monitor", "tank.stl", "tank.csv", "--clip", "clips", "--clip-around", "1s"]) == 1
    (clip,) = (folder / "clips").iterdir()
    assert clip.read_text() == (folder / "tank.csv").read_text()
