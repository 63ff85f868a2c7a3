"""Recorded traces that the command line refuses: one message on stderr, exit code 2."""

import io
import sys
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from command_line import run_without, write_files

from rtamt_gym.__main__ import main

Output = pytest.CaptureFixture[str]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working directory, with a specification and traces."""
    monkeypatch.chdir(tmp_path)
    write_files(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    ("trace", "message"),
    [
        (
            "time,x\n0,1\n0,2\n",
            (
                "stdin, column 'x': expected one value at 0 s, got 1 and 2; choose with "
                "--same-time first or --same-time last"
            ),
        ),
        (
            "time,variable,value\n0,x,1\n\n0.5,y,1\n0.25,x,1\n0.25,x,2\n",
            (
                "stdin, 'x': expected one value at 0.25 s, got 1 and 2; choose with --same-time "
                "first or --same-time last"
            ),
        ),
        (
            "time,variable,value\n0,xx,1\n1,y,1\n",
            (
                "stdin: no events of 'x', which the specification reads; "
                "the variables are xx, y; did you mean 'xx'?"
            ),
        ),
        ("time,x\n0,\n1, \n", "stdin: expected events of 'x', got none"),
        (
            "tx,x\n0,1\n",
            (
                "stdin: no column 'time', which --dense reads; the columns are tx, x; "
                "give --time COLUMN"
            ),
        ),
        (
            "variable,value\nx,1\n",
            (
                "stdin: no column 'time', which --dense reads; the columns are variable, value; "
                "give --time COLUMN"
            ),
        ),
        ("time,x\n0,1\ninf,2\n", "stdin, line 3, column 'time': expected a finite number, got inf"),
        ("time,x\n,1\n", "stdin, line 2, column 'time': expected a number, got ''"),
        ("time,x\n0,one\n", "stdin, line 2, column 'x': expected a number, got 'one'"),
        (
            "time,x\n0,nan\n",
            (
                "stdin, line 2, column 'x': expected a number, got 'nan'; "
                "give --missing drop to read nan as no event"
            ),
        ),
        ("time,x,y\n0,1\n", "stdin, line 2: expected 3 values (time, x, y), got 2"),
        ("time,x\n", "stdin: expected at least one sample below the line of names"),
    ],
)
def test_bad_event_error_states_place(
    capsys: Output, monkeypatch: pytest.MonkeyPatch, trace: str, message: str
) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO(trace))
    assert main(["monitor", "--dense", "always[0:1](x > 0)", "-"]) == 2
    assert capsys.readouterr() == ("", f"rtamt: error: {message}\n")


@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            "monitor --dense --period 1 spec.stl wide.csv",
            "expected --period or --dense, which reads events at any time",
        ),
        (
            "monitor calm.stl calm.stl even.csv",
            "expected one specification 'calm', got two; rename one",
        ),
        (
            "monitor calm.stl even.csv --out no/r.csv",
            "cannot write no/r.csv: the folder no does not exist",
        ),
        (
            "monitor calm.stl even.csv --plot r.doc",
            "cannot draw r.doc: expected a name that ends in .png, .svg or .pdf",
        ),
        ("monitor calm.stl no.parquet", "cannot open no.parquet: No such file or directory"),
        (
            "monitor calm.stl bad.parquet",
            (
                "bad.parquet: expected a Parquet file, got an error: ArrowInvalid: Parquet magic "
                "bytes not found in footer. Either the file is corrupted or this is not a "
                "parquet file."
            ),
        ),
        (
            "monitor calm.stl odd.parquet",
            (
                "odd.parquet, row 2, column 'req': expected a number, got none; "
                "give --missing unknown, or --missing hold if the value before holds; "
                "give --dense to take rows as events at any time"
            ),
        ),
        (
            "monitor calm.stl wide.csv",
            (
                "wide.csv, line 4, column 'req': expected a number, got ''; "
                "give --missing unknown, or --missing hold if the value before holds; "
                "give --dense to take rows as events at any time"
            ),
        ),
        (
            "explain calm.stl wide.csv",
            (
                "wide.csv, line 4, column 'req': expected a number, got ''; "
                "give --missing unknown, or --missing hold if the value before holds; "
                "give --dense to take rows as events at any time"
            ),
        ),
        (
            "monitor always(note>0) odd.parquet",
            "odd.parquet, row 1, column 'note': expected a number, got 'a'",
        ),
        (
            "monitor --dense always(z>0) odd.parquet",
            "odd.parquet, row 1, column 'variable': expected a name, got 1",
        ),
        (
            "explain calm.stl",
            "the following arguments are required: TRACE; see rtamt explain --help",
        ),
        (
            "explain req<1 even.csv",
            (
                "the specification is about the first sample only; "
                "write always(req < 1) or --view step"
            ),
        ),
        (
            "explain calm.stl uneven.csv",
            (
                "uneven.csv, line 4: expected samples at even distances, got time 2.5 after 1, "
                "elsewhere 1 s; give --dense to take rows as events at any time, --jitter 5% to "
                "resample by holding values, or --period to leave the column 'time' aside"
            ),
        ),
    ],
)
def test_bad_input_is_refused_in_one_message_and_exit_code_2(
    capsys: Output, arguments: str, message: str
) -> None:
    Path("bad.parquet").write_text("time,req\n")
    Path("uneven.csv").write_text("time,req\n0,1\n1,1\n2.5,1\n3.5,1\n4.5,1\n")
    odd = {
        "time": [0, 1],
        "req": [1, None],
        "note": ["a", "b"],
        "variable": [1, 2],
        "value": [1, 2],
    }
    pq.write_table(pa.table(odd), "odd.parquet")
    assert main(arguments.split()) == 2
    assert capsys.readouterr() == ("", f"rtamt: error: {message}\n")


@pytest.mark.slow(keep=1)
@pytest.mark.usefixtures("folder")
@pytest.mark.parametrize(
    "arguments",
    [
        ["explain", "spec.stl", "even.csv"],
        ["monitor", "--dense", "spec.stl", "wide.csv", "--plot", "p.png"],
    ],
)
def test_traces_need_no_simulator(arguments: list[str]) -> None:
    ran = run_without(["gymnasium", "mujoco", "highway_env", "pyarrow", "tqdm"], arguments)
    assert (ran.returncode, ran.stderr) == (1, "")


@pytest.mark.usefixtures("folder")
def test_parquet_without_pyarrow_error() -> None:
    ran = run_without(["pyarrow"], ["monitor", "calm.stl", "even.parquet"])
    assert (ran.returncode, ran.stdout, ran.stderr) == (
        2,
        "",
        "rtamt: error: pyarrow is not installed; from the checkout: pip install '.[files]'\n",
    )
