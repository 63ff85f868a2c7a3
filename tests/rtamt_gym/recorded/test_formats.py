"""Every format of recorded traces satisfies one contract."""

import gzip
import json
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.feather
import pyarrow.parquet as pq
import pytest
from asammdf import MDF, Signal
from bags import Said, write_bag
from numpy.typing import NDArray
from scipy.io import savemat
from ulogs import Topic, Ulog

import rtamt
from rtamt_gym import EvaluationOptions
from rtamt_gym.recorded import csv_reader
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.csv_reader import CsvRecording
from rtamt_gym.recorded.event_rows import read_events
from rtamt_gym.recorded.readers import formats, open_recording
from rtamt_gym.recorded.trace import EventTrace, Trace
from rtamt_gym.recorded.trace_files import read_ruled, read_trace
from rtamt_gym.testing import check_trace_format

Table = Mapping[str, NDArray[Any]]
Write = Callable[[Path, Table], object]

N = 50
TABLE: Table = {
    "time": np.arange(N) / 8,
    "speed": np.sin(np.arange(N)),
    "gear": np.arange(N) % 5,
}


def separated(table: Table, mark: str = ",") -> str:
    """Return the text of a table; nan is an empty cell."""
    rows = zip(*(column.tolist() for column in table.values()), strict=True)
    cells = (mark.join("" if np.isnan(cell) else repr(cell) for cell in row) for row in rows)
    return "\n".join([mark.join(table), *cells, ""])


def arrow(table: Table) -> pa.Table:
    return pa.table({name: pa.array(column, from_pandas=True) for name, column in table.items()})


def write_npz(path: Path, table: Table) -> None:
    np.savez(path, **table)  # type: ignore[arg-type]  # mypy takes a name for allow_pickle


def write_lines(path: Path, table: Table) -> None:
    rows = zip(*(column.tolist() for column in table.values()), strict=True)
    dicts = ({n: c for n, c in zip(table, row, strict=True) if not np.isnan(c)} for row in rows)
    path.write_text("\n".join(map(json.dumps, dicts)))


def write_mdf(path: Path, table: Table) -> None:
    with MDF(version="3.30" if path.suffix == ".mdf" else "4.10") as file:
        for name, column in table.items():
            given = ~np.isnan(column.astype(float))
            if name != "time":
                file.append(Signal(column[given], table["time"][given].astype(float), name=name))
        file.save(path, overwrite=True)


def write_topics(path: Path, table: Table) -> None:
    """Write a topic for each column, with a message for each row, at its time."""
    write_bag(
        path,
        [
            Said(round(time * 1e9), f"/rtamt/{name}", "std_msgs/Float64", {"data": value})
            for name, column in table.items()
            for time, value in zip(table["time"].tolist(), column.tolist(), strict=True)
            if name != "time"
        ],
    )


TABLES: Mapping[str, Write] = {
    ".csv": lambda path, table: path.write_text(separated(table)),
    ".csv.gz": lambda path, table: path.write_bytes(gzip.compress(separated(table).encode())),
    ".tsv": lambda path, table: path.write_text(separated(table, "\t")),
    ".txt": lambda path, table: path.write_text(separated(table, ";")),
    ".parquet": lambda path, table: pq.write_table(arrow(table), path),
    ".feather": lambda path, table: pa.feather.write_feather(arrow(table), path),
    ".arrow": lambda path, table: pa.feather.write_feather(arrow(table), path),
    ".ndjson": write_lines,
    ".jsonl": write_lines,
    ".npz": write_npz,
    ".mat": lambda path, table: savemat(path, dict(table)),
    ".mf4": write_mdf,
    ".mdf": write_mdf,
}


def write_log(path: Path, table: Table) -> None:
    """Write a topic with only the instance 0, and a field for each column."""
    names = [name for name in table if name != "time"]
    topic, log = Topic("run", tuple(("double", name) for name in names)), Ulog()
    for row in range(len(table["time"])):
        micros = 1_000_000 + round(table["time"][row] * 1e6)
        log.data(topic, micros, [float(table[name][row]) for name in names])
    log.save(path)


LOGS: Mapping[str, Write] = {".ulg": write_log}
"""Their columns are fields of topics; they satisfy the contract except for names of columns."""
BAGS: Mapping[str, Write] = {".mcap": write_topics, ".db3": write_topics, ".bag": write_topics}
WRITERS = {**TABLES, **LOGS, **BAGS}
"""Bags satisfy the contract too, except for empty cells and names of columns."""

TIMED_BY_ITSELF = {".mf4", ".mdf"}
"""Formats with times of their own, in seconds."""


@pytest.fixture(params=[*TABLES])
def extension(request: pytest.FixtureRequest) -> str:
    """Return the extension of a table."""
    found: str = request.param
    return found


@pytest.fixture(params=[*WRITERS])
def ending(request: pytest.FixtureRequest) -> str:
    """Return the extension of a trace."""
    found: str = request.param
    return found


def read(path: Path, variables: Sequence[str], columns: Columns | None = None) -> Trace:
    with open_recording(str(path), columns) as recording:
        return read_trace(recording, variables, columns)


def ruled(path: Path, variables: Sequence[str], *, dense: bool = False) -> Trace | EventTrace:
    """Read a trace as commands do; bags are sampled every 0.125 s."""
    period = Fraction(1, 8) if path.suffix in BAGS and not dense else None
    spec = rtamt.parse(" and ".join(f"{name} < 9" for name in variables))
    fields = {name: f"run.{name}" for name in variables} if path.suffix in LOGS else {}
    columns = Columns(signals=fields)
    trace, _ = read_ruled(
        str(path), {"": spec}, EvaluationOptions(period=period, dense=dense), columns
    )
    return trace


def test_every_extension_is_tested() -> None:
    # Formats with several traces in a file, and dataflash logs, have tests of their own.
    one = [row for row in formats() if not row.several and row.name != "ArduPilot log"]
    assert {extension for row in one for extension in row.extensions} == {*WRITERS}


def test_a_trace_comes_back_as_it_was_written(ending: str, tmp_path: Path) -> None:
    path = tmp_path / f"Trace{ending}"
    WRITERS[ending](path, TABLE)
    trace = ruled(path, ["gear", "speed"])
    assert isinstance(trace, Trace)
    assert trace.samples == N
    assert [*trace.columns] == ["gear", "speed"]
    for name, values in trace.columns.items():
        assert values.dtype == np.float64
        assert values.tolist() == TABLE[name].tolist()
    begin = 1.0 if ending in LOGS else 0.0  # a time 0 does not count in a log
    assert (trace.period(), trace.start, [*trace.notes]) == (Fraction(1, 8), begin, [])
    events = ruled(path, ["speed"], dense=True)
    assert isinstance(events, EventTrace)
    times, values = events.signals["speed"]
    assert times.tolist() == (TABLE["time"] + begin).tolist()
    assert values.tolist() == TABLE["speed"].tolist()


def test_tables_pass_check_trace_format(extension: str, tmp_path: Path) -> None:
    check_trace_format(extension, WRITERS[extension], tmp_path)


def test_empty_cell_options(extension: str, tmp_path: Path) -> None:
    path = tmp_path / f"gaps{extension}"
    gaps = {name: column.copy() for name, column in TABLE.items()}
    gaps["speed"][[3, 4, 9]] = np.nan
    WRITERS[extension](path, gaps)
    with pytest.raises(rtamt.InputError) as caught:
        read(path, ["speed", "gear"])
    row = "line 5" if extension in (".csv", ".csv.gz", ".tsv", ".txt") else "row 4"
    assert f"gaps{extension}, {row}, column 'speed': expected a number, got " in str(caught.value)
    assert str(caught.value).endswith(
        "; give --missing unknown, or --missing hold if the value before holds"
    )

    held = read(path, ["speed", "gear"], Columns(missing="hold"))
    expected = TABLE["speed"].copy()
    expected[[3, 4, 9]] = expected[[2, 2, 8]]
    assert held.columns["speed"].tolist() == expected.tolist()
    assert held.columns["gear"].tolist() == TABLE["gear"].tolist()
    assert [*held.notes] == ["empty cells hold the value before (speed: 3)"]

    dropped = read(path, ["speed", "gear"], Columns(missing="drop"))
    kept = np.delete(np.arange(N), [3, 4, 9])
    assert dropped.columns["gear"].tolist() == TABLE["gear"][kept].tolist()
    assert [*dropped.notes] == ["3 rows with an empty cell left out"]
    with pytest.raises(rtamt.InputError, match="expected samples at even distances"):
        dropped.period()

    with open_recording(str(path)) as recording:
        times, _ = read_events(recording, ["speed", "gear"]).signals["speed"]
    assert times.tolist() == TABLE["time"][kept].tolist()


def test_nanoseconds_are_not_taken_for_seconds(extension: str, tmp_path: Path) -> None:
    if extension in TIMED_BY_ITSELF:
        extension = ".csv"
    start = 1_700_000_000_000_000_000
    stamps = start + np.arange(N) * 10_000_000
    path = tmp_path / f"stamped{extension}"
    WRITERS[extension](path, {"timestamp": stamps, "speed": TABLE["speed"]})
    with pytest.raises(rtamt.InputError) as caught:
        read(path, ["speed"]).period()
    assert str(caught.value) == (
        f"{path}: expected times in seconds in the column 'timestamp', got 1e+07 s apart "
        "(0.01 s as ns); give the unit with --time-unit, such as ns, ms or s"
    )
    trace = read(path, ["speed"], Columns(time_unit="ns"))
    assert (trace.period(), trace.start) == (Fraction(1, 100), start / 1e9)
    WRITERS[extension](path, {"time_ns": stamps, "speed": TABLE["speed"]})
    assert read(path, ["speed"]).period() == Fraction(1, 100)


@pytest.mark.parametrize(
    ("kind", "first", "counted"),
    [
        (pa.timestamp("us"), 2**61, "64 bits of nanoseconds"),
        (pa.timestamp("ms", "UTC"), -(2**61), "64 bits of nanoseconds"),
        (pa.duration("s"), 2**61, "64 bits of nanoseconds"),
        (pa.uint64(), 2**63, "64 bits with a sign"),
    ],
)
def test_times_that_no_clock_counts_are_refused(
    kind: pa.DataType, first: int, counted: str, tmp_path: Path
) -> None:
    path = tmp_path / "far.parquet"
    columns = {"time": pa.array([first, first + 1], kind), "speed": pa.array([1.0, 2.0])}
    pq.write_table(pa.table(columns), path)
    with pytest.raises(rtamt.InputError) as caught:
        read(path, ["speed"])
    assert str(caught.value) == (
        f"{path}, column 'time': expected times that {counted} can count, "
        f"got {kind} beyond them; write seconds since the begin"
    )


def test_what_is_not_in_the_format_is_refused(ending: str, tmp_path: Path) -> None:
    path = tmp_path / f"bad{ending}"
    path.write_bytes(b"\xe4\x00nothing" * 20)
    with pytest.raises(rtamt.InputError) as caught:
        ruled(path, ["speed"])
    assert str(caught.value).startswith(f"{path}: expected ")
    path.unlink()
    with pytest.raises(FileNotFoundError):
        ruled(path, ["speed"])


@pytest.mark.parametrize(
    # asammdf fails a second time, in a destructor, over a cut file of version 4. A log
    # that ends early is read with a note: test_ulog.py.
    "cut",
    [e for e in WRITERS if e not in (".csv", ".tsv", ".txt", ".ndjson", ".jsonl", ".mf4", ".ulg")],
)
def test_a_file_that_was_cut_is_refused(cut: str, tmp_path: Path) -> None:
    path = tmp_path / f"cut{cut}"
    WRITERS[cut](path, TABLE)
    whole = path.read_bytes()
    for part in range(20):
        path.write_bytes(whole[: len(whole) * part // 20])
        with pytest.raises(rtamt.InputError) as caught:
            ruled(path, ["speed", "gear"])
        assert str(caught.value).startswith(f"{path}: expected ")


def test_an_array_alone_is_no_archive(tmp_path: Path) -> None:
    path = tmp_path / "array.npz"
    with path.open("wb") as file:
        np.save(file, TABLE["speed"])
    with pytest.raises(rtamt.InputError) as caught:
        read(path, ["speed"])
    assert str(caught.value) == (
        f"{path}: expected an archive of numpy.savez, whose arrays are numbers"
    )


@pytest.mark.parametrize(
    ("arrays", "said"),
    [
        ({}, ": expected columns with names, got none"),
        ({"plan": np.zeros((2, 2))}, ": expected columns with names, got none"),
        (
            {"time": np.arange(3.0), "speed": np.arange(2.0)},
            ": expected columns of one length, got speed: 2, time: 3",
        ),
        ({"speed": np.array(["a", "b"])}, ", row 1, column 'speed': expected a number, got 'a'"),
        (
            {"time": np.array(["a", "b"]), "speed": np.arange(2.0)},
            ", column 'time': expected numbers or dates, got <U1",
        ),
        (
            {"time": np.array([False, True]), "speed": np.arange(2.0)},
            ", column 'time': expected numbers or dates, got bool",
        ),
    ],
)
def test_arrays_that_are_no_columns_are_refused(arrays: Table, said: str, tmp_path: Path) -> None:
    path = tmp_path / "trace.npz"
    write_npz(path, arrays)
    with pytest.raises(rtamt.InputError) as caught:
        read(path, ["speed"])
    assert str(caught.value) == f"{path}{said}"


def test_numpy_structures_and_longest_array(
    tmp_path: Path,
) -> None:
    path = tmp_path / "trace.npz"
    car = np.array([(0.5, 1), (1.5, 2), (2.5, 3)], [("speed", "f8"), ("gear", "i4")])
    np.savez(path, car=car)
    trace = read(path, ["car.gear"])
    assert trace.columns["car.gear"].tolist() == [1.0, 2.0, 3.0]
    assert read(path, []).samples == 3


@pytest.mark.parametrize("extension", [".npz", ".parquet", ".ndjson"])
def test_dates_in_texts_are_times(extension: str, tmp_path: Path) -> None:
    path = tmp_path / f"dated{extension}"
    dates = [f"2024-02-29T23:59:{second}.5Z" for second in (57, 58, 59)]
    if extension == ".npz":
        np.savez(path, time=np.array(dates), speed=np.arange(3.0))
    elif extension == ".parquet":
        pq.write_table(pa.table({"time": dates, "speed": [0.0, 1.0, 2.0]}), path)
    else:
        rows = ({"time": date, "speed": at} for at, date in enumerate(dates))
        path.write_text("\n".join(map(json.dumps, rows)))
    trace = read(path, ["speed"])
    assert trace.period() == Fraction(1)
    assert trace.columns["speed"].tolist() == [0.0, 1.0, 2.0]


@pytest.mark.parametrize(
    ("time", "said"),
    [
        (pa.array([0.0, None, 2.0]), ", row 2, column 'time': expected a number, got none"),
        (pa.array(["a", "b", "c"]), ", column 'time': expected numbers or dates, got <U1"),
        (pa.array([], pa.int64()), ": expected at least one sample below the line of names"),
        (pa.array([], pa.float64()), ": expected at least one sample below the line of names"),
    ],
)
def test_a_table_without_times_is_refused(time: pa.Array, said: str, tmp_path: Path) -> None:
    path = tmp_path / "trace.parquet"
    pq.write_table(pa.table({"time": time, "speed": pa.array([1.0] * len(time))}), path)
    with pytest.raises(rtamt.InputError) as caught:
        read(path, ["speed"])
    assert str(caught.value) == f"{path}{said}"


def test_missing_column_error_in_all_formats(extension: str, tmp_path: Path) -> None:
    path = tmp_path / f"trace{extension}"
    WRITERS[extension](path, TABLE)
    with pytest.raises(rtamt.InputError) as caught:
        read(path, ["sped"])
    assert str(caught.value) == (
        f"{path}: no column 'sped', which the specification reads; "
        "the columns are time, speed, gear; did you mean 'speed'?"
    )


def test_matlab_vectors_and_structures(tmp_path: Path) -> None:
    path = tmp_path / "m.mat"
    lying = {"t": TABLE["time"][None, :], "car": {"speed": TABLE["speed"][None, :], "mass": 3.0}}
    savemat(path, lying)
    trace = read(path, ["car.speed"])
    assert trace.columns["car.speed"].tolist() == TABLE["speed"].tolist()
    assert trace.period() == Fraction(1, 8)
    savemat(path, {"t": TABLE["time"], "speed": TABLE["speed"][1:]})
    with pytest.raises(rtamt.InputError, match=r"columns of one length, got speed: 49, t: 50$"):
        read(path, ["speed"])


def test_long_and_short_texts_match(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    texts = [
        "time,x\n0,1\n\n0.5,+2\n1.0,1e3\n1.5,-inf\n",
        " time , x \n0, 1\n1,2 \n",
        'x;time\n"1,5";0\n2,25;0,5\n',
        "time,x\n2024-01-01T00:00:00.123456789Z,1\n2024-01-01T00:00:01+00:00,3\n",
        "timestamp [us],x\n1700000000000001,1\n1700000000000003,2\n",
        "time,x\n2300-01-01 00:00:00,1\n2300-01-01 00:00:01,3\n",
        "time,x\n1500-01-01,1\n1500-01-02,3\n",
        "\ufeffx,x2\n1,\n2,3\n",
        "time,x\n0,1\n1,1_0\n",
        "time,x\n0,1\n1,nan\n",
        "time,x\n0,1\n1,٣\n",
        "time,x\n0,1\n1,\n",
        "time,x\n0,1\n1,2,3\n",
        "time,x\n0,1\nnan,3\n",
        "\n\ntime,x\n0,1\n\n\n1,x\n",
        "time;x\n0,1;1,5\n0,2;1.5\n",
        "time,x\n2024-01-01T00:00:00Z,1\n2024-13-01T00:00:00Z,3\n",
        "time,x\n0,1\n",
    ]
    path = tmp_path / "t.csv"
    for text in texts:
        path.write_text(text, encoding="utf-8")
        # A formula may read the times, which are not numbers if they are dates.
        for variable, columns in [
            ("x", Columns()),
            ("x", Columns(missing="hold")),
            ("time", Columns()),
        ]:
            said: list[object] = []
            for long in (1 << 30, 0):
                monkeypatch.setattr(csv_reader, "_LONG", long)
                try:
                    trace = read(path, [variable], columns)
                    times = None if trace.times is None else trace.times.since.tolist()
                    where = [trace.where(i) for i in range(trace.samples)]
                    said.append((trace.columns[variable].tolist(), times, where, [*trace.notes]))
                except rtamt.InputError as error:
                    said.append(str(error))
            assert said[0] == said[1], text


def test_the_library_reads_what_needs_no_help(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(csv_reader, "_LONG", 0)
    monkeypatch.delattr(CsvRecording, "_blocks")
    for extension in (".csv", ".csv.gz", ".tsv", ".txt"):
        path = tmp_path / f"long{extension}"
        WRITERS[extension](path, TABLE)
        assert read(path, ["speed"]).columns["speed"].tolist() == TABLE["speed"].tolist()


@pytest.mark.slow(keep=1)
@pytest.mark.parametrize("extension", [".csv", ".parquet", ".feather", ".ndjson"])
def test_long_files_do_not_import_pandas(extension: str, tmp_path: Path) -> None:
    path = tmp_path / f"long{extension}"
    WRITERS[extension](path, TABLE)
    code = (
        "import sys; from rtamt_gym.recorded import csv_reader; csv_reader._LONG = 0;"
        "from rtamt_gym.__main__ import main;"
        "assert main(['monitor', 'always(speed < 2)', sys.argv[1]]) == 0;"
        "print({'pyarrow', 'pandas'} & {*sys.modules})"
    )
    command = [sys.executable, "-c", code, str(path)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.endswith("{'pyarrow'}\n")
