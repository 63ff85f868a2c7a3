"""Damaged and hostile traces: each is an error in words, and affects only its own row."""

import io
import json
import os
import random
import struct
import subprocess
import sys
import zipfile
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.feather
import pyarrow.parquet as pq
import pytest
from asammdf import MDF, Signal
from command_line import run_without, write_files
from scipy.io import savemat

from rtamt import InputError
from rtamt_gym.__main__ import main
from rtamt_gym.recorded import contained, csv_reader
from rtamt_gym.recorded.columns import Columns
from rtamt_gym.recorded.readers import FORMATS, open_recording, refusing
from rtamt_gym.recorded.recording import Wanted

Output = pytest.CaptureFixture[str]
SPEC = "always(x < 9)"

READER = """\
import ctypes
import os
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from rtamt import InputError
from rtamt_gym.recorded.arrays import ArrayRecording


@contextmanager
def open_file(path, columns):
    match Path(path).read_text():
        case "crash":
            ctypes.string_at(0)
        case "hang":
            time.sleep(1e6)
        case "leave":
            os._exit(3)
        case "print":
            print("printed", flush=True)
        case "raise":
            raise KeyError("no such thing")
        case "read":
            yield Crashing(path, {"x": np.ones(2)})
    yield ArrayRecording(path, {"x": np.ones(3), "pid": np.full(3, os.getpid())})


class Crashing(ArrayRecording):
    def read(self, wanted):
        ctypes.string_at(0)
"""


@pytest.fixture
def strange(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[str], Path]]:
    """Writes files of a reader that follows their content."""
    (tmp_path / "strange_reader.py").write_text(READER, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    own: list[Any] = []
    monkeypatch.setattr(contained, "_idle", own)  # processes that look here for modules

    def write(what: str) -> Path:
        path = tmp_path / f"{what}.strange"
        path.write_text(what, encoding="utf-8")
        return path

    yield write
    for process in own:
        process.end()


def read(path: Path) -> dict[str, list[float]]:
    with contained.open_file("strange_reader", str(path), Columns()) as recording:
        rows = recording.read(Wanted(["x", "pid"]))
        assert rows.where(1) == f"{path}, row 2"
        return {name: values.tolist() for name, values in rows.numbers.items()}


@pytest.mark.slow
def test_process_is_reused_until_crash(
    strange: Callable[[str], Path],
) -> None:
    first = read(strange("good"))
    assert first["x"] == [1, 1, 1]
    assert first["pid"][0] != os.getpid()
    assert read(strange("print")) == first == read(strange("good"))
    for what, said in (
        ("crash", "its reader crashed by SIGSEGV"),
        ("leave", "its reader ended with exit status 3"),
        ("read", "its reader crashed by SIGSEGV"),
    ):
        with pytest.raises(InputError, match=f"{what}.strange: expected a whole file, but {said}"):
            read(strange(what))
        other = read(strange("good"))
        assert other["pid"] != first["pid"]
        first = other
    with pytest.raises(KeyError, match="no such thing"):
        read(strange("raise"))
    assert read(strange("good")) == first


def test_a_reader_that_hangs_is_ended(
    strange: Callable[[str], Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(contained, "LIMIT", 0.2)
    with pytest.raises(InputError, match=r"hang.strange: .* took more than 0 s"):
        read(strange("hang"))


@pytest.mark.slow
@pytest.mark.usefixtures("strange")
def test_process_uses_same_module_path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    here = tmp_path / "here"
    here.mkdir()
    (here / "scipy.py").write_text("raise SystemExit('a module of a stranger')", encoding="utf-8")
    savemat(here / "t.mat", {"x": np.arange(3.0)})
    monkeypatch.chdir(here)
    path = [each for each in sys.path if each not in ("", str(here))]
    monkeypatch.setattr(sys, "path", path)
    with open_recording("t.mat") as recording:
        assert recording.read(Wanted(["x"])).numbers["x"].tolist() == [0, 1, 2]


def test_matlab_and_mdf_use_another_process() -> None:
    assert {row.name for row in FORMATS if row.contained} >= {"MATLAB", "MDF"}


def whole_files(folder: Path) -> dict[str, bytes]:
    """Return a good file of each binary format, by its extension."""
    table = pa.table({"x": np.arange(30.0), "note": [f"n{i}" for i in range(30)]})
    savemat(folder / "w.mat", {"x": np.arange(30.0), "t": {"a": np.arange(9), "b": "text"}})
    np.savez_compressed(folder / "w.npz", x=np.arange(30.0))
    pq.write_table(table, folder / "w.parquet")
    pyarrow.feather.write_feather(table, folder / "w.feather")
    with MDF(version="4.10") as file:
        file.append(Signal(np.arange(30.0), np.arange(30.0), name="x"))
        file.save(folder / "w.mf4", overwrite=True)
    return {p.suffix: p.read_bytes() for p in folder.glob("w.*")}


@pytest.mark.slow(keep=4)
@pytest.mark.parametrize("suffix", [".mat", ".npz", ".parquet", ".feather", ".mf4"])
def test_damaged_file_error_names_file(suffix: str, tmp_path: Path) -> None:
    raw = whole_files(tmp_path)[suffix]
    chance = random.Random(suffix)
    refusals = []
    for i in range(60):
        changed = bytearray(raw)
        for _ in range(chance.randint(1, 6)):
            changed[chance.randrange(len(raw))] = chance.randrange(256)
        path = tmp_path / f"damaged{i}{suffix}"
        path.write_bytes(bytes(changed[: chance.choice([len(raw), chance.randrange(len(raw))])]))
        try:
            with open_recording(str(path)) as recording:
                if "x" in recording.names:
                    recording.read(Wanted(["x"], gaps=["x"]))
        except InputError as error:
            refusals.append((path, str(error)))
    assert len(refusals) > 10
    assert all(said.startswith(f"{path}") for path, said in refusals)


def crashing_mat(path: Path) -> None:
    """Return a MATLAB file with two changed bytes, which ends the process in SciPy 1.17."""
    cell = np.array(["a", 2.0], dtype=object)
    savemat(path, {"x": np.arange(30.0), "t": {"a": np.arange(9), "b": "text"}, "c": cell})
    raw = bytearray(path.read_bytes())
    raw[326], raw[644] = 15, 3
    path.write_bytes(bytes(raw))


@pytest.mark.slow
def test_damaged_matlab_file_affects_one_row(capsys: Output) -> None:
    for name in ("a.mat", "c.mat"):
        savemat(name, {"x": np.arange(3.0)})
    crashing_mat(Path("b.mat"))
    assert main(["monitor", SPEC, "--json", "--", "a.mat", "b.mat", "c.mat"]) == 2
    out, err = capsys.readouterr()
    words = [trial["outcomes"]["spec"]["verdict"] for trial in json.loads(out)["trials"]]
    assert words == ["SATISFIED", "ERROR", "SATISFIED"]
    assert "rtamt: error: b.mat: expected a whole file, but its reader crashed by SIGSEGV" in err


@pytest.mark.parametrize(
    "error",
    [
        zlib.error("incorrect header check"),
        TypeError("no header"),
        UnboundLocalError("block"),
        MemoryError("1e12 numbers"),
        pa.ArrowMemoryError("malloc"),
        pa.ArrowTypeError("no column"),
        RecursionError(),
        OSError("seek"),
    ],
)
def test_library_errors_become_input_errors(error: Exception) -> None:
    kind = type(error).__name__
    with (
        pytest.raises(InputError, match=rf"t.csv: expected a file, got an error: {kind}"),
        refusing("t.csv", "a file"),
    ):
        raise error
    for passed in (InputError("as it is"), ModuleNotFoundError("x"), FileNotFoundError(2, "", "f")):
        with pytest.raises(type(passed)), refusing("t.csv", "a file"):
            raise passed


def test_oversized_header_error(tmp_path: Path) -> None:
    path = tmp_path / "huge.npz"
    header = "{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000,), }"
    array = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header) + 1) + header.encode() + b"\n"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("x.npy", array + b"\0" * 64)
    with (
        pytest.raises(InputError, match=r"huge.npz: expected an archive"),
        open_recording(str(path)),
    ):
        pass


def test_a_line_without_an_end_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Output
) -> None:
    monkeypatch.setattr(csv_reader, "_LINE", 1000)
    path = tmp_path / "long.csv"
    for text in ("x" * 1001, "x\n" + "1" * 1001, "x\n" + "1\n" * 20000 + "1" * 2000):
        path.write_text(text, encoding="utf-8")
        assert main(["monitor", SPEC, str(path)]) == 2
        assert "long.csv: expected lines of at most 1000 characters" in capsys.readouterr().err
    path.write_text("x" * 999 + "\n" + "\n".join(["1"] * 9), encoding="utf-8")
    assert main(["monitor", "always(x < 9)", str(path)]) == 2
    assert "no column 'x'" in capsys.readouterr().err


@pytest.mark.slow
def test_missing_column_error_lists_nearest(tmp_path: Path, capsys: Output) -> None:
    path = tmp_path / "wide.csv"
    names = [f"c{i:06d}" for i in range(300_000)] + ["Speed"]
    path.write_text(",".join(names) + "\n" + ",".join(["1"] * len(names)), encoding="utf-8")
    assert main(["monitor", "always(speeed < 9)", str(path)]) == 2
    err = capsys.readouterr().err
    assert len(err) < 500
    assert "the columns are Speed, " in err
    assert "and 299996 more" in err
    assert main(["monitor", "always(x < 9)", "--time", "when", str(path)]) == 2
    assert len(capsys.readouterr().err) < 500


@pytest.mark.slow
def test_process_ends_with_its_parent(tmp_path: Path) -> None:
    savemat(tmp_path / "t.mat", {"x": np.arange(3.0)})
    code = (
        "import os\n"
        "from rtamt_gym.recorded import contained\n"
        "from rtamt_gym.recorded.readers import open_recording\n"
        f"with open_recording({str(tmp_path / 't.mat')!r}): pass\n"
        "print(contained._idle[0]._process.pid)\n"
    )
    command = [sys.executable, "-W", "error", "-c", code]
    ran = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (ran.returncode, ran.stderr) == (0, "")
    with pytest.raises(ProcessLookupError):
        os.kill(int(ran.stdout), 0)


# Recorded traces that the command line refuses: one message on stderr, exit code 2. --------------


@pytest.fixture
def written_folder(folder: Path) -> Path:
    """The working directory, with a specification and traces."""
    write_files(folder)
    return folder


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


@pytest.mark.usefixtures("written_folder")
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
@pytest.mark.usefixtures("written_folder")
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


@pytest.mark.usefixtures("written_folder")
def test_parquet_without_pyarrow_error() -> None:
    ran = run_without(["pyarrow"], ["monitor", "calm.stl", "even.parquet"])
    assert (ran.returncode, ran.stdout, ran.stderr) == (
        2,
        "",
        "rtamt: error: pyarrow is not installed; from the checkout: pip install '.[files]'\n",
    )
