"""Recorded traces on the command line: several specifications, events, Parquet, files, pictures."""

import contextlib
import csv
import gc
import io
import os
import pty
import subprocess
import sys
import termios
import types
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from command_line import SPEC, write_files

import rtamt
from rtamt_gym.__main__ import main
from rtamt_gym.recorded import csv_reader, readers
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.csv_reader import CsvRecording
from rtamt_gym.recorded.recording import Recording, Wanted

Output = pytest.CaptureFixture[str]


EMPTY = "note: empty cells are not events: the value before holds (gnt: 1, req: 1)\n"


@pytest.fixture
def folder(folder: Path) -> Path:
    """The working directory, with a specification and traces."""
    write_files(folder)
    return folder


# Why. --------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("folder")
def test_explain_path_to_sample(capsys: Output) -> None:
    assert main(["explain", "spec.stl", "even.csv"]) == 1
    assert capsys.readouterr().out == (
        "robustness -2 at 0 s, decided by req >= 3 at 0.5 s\n"
        "\n"
        "   at  value  formula\n"
        "  0 s     -2  out = always(req >= 3 implies granted)\n"
        "0.5 s     -2  req >= 3 implies granted\n"
        "0.5 s      2  req >= 3\n"
        "0.5 s      5  req\n"
        "  1 s     -2  missing: gnt >= 3\n"
        "                never from 0.5 s to 1 s; this is the nearest\n"
        "\n"
        "even.csv: 4 samples, one every 0.5 s, 0 s to 1.5 s\n"
        "  1.5 s long, longest gap 0.5 s\n"
    )


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("trace", ["wide.csv", "long.csv"])
def test_explain_path_to_event_time(trace: str, capsys: Output) -> None:
    end, gap = ("1.5", "1.15 s of req") if trace == "wide.csv" else ("9", "7.5 s")
    assert main(["explain", "--dense", "spec.stl", trace]) == 1
    assert capsys.readouterr().out == (
        "robustness -2 at 0 s, decided by req >= 3 at 0.35 s\n"
        "\n"
        "    at  value  formula\n"
        "   0 s     -2  out = always(req >= 3 implies granted)\n"
        "0.35 s     -2  req >= 3 implies granted\n"
        "0.35 s      2  req >= 3\n"
        "0.35 s      5  req\n"
        "0.35 s     -3  missing: gnt >= 3\n"
        "                 never from 0.35 s to 0.85 s; this is the nearest\n"
        "\n"
        f"{trace}: 6 events, 0 s to {end} s, {end} s long, longest gap {gap}\n"
        f"{EMPTY if trace == 'wide.csv' else ''}"
    )
    assert main(["explain", "--dense", "calm.stl", "req < 5", trace, "--view", "step"]) == 1
    assert main(["explain", "--dense", "spec.stl", trace, "--period", "1"]) == 2


@pytest.mark.usefixtures("folder")
def test_explain_several_specifications(capsys: Output, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO("req\n3\n8\n"))
    assert main(["explain", "calm.stl", "low = req < 10", "-", "--view", "step"]) == 0
    assert capsys.readouterr().out == (
        "calm:\n"
        "robustness 1 at sample 0, decided by req < 9 at sample 1\n"
        "\n"
        "      at  value  formula\n"
        "sample 0      1  always always(req < 9)\n"
        "sample 0      1  always(req < 9)\n"
        "sample 1      1  req < 9\n"
        "sample 1      8  req\n"
        "\n"
        "low:\n"
        "robustness 2 at sample 0, decided by req < 10 at sample 1\n"
        "\n"
        "      at  value  formula\n"
        "sample 0      2  always(low)\n"
        "sample 1      2  low = req < 10\n"
        "sample 1      8  req\n"
        "\n"
        "-: 2 samples, bounds count samples\n"
    )


# Several specifications, and what is written. ----------------------------------------------------


@pytest.mark.usefixtures("folder")
def test_several_specifications_are_judged_each(capsys: Output) -> None:
    assert main(["monitor", "spec.stl", "first=calm.stl", "always(gnt < 5)", "even.csv"]) == 1
    assert capsys.readouterr().out == (
        "out: VIOLATED, robustness -2, certain from 1 s on\n"
        "    why: decided by req >= 3 at 0.5 s, where req = 5\n"
        "    triggered 1 time, first at 0.5 s\n"
        "first: SATISFIED, robustness 4, at the end of the trace\n"
        "    why: decided by req < 9 at 0.5 s, where req = 5\n"
        "spec3: SATISFIED, robustness 1, at the end of the trace\n"
        "    why: decided by gnt < 5 at 1.5 s, where gnt = 4\n"
        "even.csv: 4 samples, one every 0.5 s, 0 s to 1.5 s\n"
        "  1.5 s long, longest gap 0.5 s\n"
        "\n"
        "spec   formula   at the start  minimum   at  violated from\n"
        "out    granted             -3       -3  0 s            0 s\n"
        "       out                 -2       -2  0 s            0 s\n"
        "first  (result)             4        4  0 s              -\n"
        "spec3  (result)             1        1  0 s              -\n"
    )
    assert main(["monitor", "calm.stl", "always(gnt < 5)", "even.csv"]) == 0


@pytest.mark.usefixtures("folder")
def test_options_between_arguments(capsys: Output) -> None:
    said = []
    specs = ["spec.stl", "calm.stl", "always(gnt < 5)"]
    for arguments in (
        [*specs, "even.csv", "--view", "step"],
        [*specs, "--view", "step", "even.csv"],
        [*specs[:2], "--view", "step", *specs[2:], "even.csv"],
        ["--view", "step", *specs, "even.csv"],
    ):
        assert main(["monitor", *arguments]) == 1
        said.append(capsys.readouterr().out)
    assert len(set(said)) == 1
    assert main(["monitor", *specs, "even.csv", "--step"]) == 2
    assert capsys.readouterr().err == (
        "rtamt: error: unrecognized arguments: --step; did you mean '--stale'?; "
        "see rtamt monitor --help\n"
    )


@pytest.mark.usefixtures("folder")
def test_long_names_are_cut_to_80_columns(capsys: Output) -> None:
    name = "the_request_is_granted_before_it_is_withdrawn"
    for specs in ([f"{name} = always(req < 9.123456)"], [f"{name} = always(req < 9)", "calm.stl"]):
        assert main(["monitor", *specs, "even.csv"]) == 0
        lines = capsys.readouterr().out.splitlines()
        assert max(map(len, lines)) <= 80
        shown = lines[-len(specs)].split()[0]
        assert shown.endswith("...")
        assert name.startswith(shown.removesuffix("..."))


def rows(path: Path) -> list[list[str]]:
    with path.open(newline="") as file:
        return list(csv.reader(file))


def test_out_writes_all_robustness(capsys: Output, folder: Path) -> None:
    assert main(["monitor", "spec.stl", "calm.stl", "even.csv", "--out", "r.csv"]) == 1
    assert capsys.readouterr().out.endswith("robustness: r.csv\n")
    assert rows(folder / "r.csv") == [
        ["time", "out.granted", "out.out", "calm"],
        ["0.0", "-3.0", "-2.0", "4.0"],
        ["0.5", "-2.0", "-2.0", "4.0"],
        ["1.0", "1.0", "3.0", "9.0"],
        ["1.5", "1.0", "3.0", "9.0"],
    ]
    # It is a trace like any other.
    assert main(["monitor", "always(calm > 3)", "r.csv"]) == 0
    capsys.readouterr()
    (folder / "bare.csv").write_text("req\n1\n2\n")
    assert main(["monitor", "eventually[2:3](req > 0)", "bare.csv", "--out", "r.csv"]) == 3
    assert rows(folder / "r.csv") == [["sample", "robustness"], ["0", "-inf"], ["1", "-inf"]]


@pytest.mark.slow(keep=1)
@pytest.mark.parametrize("options", [["even.csv"], ["--dense", "wide.csv"]])
def test_plot_draws_signals_and_robustness(
    options: list[str], capsys: Output, folder: Path
) -> None:
    assert main(["monitor", "spec.stl", "calm.stl", "--plot", "p.png", *options]) == 1
    assert capsys.readouterr().out.endswith("picture: p.png\n")
    assert (folder / "p.png").read_bytes().startswith(b"\x89PNG")


# Events. -----------------------------------------------------------------------------------------


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize("trace", ["wide.csv", "long.csv"])
def test_dense_reads_wide_and_long_events(trace: str, capsys: Output) -> None:
    end, gap = (1.5, "1.15 s of req") if trace == "wide.csv" else (9, "7.5 s")
    assert main(["monitor", "--dense", "spec.stl", "calm.stl", trace, "--out", "r.csv"]) == 1
    assert capsys.readouterr().out == (
        "out: VIOLATED, robustness -2, certain from 0.85 s on\n"
        "    why: decided by req >= 3 at 0.35 s, where req = 5\n"
        "    triggered 1 time, first at 0.35 s\n"
        "calm: SATISFIED, robustness 4, at the end of the trace\n"
        "    why: decided by req < 9 at 0.35 s, where req = 5\n"
        f"{trace}: 6 events, 0 s to {end} s, {end} s long, longest gap {gap}\n"
        f"{EMPTY if trace == 'wide.csv' else ''}"
        "\n"
        "spec  formula   at the start  minimum   at  violated from\n"
        "out   granted             -3       -3  0 s            0 s\n"
        "      out                 -2       -2  0 s            0 s\n"
        "calm  (result)             4        4  0 s              -\n"
        "robustness: r.csv\n"
    )
    written = rows(Path("r.csv"))
    assert written[0] == ["time", "variable", "value"]
    events = {name: [r[::2] for r in written if r[1] == name] for name in ("out.out", "calm")}
    signals = {
        "req": [(0, 0), (0.35, 5), (1.5, 0), (9, 0)],
        "gnt": [(0, 0), (0.9, 4), (1.5, 0), (9, 0)],
    }
    signals = {name: [e for e in line if e[0] <= end] for name, line in signals.items()}
    for name, spec in {"out.out": SPEC, "calm": "always(req < 9)"}.items():
        expected = rtamt.dense.evaluate(spec, {v: signals[v] for v in rtamt.parse(spec).variables})
        assert [[float(t), float(v)] for t, v in events[name]] == [list(e) for e in expected]
    # It is a trace like any other.
    assert main(["monitor", "--dense", "always(calm > 3)", "r.csv"]) == 0


@pytest.mark.usefixtures("folder")
def test_dense_step_view_covers_all_instants(capsys: Output) -> None:
    arguments = ["monitor", "--dense", "req < 5", "wide.csv", "--view"]
    assert main([*arguments, "step"]) == 1
    assert capsys.readouterr().out.startswith("VIOLATED, robustness 0, certain from 0.35 s on\n")
    assert main([*arguments, "episode"]) == 2


# Parquet. ----------------------------------------------------------------------------------------


def test_parquet_is_read_like_csv(capsys: Output, folder: Path) -> None:
    columns = {
        "time": [0.0, 0.5, 1.0, 1.5],
        "msg": [{"req": r} for r in (0, 5, 0, 0)],
        "gnt": [0, 0, 1, 4],
        "note": ["", "a request", "too late", ""],
    }
    pq.write_table(pa.table(columns), folder / "even.parquet")
    (folder / "fields.stl").write_text(SPEC.replace("req", "msg.req"))
    assert main(["monitor", "spec.stl", "even.csv"]) == 1
    expected = capsys.readouterr().out.replace("even.csv", "even.parquet")
    assert main(["monitor", "fields.stl", "even.parquet"]) == 1
    assert capsys.readouterr().out.replace("msg.req", "req") == expected


def test_dense_parquet_ignores_empty_cells(capsys: Output, folder: Path) -> None:
    columns = {
        "time": [0, 0.35, 0.9, 1.5],
        "req": [0, 5, None, 0],
        "gnt": [0, float("nan"), 4, 0],
    }
    pq.write_table(pa.table(columns), folder / "wide.parquet")
    names, times, values = zip(
        ("req", 0.0, 0.0), ("gnt", 0.0, 0.0), ("req", 0.35, 5.0), ("gnt", 0.9, 4.0),
        ("req", 1.5, 0.0), ("gnt", 1.5, 0.0), strict=True,
    )  # fmt: skip
    events = {"variable": pa.array(names).dictionary_encode(), "time": times, "value": values}
    pq.write_table(pa.table(events), folder / "long.parquet")
    said = []
    for trace in ("wide.csv", "wide.parquet", "long.parquet"):
        assert main(["monitor", "--dense", "spec.stl", trace]) == 1
        said.append(capsys.readouterr().out.replace(trace, "trace"))
    assert said[0] == said[1]
    assert EMPTY in said[0]
    assert said[0].replace(EMPTY, "") == said[2]


# A format is a row. ------------------------------------------------------------------------------


def test_registered_reader_reads_its_extension(
    capsys: Output, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    @contextlib.contextmanager
    def open_file(path: str, _columns: Columns) -> Iterator[Recording]:
        with Path(path).open() as file:
            yield CsvRecording([line.replace(";", ",") for line in file], path)

    reader = types.ModuleType("semicolons")
    reader.open_file = open_file  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "semicolons", reader)
    monkeypatch.setattr(
        readers, "FORMATS", [*readers.FORMATS, readers.Format("SSV", (".ssv",), "semicolons")]
    )
    (folder / "even.ssv").write_text((folder / "even.csv").read_text().replace(",", ";"))
    assert main(["monitor", "spec.stl", "even.csv"]) == 1
    expected = capsys.readouterr().out.replace("even.csv", "even.ssv")
    assert main(["monitor", "spec.stl", "even.ssv"]) == 1
    assert capsys.readouterr().out == expected
    assert main(["monitor", "--help"]) == 0
    assert ".bag or .ssv file" in " ".join(capsys.readouterr().out.split())


# Long files. -------------------------------------------------------------------------------------


def test_row_numbers_in_all_blocks(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    lines = ["a,b", *(f"{i},{-i}" for i in range(10)), "", '"10","-10"', "11,x"]
    for block in (1, 3, 100):
        monkeypatch.setattr(csv_reader, "_BLOCK", block)
        read = CsvRecording(lines[:-1], "t.csv").read(Wanted(["b"]))
        assert read.numbers["b"].tolist() == [-float(i) for i in range(11)]
        assert [read.where(i) for i in (0, 9, 10)] == [
            "t.csv, line 2",
            "t.csv, line 11",
            "t.csv, line 13",
        ]
        with pytest.raises(rtamt.InputError) as caught:
            CsvRecording(lines, "t.csv").read(Wanted(["b"]))
        assert str(caught.value) == "t.csv, line 14, column 'b': expected a number, got 'x'"


def calls(arguments: list[str]) -> int:
    """Return the calls of functions that a command makes, also those in C."""
    count = 0

    def counted(_frame: object, event: str, _argument: object) -> None:
        nonlocal count
        count += event in {"call", "c_call"}

    gc.collect()
    gc.disable()  # garbage collection would be counted at random places
    sys.setprofile(counted)
    try:
        main(arguments)
    finally:
        sys.setprofile(None)
        gc.enable()
    return count


@pytest.mark.slow
def test_lines_cost_few_calls(
    capsys: Output, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(csv_reader, "_BLOCK", 500)
    lengths = (500, 1000, 2000, 4000)
    counts = []
    for n in lengths:
        lines = (f"{i / 100},{x},{-x}" for i, x in enumerate(np.sin(np.arange(n)).round(4)))
        (folder / "long.csv").write_text("\n".join(["time,x,y", *lines]))
        counts.append(calls(["monitor", "always(x < 2 or eventually[0:1](y > 0))", "long.csv"]))
        assert f"long.csv: {n} samples, one every 0.01 s, 0 s to " in capsys.readouterr().out
    _, *per_line = np.diff(counts) / np.diff(lengths)  # the first run imports and compiles
    assert per_line[0] < 5
    assert per_line[1] <= per_line[0] * 1.01  # a part of the cost is of the file, not of a line


def on_a_terminal(prelude: str, arguments: str = "calm.stl even.csv") -> str:
    """Return the output on a terminal of 80 columns on stderr."""
    code = (
        f"import sys, rtamt_gym.recorded.progress as p; p.DELAY = 0; {prelude};"
        f"from rtamt_gym.__main__ import main; sys.exit(main({['monitor', *arguments.split()]}))"
    )
    reading, writing = pty.openpty()
    termios.tcsetwinsize(writing, (24, 80))
    command = [sys.executable, "-c", code]
    ran = subprocess.run(command, stdout=subprocess.PIPE, stderr=writing, check=True)
    os.write(writing, b"end")  # a read of nothing would wait forever
    shown = b""
    while not shown.endswith(b"end"):
        shown += os.read(reading, 1000)
    os.close(writing)
    os.close(reading)
    assert b"SATISFIED" in ran.stdout
    return shown.decode()


@pytest.mark.slow
@pytest.mark.usefixtures("folder")
def test_terminal_shows_progress_bar() -> None:
    # Short files are read at once, without a bar.
    shown = on_a_terminal("import tqdm, rtamt_gym.recorded.csv_reader as c; c._LONG = 1")
    assert "reading even.csv:   0%" in shown
    assert "judging:   0%" in shown
    assert on_a_terminal("sys.modules['tqdm'] = None") == "end"


@pytest.mark.slow(keep=1)
@pytest.mark.parametrize("workers", ["1", "2"])
def test_progress_bar_counts_traces(workers: str, folder: Path) -> None:
    (folder / "more.csv").write_text((folder / "even.csv").read_text())
    shown = on_a_terminal("import tqdm", f"calm.stl -j {workers} -- even.csv more.csv")
    assert "judging:   0%" in shown
    assert "/2 [" in shown
    assert " traces/s]" in shown
    assert "reading" not in shown
